//! One sequence of training pairs, in memory and in a safetensors file.

use crate::unet::{bytes_of, floats_of, format_error};
use crate::{DenoiseError, Denoiser, ImageStack};
use ndarray::{
    Array, Array1, Array2, Array3, ArrayD, ArrayView2, ArrayView3, Axis, Dimension, Ix1, Ix2, Ix3,
};
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
        DenoiseError::check_mask(wanted.mask(), raw.mask())?;
        DenoiseError::check_length("wanted images", wanted.frames(), raw.frames())?;
        if raw.max_abs() == 0.0 {
            return Err(DenoiseError::NothingToLearn { what: "the sequence".to_owned() });
        }
        let inside =
            |stack: &ImageStack| stack.values().mapv(|v| if v.is_nan() { 0.0 } else { v as f32 });
        Ok(Self {
            raw: inside(raw),
            wanted: inside(wanted),
            mask: raw.mask().to_owned(),
            data: None,
            touches: None,
            beside: Beside::default(),
        })
    }

    /// Returns the pairs of these frames, in this order; further inputs of a net are left out.
    pub fn of_frames(&self, frames: &[usize]) -> Self {
        let data = self.data.as_ref().map(|data| ShardData {
            differences: data.differences.select(Axis(0), frames),
            noise_std: data.noise_std.clone(),
        });
        Self {
            raw: self.raw.select(Axis(0), frames),
            wanted: self.wanted.select(Axis(0), frames),
            mask: self.mask.clone(),
            data,
            touches: self.touches.as_ref().map(|touches| touches.select(Axis(0), frames)),
            beside: Beside::default(),
        }
    }

    /// Denoises its raw images with a net that also takes the further inputs.
    ///
    /// # Errors
    /// Those of [`Denoiser::denoise_with`] and of [`ImageStack::new`].
    pub fn denoise(&self, net: &mut Denoiser) -> Result<ImageStack, DenoiseError> {
        self.through(|raw, others, conditions| net.denoise_with(raw, others, conditions))
    }

    /// Runs a net on its images and conditions.
    pub(crate) fn through(
        &self,
        run: impl FnOnce(
            &ImageStack,
            &[ArrayView3<'_, f64>],
            Option<ArrayView2<'_, f64>>,
        ) -> Result<ImageStack, DenoiseError>,
    ) -> Result<ImageStack, DenoiseError> {
        let mut all = self.images().map(|images| images.mapv(f64::from));
        let raw = ImageStack::new(all.next().unwrap_or_default(), self.mask.clone())?;
        let others: Vec<_> = all.collect();
        let others: Vec<_> = others.iter().map(|images| images.view()).collect();
        let conditions = self.beside.conditions.as_ref().map(|c| c.mapv(f64::from));
        run(&raw, &others, conditions.as_ref().map(|c| c.view()))
    }

    /// Images [frame, row, column] in the order in which a net takes them; the first sets the scale.
    pub(crate) fn images(&self) -> impl Iterator<Item = &Array3<f32>> {
        let Beside { first, images, .. } = &self.beside;
        first.iter().chain([&self.raw]).chain(images)
    }

    /// Returns the number of images and of conditions per frame; an error if their lengths differ from
    /// the raw images'.
    pub(crate) fn inputs(&self) -> Result<[usize; 2], DenoiseError> {
        let (frames, conditions) = (self.raw.dim().0, &self.beside.conditions);
        if let Some(other) = self.images().find(|other| other.dim() != self.raw.dim()) {
            let (what, found) = ("frames of other images", other.dim().0);
            return Err(DenoiseError::WrongLength { what, found, wanted: frames });
        }
        let [found, count] = conditions.as_ref().map_or([frames, 0], |c| [c.nrows(), c.ncols()]);
        DenoiseError::check_length("frames of conditions", found, frames)?;
        Ok([self.images().count(), count])
    }

    /// Returns the bytes of its file: `raw`, `wanted` [frame, row, column], `mask` [row, column], and, if
    /// known, `differences` [frame, measurement], `noise_std` [measurement] and `touches` [frame, touch, 3].
    pub(super) fn to_bytes(&self) -> Result<Vec<u8>, DenoiseError> {
        let mask: Vec<u8> = self.mask.iter().map(|inside| u8::from(*inside)).collect();
        let mut parts = vec![
            ("raw", self.raw.shape(), bytes_of(&self.raw)),
            ("wanted", self.wanted.shape(), bytes_of(&self.wanted)),
        ];
        if let Some(ShardData { differences, noise_std }) = &self.data {
            parts.push(("differences", differences.shape(), bytes_of(differences)));
            parts.push(("noise_std", noise_std.shape(), bytes_of(noise_std)));
        }
        let touches = self.touches.as_ref();
        parts.extend(touches.map(|touches| ("touches", touches.shape(), bytes_of(touches))));
        let view = |dtype, shape: &[usize], bytes| TensorView::new(dtype, shape.to_vec(), bytes);
        let floats =
            parts.iter().map(|(name, shape, bytes)| (*name, view(Dtype::F32, shape, bytes)));
        let all = floats.chain([("mask", view(Dtype::U8, self.mask.shape(), &mask))]);
        let tensors: Result<Vec<_>, _> = all.map(|(name, view)| Ok((name, view?))).collect();
        safetensors::serialize(tensors.map_err(format_error)?, None).map_err(format_error)
    }

    pub(super) fn from_bytes(bytes: &[u8]) -> Result<Self, DenoiseError> {
        let tensors = SafeTensors::deserialize(bytes).map_err(format_error)?;
        let wrong = DenoiseError::format;
        let images = |name| floats::<Ix3>(&tensors, name, "[frame, row, column]");
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
        let has = |name: &str| tensors.names().contains(&name);
        let data = has("differences").then(|| ShardData::from_tensors(&tensors, frames));
        let touches = has("touches").then(|| touches_of(&tensors, frames));
        let (data, touches) = (data.transpose()?, touches.transpose()?);
        Ok(Self { raw, wanted, mask, data, touches, beside: Beside::default() })
    }
}

