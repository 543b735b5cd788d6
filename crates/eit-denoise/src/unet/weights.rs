//! Weights of a net, in memory and in safetensors files, with their metadata.

use super::UnetShape;
use crate::{DenoiseError, ModelError};
use eit_core::event;
use ndarray::Array2;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use std::collections::BTreeMap;

/// Format version; others are rejected.
const VERSION: &str = "3";
/// Keys of the metadata that every file has.
const KEYS: [&str; 9] = [
    "format_version",
    "history",
    "width",
    "depth",
    "images",
    "conditions",
    "fold",
    "skin",
    "pixels",
];

/// Tensor of a model error, and the metadata that belong to it.
const MODEL_ERROR: &str = "model_error";
const MODEL_ERROR_KEYS: [&str; 2] = ["model_error_floor", "model_error_limit"];

/// A trained net.
///
/// ```
/// use eit_denoise::Weights;
///
/// let weights = Weights::paper_disc()?;
/// assert_eq!(weights.parameters.len(), weights.shape.parameters());
/// let again = Weights::from_bytes(&weights.to_bytes()?)?;
/// assert_eq!(again, weights);
/// # Ok::<(), eit_denoise::DenoiseError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Size of the net.
    pub shape: UnetShape,
    /// All parameters: for each convolution in the order in which they run (down, bottom, up, head) its
    /// weights [output, input, row, column], then its biases.
    pub parameters: Vec<f32>,
    /// Fingerprint of the skin that it was trained for: any text.
    pub skin: String,
    /// Rows and columns of the images that it was trained on.
    pub pixels: [usize; 2],
    /// Further metadata: learning base, seed, errors, program.
    pub about: BTreeMap<String, String>,
    /// Model error of the skin's data, if the training measured it.
    pub model_error: Option<ModelError>,
}

impl Weights {
    /// Weights for the skin of Duan, Taurand and Soleimani (the scene `paper-disc` of the command
    /// line) at 64 x 64 pixels; `weights/README.md` describes how they were made and how well
    /// they work.
    ///
    /// # Errors
    /// Those of [`Weights::from_bytes`], none of which the shipped file causes.
    pub fn paper_disc() -> Result<Self, DenoiseError> {
        Self::from_bytes(include_bytes!("../../weights/paper-disc.safetensors"))
    }

    /// Weights for the same skin that see the touches detected in each frame, beside the image: about three times as
    /// accurate. `eit-skin` uses them wherever touches are sought.
    ///
    /// # Errors
    /// Those of [`Weights::from_bytes`], none of which the shipped file causes.
    pub fn paper_disc_with_touches() -> Result<Self, DenoiseError> {
        Self::from_bytes(include_bytes!("../../weights/paper-disc-touches.safetensors"))
    }

    /// Weights of the paper's training 1: 439 pairs of the experiment with one finger, wanted images by
    /// [`ThresholdRule`](crate::ThresholdRule), images by equation (7). For `eit demo --paper`; the other shipped weights are
    /// better.
    ///
    /// # Errors
    /// Those of [`Weights::from_bytes`], none of which the shipped file causes.
    pub fn paper_training_1() -> Result<Self, DenoiseError> {
        Self::from_bytes(include_bytes!("../../weights/paper-training-1.safetensors"))
    }

    /// Weights of the paper's training 2: 273 pairs of the experiment with two fingers; else like
    /// [`Weights::paper_training_1`].
    ///
    /// # Errors
    /// Those of [`Weights::from_bytes`], none of which the shipped file causes.
    pub fn paper_training_2() -> Result<Self, DenoiseError> {
        Self::from_bytes(include_bytes!("../../weights/paper-training-2.safetensors"))
    }

    /// Rejects sizes outside the documented ranges, a wrong number of weights, and weights that are not
    /// finite.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`], [`DenoiseError::WrongLength`],
    /// [`DenoiseError::NonFiniteWeight`].
    pub fn validate(&self) -> Result<(), DenoiseError> {
        self.shape.validate()?;
        let wanted = self.shape.parameters();
        DenoiseError::check_length("weights", self.parameters.len(), wanted)?;
        match self.parameters.iter().position(|w| !w.is_finite()) {
            None => Ok(()),
            Some(index) => {
                let value = self.parameters[index];
                Err(DenoiseError::NonFiniteWeight { index, value })
            }
        }
    }

