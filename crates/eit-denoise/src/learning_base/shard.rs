//! One sequence of training pairs, in memory and in a safetensors file.

use crate::unet::{bytes_of, floats_of, format_error};
use crate::{DenoiseError, Denoiser, ImageStack};
use ndarray::{Array1, Array2, Array3};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

/// One sequence of training pairs, frames in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Shard {
    /// Reconstructed images [frame, row, column], zero outside the mask.
    pub raw: Array3<f32>,
    /// Wanted images [frame, row, column].
    pub wanted: Array3<f32>,
    /// Mask [row, column]: true on the skin.
    pub mask: Array2<bool>,
    /// The measurements behind the images, if known.
    pub data: Option<ShardData>,
    /// Touches detected in the measurements, if they were sought.
    pub touches: Option<ShardTouches>,
    /// Further inputs of a net; not written to files, because they follow from `data`.
    pub beside: Beside,
}

/// Touches detected in a sequence, without any image: `[frame, touch, number]`, each x and y in metres and
/// the integral of the conductivity change in S m^2. Touches of a frame come first; the rest is NaN.
pub type ShardTouches = Array3<f32>;

/// Further inputs of a net, beside the raw images of a sequence.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Beside {
    /// Images [frame, row, column] that come before the raw ones and set the scale in their place; `None`: there
    /// are none.
    pub first: Option<Array3<f32>>,
    /// Further reconstructions, each [frame, row, column], zero outside the mask.
    pub images: Vec<Array3<f32>>,
    /// Conditions [frame, condition]; `None`: there are none.
    pub conditions: Option<Array2<f32>>,
}

/// The measurements of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct ShardData {
    /// Differences from the reference [frame, measurement]; NaN where a value is missing.
    pub differences: Array2<f32>,
    /// Standard deviation of each, in their unit; infinite for a measurement that is not used.
    pub noise_std: Array1<f32>,
}

impl Shard {
    /// Builds a shard from two stacks of the same skin and length; values keep their unit, rounded to
    /// `f32`.
    ///
    /// # Errors
    /// [`DenoiseError::MaskMismatch`], [`DenoiseError::WrongLength`];
    /// [`DenoiseError::NothingToLearn`] if every raw image is zero.
    pub fn new(raw: &ImageStack, wanted: &ImageStack) -> Result<Self, DenoiseError> {
        if raw.mask() != wanted.mask() {
            let pixels = raw.mask().len();
            let differing = match raw.mask().dim() == wanted.mask().dim() {
                true => raw.mask().iter().zip(wanted.mask()).filter(|(a, b)| a != b).count(),
                false => pixels,
            };
            return Err(DenoiseError::MaskMismatch { differing, pixels });
        }
        if raw.frames() != wanted.frames() {
            let (found, wanted) = (wanted.frames(), raw.frames());
            return Err(DenoiseError::WrongLength { what: "wanted images", found, wanted });
        }
        if raw.max_abs() == 0.0 {
            return Err(DenoiseError::NothingToLearn { what: "the sequence".to_owned() });
        }
        let inside =
            |stack: &ImageStack| stack.values().mapv(|v| if v.is_nan() { 0.0 } else { v as f32 });
        let mask = raw.mask().to_owned();
        let beside = Beside::default();
        Ok(Self {
            raw: inside(raw),
            wanted: inside(wanted),
            mask,
            data: None,
            touches: None,
            beside,
        })
    }

    /// Denoises its raw images with a net that also takes the further inputs.
    ///
    /// # Errors
    /// Those of [`Denoiser::denoise_with`] and of [`ImageStack::new`].
    pub fn denoise(&self, net: &mut Denoiser) -> Result<ImageStack, DenoiseError> {
        let mut all = self.images().map(|images| images.mapv(f64::from));
        let first = all.next().unwrap_or_default();
        let first = ImageStack::new(first, self.mask.clone())?;
        let others: Vec<_> = all.collect();
        let others: Vec<_> = others.iter().map(|images| images.view()).collect();
        let conditions = self.beside.conditions.as_ref().map(|c| c.mapv(f64::from));
        net.denoise_with(&first, &others, conditions.as_ref().map(|c| c.view()))
    }

    /// Images [frame, row, column] in the order in which a net takes them; the first sets the scale.
    pub(crate) fn images(&self) -> impl Iterator<Item = &Array3<f32>> {
        let Beside { first, images, .. } = &self.beside;
        first.iter().chain([&self.raw]).chain(images)
    }

    /// Returns the number of images and of conditions per frame; an error if their lengths differ from
    /// the raw images'.
    pub(crate) fn inputs(&self) -> Result<[usize; 2], DenoiseError> {
        let wanted = self.raw.dim().0;
        let conditions = &self.beside.conditions;
        if let Some(other) = self.images().find(|other| other.dim() != self.raw.dim()) {
            let (what, found) = ("frames of other images", other.dim().0);
            return Err(DenoiseError::WrongLength { what, found, wanted });
        }
        match conditions {
            Some(all) if all.nrows() != wanted => {
                let (what, found) = ("frames of conditions", all.nrows());
                Err(DenoiseError::WrongLength { what, found, wanted })
            }
            _ => Ok([self.images().count(), conditions.as_ref().map_or(0, |all| all.ncols())]),
        }
    }

