//! Weights of a net, in memory and as safetensors with what they were made of.

use super::UnetShape;
use crate::DenoiseError;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use std::collections::{BTreeMap, HashMap};

/// Format that is written; others are refused.
const VERSION: &str = "1";
/// Keys of the metadata that every file has.
const KEYS: [&str; 6] = ["format_version", "history", "width", "depth", "skin", "pixels"];

const MISFIT_LIMIT: &str = "misfit_limit";

/// A trained net.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Its size.
    pub shape: UnetShape,
    /// All numbers: the convolutions in the order in which they run (down, bottom, up, head), each
    /// its weights [output, input, row, column], then its biases.
    pub parameters: Vec<f32>,
    /// Fingerprint of the skin that it was trained for, any text.
    pub skin: String,
    /// Rows and columns of the images that it was trained on.
    pub pixels: [usize; 2],
    /// What else is known: learning base, seed, errors, commit.
    pub about: BTreeMap<String, String>,
}

impl Weights {
    /// Weights for the skin of Duan, Taurand and Soleimani (the scene `paper-disc` of the command
    /// line) at 64 x 64 pixels; `weights/README.md` tells how they were made and what they are
    /// worth.
    ///
    /// # Errors
    /// None that can come up: those of [`Weights::from_bytes`].
    pub fn paper_disc() -> Result<Self, DenoiseError> {
        Self::from_bytes(include_bytes!("../../weights/paper-disc.safetensors"))
    }

    /// Refuses a size that is not documented, a wrong number of weights, and weights that are not
    /// finite.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`], [`DenoiseError::WrongLength`],
    /// [`DenoiseError::NonFiniteWeight`].
    pub fn validate(&self) -> Result<(), DenoiseError> {
        self.shape.validate()?;
        let (found, wanted) = (self.parameters.len(), self.shape.parameters());
        if found != wanted {
            return Err(DenoiseError::WrongLength { what: "weights", found, wanted });
        }
        match self.parameters.iter().position(|w| !w.is_finite()) {
            None => Ok(()),
            Some(index) => {
                let value = self.parameters[index];
                Err(DenoiseError::NonFiniteWeight { index, value })
            }
        }
    }

    /// Refuses the weights of another skin, or of other pixels.
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

    /// The part of the measurements' energy that known images of this net leave unexplained, for
    /// [`crate::DataMisfit::score`], where the training measured it: `misfit_limit` of `about`.
    pub fn misfit_limit(&self) -> Option<f64> {
        let limit: f64 = self.about.get(MISFIT_LIMIT)?.parse().ok()?;
        // an empty image leaves all: from 1 on the limit would believe it
        (limit > 0.0 && limit < 1.0).then_some(limit)
    }

    /// The bytes of a safetensors file: `down.0.0.weight`, `down.0.0.bias`, ... with the metadata.
    ///
    /// # Errors
    /// Those of [`Weights::validate`]; [`DenoiseError::Format`] where a key of `about` is one of the
    /// format's own.
    pub fn to_bytes(&self) -> Result<Vec<u8>, DenoiseError> {
        self.validate()?;
        let metadata = metadata(self.shape, &self.skin, self.pixels, &self.about)?;
        let bytes = bytes_of(&self.parameters);
        let mut at = 0;
        let mut tensors = Vec::new();
        for (name, c) in self.shape.names().into_iter().zip(self.shape.convolutions()) {
            let parts = [
                (format!("{name}.weight"), vec![c.outputs, c.inputs, c.side, c.side]),
                (format!("{name}.bias"), vec![c.outputs]),
            ];
            for (name, shape) in parts {
                let end = at + 4 * shape.iter().product::<usize>();
                let view = TensorView::new(Dtype::F32, shape, &bytes[at..end]);
                tensors.push((name, view.map_err(format_error)?));
                at = end;
            }
        }
        safetensors::serialize(tensors, Some(metadata)).map_err(format_error)
    }

    /// Reads what [`Weights::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`DenoiseError::Format`] for a file that is cut, of another kind or another version, or that
    /// lacks a tensor; those of [`Weights::validate`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, DenoiseError> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(format_error)?;
        let mut about: BTreeMap<String, String> =
            header.metadata().clone().unwrap_or_default().into_iter().collect();
        let mut take = |key: &str| {
            about.remove(key).ok_or_else(|| DenoiseError::Format {
                what: format!("no \"{key}\" in its metadata: not the weights of this U-net"),
            })
        };
        let [version, history, width, depth, skin, pixels] = KEYS.map(&mut take);
        let version = version?;
        if version != VERSION {
            let what = format!("version {version} of the format, this program reads {VERSION}");
            return Err(DenoiseError::Format { what });
        }
        let shape = UnetShape {
            history: number(&history?)?,
            width: number(&width?)?,
            depth: number(&depth?)?,
        };
        shape.validate()?;
        let pixels = pixels?;
        let (rows, columns) = pixels.split_once('x').unwrap_or((&pixels, ""));
        let pixels = [number(rows)?, number(columns)?];
        let tensors = SafeTensors::deserialize(bytes).map_err(format_error)?;
        let mut parameters = Vec::with_capacity(shape.parameters());
        for (name, c) in shape.names().into_iter().zip(shape.convolutions()) {
            let parts = [
                (format!("{name}.weight"), vec![c.outputs, c.inputs, c.side, c.side]),
                (format!("{name}.bias"), vec![c.outputs]),
            ];
            for (name, wanted) in parts {
                let tensor = tensors.tensor(&name).map_err(format_error)?;
                if tensor.shape() != wanted || tensor.dtype() != Dtype::F32 {
                    let what = format!(
                        "{name} is {:?} {:?}, but the net needs F32 {wanted:?}",
                        tensor.dtype(),
                        tensor.shape()
                    );
                    return Err(DenoiseError::Format { what });
                }
                parameters.extend(floats_of(tensor.data()));
            }
        }
        let weights = Self { shape, parameters, skin: skin?, pixels, about };
        weights.validate()?;
        Ok(weights)
    }
}

/// What stands beside the tensors of a file.
pub(crate) fn metadata(
    shape: UnetShape,
    skin: &str,
    pixels: [usize; 2],
    about: &BTreeMap<String, String>,
) -> Result<HashMap<String, String>, DenoiseError> {
    let own = [
        VERSION.to_owned(),
        shape.history.to_string(),
        shape.width.to_string(),
        shape.depth.to_string(),
        skin.to_owned(),
        format!("{}x{}", pixels[0], pixels[1]),
    ];
    let mut metadata: HashMap<String, String> =
        about.iter().map(|(k, v)| (k.clone(), v.clone())).collect();
    for (key, value) in KEYS.into_iter().zip(own) {
        if metadata.insert(key.to_owned(), value).is_some() {
            let what = format!("the key \"{key}\" belongs to the format");
            return Err(DenoiseError::Format { what });
        }
    }
    Ok(metadata)
}

fn number(text: &str) -> Result<usize, DenoiseError> {
    let what = || format!("\"{text}\" in its metadata, where a whole number is wanted");
    text.parse().map_err(|_| DenoiseError::Format { what: what() })
}

pub(crate) fn format_error(error: safetensors::SafeTensorError) -> DenoiseError {
    DenoiseError::Format { what: error.to_string() }
}

/// Little-endian bytes.
pub(crate) fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Numbers of little-endian bytes.
pub(crate) fn floats_of(bytes: &[u8]) -> impl Iterator<Item = f32> {
    bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b))
}