    /// Rejects weights for another skin or another number of pixels.
    ///
    /// # Errors
    /// [`DenoiseError::OtherSkin`].
    pub fn check_skin(&self, skin: &str, pixels: [usize; 2]) -> Result<(), DenoiseError> {
        if self.skin == skin && self.pixels == pixels {
            return Ok(());
        }
        Err(DenoiseError::OtherSkin {
            trained: self.skin.clone(),
            trained_pixels: self.pixels,
            asked: skin.to_owned(),
            asked_pixels: pixels,
        })
    }

    /// Returns the bytes of a safetensors file: `down.0.0.weight`, `down.0.0.bias`, ... and metadata.
    ///
    /// # Errors
    /// Those of [`Weights::validate`]; [`DenoiseError::Format`] if a key of `about` is reserved by the
    /// format.
    pub fn to_bytes(&self) -> Result<Vec<u8>, DenoiseError> {
        self.validate()?;
        let mut metadata = metadata(self.shape, &self.skin, self.pixels, &self.about)?;
        let bytes = bytes_of(&self.parameters);
        let mut at = 0;
        let directions;
        let mut tensors = Vec::new();
        for (name, shape) in self.shape.tensors() {
            let end = at + 4 * shape.iter().product::<usize>();
            let view = TensorView::new(Dtype::F32, shape, &bytes[at..end]);
            tensors.push((name, view.map_err(format_error)?));
            at = end;
        }
        if let Some(error) = &self.model_error {
            error.validate()?;
            directions = bytes_of(&error.directions);
            let numbers = [error.floor, error.limit].map(|value| value.to_string());
            metadata.extend(MODEL_ERROR_KEYS.map(str::to_owned).into_iter().zip(numbers));
            let shape = error.directions.shape().to_vec();
            let view = TensorView::new(Dtype::F32, shape, &directions).map_err(format_error)?;
            tensors.push((MODEL_ERROR.to_owned(), view));
        }
        let bytes = safetensors::serialize(tensors, None).map_err(format_error)?;
        with_metadata(&bytes, &metadata)
    }

    /// Reads a file written by [`Weights::to_bytes`].
    ///
    /// # Errors
    /// [`DenoiseError::Format`] for a truncated file, one of another kind or version, or one without one
    /// of the tensors; those of [`Weights::validate`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, DenoiseError> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(format_error)?;
        let mut about: BTreeMap<String, String> =
            header.metadata().clone().unwrap_or_default().into_iter().collect();
        let [version, history, width, depth, images, conditions, fold, skin, pixels] =
            KEYS.map(|key| {
                let what =
                    || format!("no \"{key}\" in its metadata: not the weights of this U-net");
                about.remove(key).ok_or_else(|| DenoiseError::format(what()))
            });
        let version = version?;
        if version != VERSION {
            let what = format!("version {version} of the format, this program reads {VERSION}");
            return Err(DenoiseError::format(what));
        }
        let shape = UnetShape {
            history: number(&history?)?,
            width: number(&width?)?,
            depth: number(&depth?)?,
            images: number(&images?)?,
            conditions: number(&conditions?)?,
            fold: number(&fold?)?,
        };
        shape.validate()?;
        let pixels = pixels?;
        let (rows, columns) = pixels.split_once('x').unwrap_or((&pixels, ""));
        let pixels = [number(rows)?, number(columns)?];
        let tensors = SafeTensors::deserialize(bytes).map_err(format_error)?;
        let mut parameters = Vec::with_capacity(shape.parameters());
        for (name, wanted) in shape.tensors() {
            let tensor = tensors.tensor(&name).map_err(format_error)?;
            let (dtype, found) = (tensor.dtype(), tensor.shape());
            if found != wanted || dtype != Dtype::F32 {
                let what =
                    format!("{name} is {dtype:?} {found:?}, but the net needs F32 {wanted:?}");
                return Err(DenoiseError::format(what));
            }
            parameters.extend(floats_of(tensor.data()));
        }
        let numbers = MODEL_ERROR_KEYS.map(|key| about.remove(key));
        let model_error = model_error(&tensors, numbers)?;
        let weights = Self { shape, parameters, skin: skin?, pixels, about, model_error };
        weights.validate()?;
        event!(
            DEBUG,
            "read the weights of the U-net",
            parameters = weights.parameters.len(),
            history = shape.history,
            rows = pixels[0],
            columns = pixels[1],
            has_model_error = weights.model_error.is_some(),
        );
        Ok(weights)
    }
}