    /// Returns the bytes of its file: `raw`, `wanted` [frame, row, column], `mask` [row, column], and, if
    /// known, `differences` [frame, measurement], `noise_std` [measurement] and `touches` [frame, touch, 3].
    pub(super) fn to_bytes(&self) -> Result<Vec<u8>, DenoiseError> {
        let (frames, rows, columns) = self.raw.dim();
        let floats = |values: &mut dyn Iterator<Item = f32>| bytes_of(&values.collect::<Vec<_>>());
        let raw = floats(&mut self.raw.iter().copied());
        let wanted = floats(&mut self.wanted.iter().copied());
        let mask: Vec<u8> = self.mask.iter().map(|inside| u8::from(*inside)).collect();
        let images = vec![frames, rows, columns];
        let view = |dtype, shape, bytes| TensorView::new(dtype, shape, bytes).map_err(format_error);
        let mut tensors = vec![
            ("raw", view(Dtype::F32, images.clone(), &raw)?),
            ("wanted", view(Dtype::F32, images, &wanted)?),
            ("mask", view(Dtype::U8, vec![rows, columns], &mask)?),
        ];
        let data = self.data.as_ref().map(|data| {
            let differences = floats(&mut data.differences.iter().copied());
            (data.differences.shape(), differences, floats(&mut data.noise_std.iter().copied()))
        });
        if let Some((shape, differences, noise_std)) = &data {
            tensors.push(("differences", view(Dtype::F32, shape.to_vec(), differences)?));
            tensors.push(("noise_std", view(Dtype::F32, vec![shape[1]], noise_std)?));
        }
        let touches = self.touches.as_ref();
        let touches = touches.map(|all| (all.shape(), floats(&mut all.iter().copied())));
        if let Some((shape, touches)) = &touches {
            tensors.push(("touches", view(Dtype::F32, shape.to_vec(), touches)?));
        }
        safetensors::serialize(tensors, None).map_err(format_error)
    }

    pub(super) fn from_bytes(bytes: &[u8]) -> Result<Self, DenoiseError> {
        let tensors = SafeTensors::deserialize(bytes).map_err(format_error)?;
        let wrong = |what: &str| DenoiseError::Format { what: what.to_owned() };
        let images = |name: &str| {
            let tensor = tensors.tensor(name).map_err(format_error)?;
            match (tensor.dtype(), tensor.shape()) {
                (Dtype::F32, &[frames, rows, columns]) => {
                    let values = floats_of(tensor.data()).collect();
                    Array3::from_shape_vec((frames, rows, columns), values)
                        .map_err(|_| wrong("images of another size"))
                }
                _ => Err(wrong("images that are not F32 [frame, row, column]")),
            }
        };
        let (raw, wanted) = (images("raw")?, images("wanted")?);
        let mask = tensors.tensor("mask").map_err(format_error)?;
        let (frames, rows, columns) = raw.dim();
        if raw.dim() != wanted.dim() || mask.shape() != [rows, columns] {
            return Err(wrong("raw images, wanted images and mask of different sizes"));
        }
        let inside = mask.data().iter().map(|b| *b != 0).collect();
        let mask = Array2::from_shape_vec((rows, columns), inside)
            .map_err(|_| wrong("a mask that is not U8"))?;
        if !raw.iter().chain(&wanted).all(|v| v.is_finite()) {
            return Err(wrong("pixels that are not finite"));
        }
        if raw.iter().all(|v| *v == 0.0) {
            return Err(DenoiseError::NothingToLearn { what: "the shard".to_owned() });
        }
        let data = match tensors.names().contains(&"differences") {
            true => Some(ShardData::from_tensors(&tensors, frames)?),
            false => None,
        };
        let touches = match tensors.names().contains(&"touches") {
            true => Some(touches_of(&tensors, frames)?),
            false => None,
        };
        Ok(Self { raw, wanted, mask, data, touches, beside: Beside::default() })
    }
}

fn touches_of(tensors: &SafeTensors<'_>, frames: usize) -> Result<ShardTouches, DenoiseError> {
    let wrong = |what: &str| DenoiseError::Format { what: what.to_owned() };
    let tensor = tensors.tensor("touches").map_err(format_error)?;
    let (Dtype::F32, &[found, most, 3]) = (tensor.dtype(), tensor.shape()) else {
        return Err(wrong("touches that are not F32 [frame, touch, 3]"));
    };
    if found != frames {
        return Err(wrong("images and touches of different sizes"));
    }
    let values: Vec<f32> = floats_of(tensor.data()).collect();
    if values.iter().any(|v| v.is_infinite()) {
        return Err(wrong("touches that are infinite"));
    }
    ShardTouches::from_shape_vec((frames, most, 3), values)
        .map_err(|_| wrong("touches of another size"))
}

impl ShardData {
    fn from_tensors(tensors: &SafeTensors<'_>, frames: usize) -> Result<Self, DenoiseError> {
        let wrong = |what: &str| DenoiseError::Format { what: what.to_owned() };
        let tensor = |name: &str| match tensors.tensor(name) {
            Ok(tensor) if tensor.dtype() == Dtype::F32 => Ok(tensor),
            Ok(_) => Err(wrong("measurements that are not F32")),
            Err(e) => Err(format_error(e)),
        };
        let (differences, noise_std) = (tensor("differences")?, tensor("noise_std")?);
        let [found, measurements] = differences.shape() else {
            return Err(wrong("differences that are not [frame, measurement]"));
        };
        if *found != frames || noise_std.shape() != [*measurements] {
            return Err(wrong("images, differences and noise of different sizes"));
        }
        let values: Vec<f32> = floats_of(differences.data()).collect();
        let noise_std: Array1<f32> = floats_of(noise_std.data()).collect();
        if values.iter().any(|v| v.is_infinite()) || !noise_std.iter().all(|v| *v > 0.0) {
            return Err(wrong("differences that are infinite, or noise that is not positive"));
        }
        let differences = Array2::from_shape_vec((frames, *measurements), values)
            .map_err(|_| wrong("differences of another size"))?;
        Ok(Self { differences, noise_std })
    }
}
