//! The same file for both: what burn writes is read by [`crate::Denoiser`], and the other way round.

use super::unet::{Unet, UnetConfig};
use crate::unet::metadata;
use crate::{DenoiseError, Weights};
use burn::store::{ModuleSnapshot as _, SafetensorsStore};
use burn::tensor::Device;
use std::collections::BTreeMap;

impl Unet {
    /// Loads a file of weights, the shipped ones too, through burn's SafeTensors store.
    ///
    /// # Errors
    /// Those of [`Weights::from_bytes`], and [`DenoiseError::Burn`].
    pub fn from_bytes(bytes: &[u8], device: &Device) -> Result<Self, DenoiseError> {
        let weights = Weights::from_bytes(bytes)?;
        Self::load(&weights, bytes.to_vec(), device)
    }

    /// Loads weights in memory.
    ///
    /// # Errors
    /// Those of [`Weights::to_bytes`], and [`DenoiseError::Burn`].
    pub fn from_weights(weights: &Weights, device: &Device) -> Result<Self, DenoiseError> {
        Self::load(weights, weights.to_bytes()?, device)
    }

    fn load(weights: &Weights, bytes: Vec<u8>, device: &Device) -> Result<Self, DenoiseError> {
        let mut unet = UnetConfig::from(weights.shape).zeros(device)?;
        let mut store = SafetensorsStore::from_bytes(Some(bytes));
        let applied = unet.load_from(&mut store).map_err(|e| DenoiseError::burn(&e))?;
        match applied.unused.first() {
            None => Ok(unet),
            Some(name) => {
                let what = format!("the net has no tensor called \"{name}\"");
                Err(DenoiseError::Format { what })
            }
        }
    }

    /// The bytes of a file of weights, written by burn's SafeTensors store: tensors, names and
    /// metadata are those of [`Weights::to_bytes`].
    ///
    /// # Errors
    /// [`DenoiseError::Burn`]; [`DenoiseError::Format`] where a key of `about` is one of the format's
    /// own.
    pub fn to_bytes(
        &self,
        skin: &str,
        pixels: [usize; 2],
        about: &BTreeMap<String, String>,
    ) -> Result<Vec<u8>, DenoiseError> {
        let mut store = SafetensorsStore::from_bytes(None).clear_metadata();
        for (key, value) in metadata(self.shape(), skin, pixels, about)? {
            store = store.metadata(key, value);
        }
        self.save_into(&mut store).map_err(|e| DenoiseError::burn(&e))?;
        store.get_bytes().map_err(|e| DenoiseError::burn(&e))
    }

    /// Its weights for [`crate::Denoiser`].
    ///
    /// # Errors
    /// Those of [`Unet::to_bytes`] and [`Weights::from_bytes`].
    pub fn to_weights(
        &self,
        skin: &str,
        pixels: [usize; 2],
        about: &BTreeMap<String, String>,
    ) -> Result<Weights, DenoiseError> {
        Weights::from_bytes(&self.to_bytes(skin, pixels, about)?)
    }
}