/// The model error of a file, if it has one.
fn model_error(
    tensors: &SafeTensors<'_>,
    numbers: [Option<String>; 2],
) -> Result<Option<ModelError>, DenoiseError> {
    let [Some(floor), Some(limit)] = numbers else { return Ok(None) };
    let wrong = DenoiseError::format;
    let number = |text: String| {
        text.parse::<f64>().map_err(|_| wrong(format!("\"{text}\" in its metadata is no number")))
    };
    let tensor = tensors.tensor(MODEL_ERROR).map_err(format_error)?;
    let (Dtype::F32, &[rows, columns]) = (tensor.dtype(), tensor.shape()) else {
        return Err(wrong(format!("{MODEL_ERROR} is not F32 [direction, measurement]")));
    };
    let values = floats_of(tensor.data()).collect();
    let directions = Array2::from_shape_vec((rows, columns), values)
        .map_err(|e| wrong(format!("{MODEL_ERROR}: {e}")))?;
    let error = ModelError { directions, floor: number(floor)?, limit: number(limit)? };
    error.validate()?;
    Ok(Some(error))
}

/// Metadata of a file.
pub(crate) fn metadata(
    shape: UnetShape,
    skin: &str,
    pixels: [usize; 2],
    about: &BTreeMap<String, String>,
) -> Result<BTreeMap<String, String>, DenoiseError> {
    let UnetShape { history, width, depth, images, conditions, fold } = shape;
    let sizes = [history, width, depth, images, conditions, fold].map(|size| size.to_string());
    let pixels = format!("{}x{}", pixels[0], pixels[1]);
    let own = [VERSION.to_owned()].into_iter().chain(sizes).chain([skin.to_owned(), pixels]);
    let mut metadata = about.clone();
    for (key, value) in KEYS.into_iter().zip(own) {
        if metadata.insert(key.to_owned(), value).is_some() {
            return Err(DenoiseError::format(format!("the key \"{key}\" belongs to the format")));
        }
    }
    Ok(metadata)
}

/// Inserts metadata into the header of a file in the order of their keys, so that the same weights give the same bytes;
/// `safetensors` writes them in a random order.
fn with_metadata(
    bytes: &[u8],
    metadata: &BTreeMap<String, String>,
) -> Result<Vec<u8>, DenoiseError> {
    let wrong = |what: &dyn std::fmt::Display| DenoiseError::format(format!("its header: {what}"));
    // its length, then JSON padded with spaces to a multiple of eight bytes, then the tensors
    let (length, rest) = bytes.split_first_chunk::<8>().ok_or_else(|| wrong(&"too short"))?;
    let length = u64::from_le_bytes(*length) as usize;
    let (header, tensors) = rest.split_at_checked(length).ok_or_else(|| wrong(&"too short"))?;
    let rest = header.strip_prefix(b"{").ok_or_else(|| wrong(&"no object"))?;
    let mut header = b"{\"__metadata__\":".to_vec();
    serde_json::to_writer(&mut header, metadata).map_err(|e| wrong(&e))?;
    header.push(b',');
    header.extend(rest);
    header.resize(header.len().next_multiple_of(8), b' ');
    let length = (header.len() as u64).to_le_bytes();
    Ok([&length, &header[..], tensors].concat())
}

fn number(text: &str) -> Result<usize, DenoiseError> {
    let what = || format!("\"{text}\" in its metadata, where a whole number is wanted");
    text.parse().map_err(|_| DenoiseError::format(what()))
}

pub(crate) fn format_error(error: safetensors::SafeTensorError) -> DenoiseError {
    DenoiseError::format(error.to_string())
}

/// Little-endian bytes.
pub(crate) fn bytes_of<'a>(values: impl IntoIterator<Item = &'a f32>) -> Vec<u8> {
    values.into_iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Numbers of little-endian bytes.
pub(crate) fn floats_of(bytes: &[u8]) -> impl Iterator<Item = f32> {
    bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b))
}
