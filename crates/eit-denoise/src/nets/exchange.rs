//! One file format for both: burn reads and writes the weights of [`crate::Denoiser`].

use super::Unet;
use crate::unet::metadata;
use crate::{DenoiseError, Weights};
use burn::store::{ModuleSnapshot as _, SafetensorsStore};
use burn::tensor::Device;
use std::collections::BTreeMap;

impl Unet {
    /// Loads a weights file, including the shipped ones, with burn's SafeTensors store. A model error in the
    /// file is left out.
    ///
    /// # Errors
    /// Those of [`Weights::from_bytes`], and [`DenoiseError::Burn`].
    pub fn from_bytes(bytes: &[u8], device: &Device) -> Result<Self, DenoiseError> {
        let weights = Weights::from_bytes(bytes)?;
        Self::from_weights(&weights, device)
    }

    /// Converts weights in memory.
    ///
    /// # Errors
    /// Those of [`Weights::to_bytes`], and [`DenoiseError::Burn`].
    pub fn from_weights(weights: &Weights, device: &Device) -> Result<Self, DenoiseError> {
        // burn's module has no place for the model error
        let net = Weights { model_error: None, ..weights.clone() };
        Self::load(weights, net.to_bytes()?, device)
    }

    fn load(weights: &Weights, bytes: Vec<u8>, device: &Device) -> Result<Self, DenoiseError> {
        let mut unet = Self::zeros(weights.shape, device)?;
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

    /// Returns the bytes of a weights file, written by burn's SafeTensors store. Tensors, names and
    /// metadata are those of [`Weights::to_bytes`].
    ///
    /// # Errors
    /// [`DenoiseError::Burn`]; [`DenoiseError::Format`] if a key of `about` is reserved by the format.
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

    /// Converts it to weights for [`crate::Denoiser`], without a [`Weights::model_error`], which a module does
    /// not hold: set it again from the weights that it was loaded from.
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