/// Reads a tensor of numbers; `axes` names them in errors.
fn floats<D: Dimension>(
    tensors: &SafeTensors<'_>,
    name: &str,
    axes: &str,
) -> Result<Array<f32, D>, DenoiseError> {
    let tensor = tensors.tensor(name).map_err(format_error)?;
    let values = floats_of(tensor.data()).collect();
    let found = ArrayD::from_shape_vec(tensor.shape(), values).ok();
    let found = found.filter(|_| tensor.dtype() == Dtype::F32);
    found
        .and_then(|found| found.into_dimensionality().ok())
        .ok_or_else(|| DenoiseError::format(format!("{name} that are not F32 {axes}")))
}

fn touches_of(tensors: &SafeTensors<'_>, frames: usize) -> Result<ShardTouches, DenoiseError> {
    let touches = floats::<Ix3>(tensors, "touches", "[frame, touch, 3]")?;
    if touches.dim().0 != frames || touches.dim().2 != 3 {
        return Err(DenoiseError::format("images and touches of different sizes"));
    }
    if touches.iter().any(|v| v.is_infinite()) {
        return Err(DenoiseError::format("touches that are infinite"));
    }
    Ok(touches)
}

impl ShardData {
    fn from_tensors(tensors: &SafeTensors<'_>, frames: usize) -> Result<Self, DenoiseError> {
        let differences = floats::<Ix2>(tensors, "differences", "[frame, measurement]")?;
        let noise_std = floats::<Ix1>(tensors, "noise_std", "[measurement]")?;
        if differences.nrows() != frames || noise_std.len() != differences.ncols() {
            let what = "images, differences and noise of different sizes";
            return Err(DenoiseError::format(what));
        }
        if differences.iter().any(|v| v.is_infinite()) || !noise_std.iter().all(|v| *v > 0.0) {
            let what = "differences that are infinite, or noise that is not positive";
            return Err(DenoiseError::format(what));
        }
        Ok(Self { differences, noise_std })
    }
}
