//! A training in a file: everything that the next epoch depends on.

use super::adam::Adam;
use super::{Engine, Epoch, TrainSettings, Trainer};
use crate::learning_base::write_whole;
use crate::unet::{bytes_of, floats_of, format_error};
use crate::{DenoiseError, UnetShape};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// Format that is written; others are refused.
const VERSION: u32 = 1;
const KEY: &str = "training";

/// All that is not an array; numbers as JSON, which gives `f64` back exactly.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    version: u32,
    base: String,
    history: usize,
    width: usize,
    depth: usize,
    seed: u64,
    epochs: usize,
    batch: usize,
    rate: f64,
    patience: usize,
    adam_steps: u64,
    /// epoch, train error, held-out error, rate
    curve: Vec<(usize, f64, f64, f64)>,
}

impl Trainer {
    /// Writes a checkpoint beside its place and renames it: a kill at any time leaves the one
    /// before.
    ///
    /// # Errors
    /// [`DenoiseError::Io`].
    pub fn save(&self, path: &Path) -> Result<(), DenoiseError> {
        let TrainSettings { shape, seed, epochs, batch, rate, patience } = self.settings;
        let UnetShape { history, width, depth } = shape;
        let line = |e: &Epoch| (e.epoch, e.train_error, e.held_out_error, e.rate);
        let curve = self.curve.iter().map(line).collect();
        let (base, adam_steps) = (self.base.clone(), self.adam.steps);
        let version = VERSION;
        let state = State {
            version,
            base,
            history,
            width,
            depth,
            seed,
            epochs,
            batch,
            rate,
            patience,
            adam_steps,
            curve,
        };
        let state = serde_json::to_string(&state)
            .map_err(|e| DenoiseError::Format { what: e.to_string() })?;
        let lists = [&self.parameters, &self.best, &self.adam.mean, &self.adam.square];
        let bytes = lists.map(|list| bytes_of(list));
        let mut tensors = Vec::new();
        for (name, bytes) in NAMES.into_iter().zip(&bytes) {
            let view = TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes);
            tensors.push((name, view.map_err(format_error)?));
        }
        let metadata = HashMap::from([(KEY.to_owned(), state)]);
        let file = safetensors::serialize(tensors, Some(metadata)).map_err(format_error)?;
        write_whole(path, &file)
    }

    /// Goes on from a checkpoint of the same settings and learning base, whichever engine made it.
    ///
    /// # Errors
    /// [`DenoiseError::Io`], [`DenoiseError::InFile`] for a damaged file,
    /// [`DenoiseError::OtherSettings`].
    pub fn resume(path: &Path, settings: &TrainSettings, base: &str) -> Result<Self, DenoiseError> {
        let bytes = std::fs::read(path).map_err(|e| DenoiseError::io(path, &e))?;
        Self::from_bytes(&bytes, settings, base).map_err(|e| e.in_file(path))
    }

    fn from_bytes(
        bytes: &[u8],
        settings: &TrainSettings,
        base: &str,
    ) -> Result<Self, DenoiseError> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(format_error)?;
        let wrong = |what: String| DenoiseError::Format { what };
        let state = header.metadata().as_ref().and_then(|m| m.get(KEY));
        let state = state.ok_or_else(|| wrong("no checkpoint of a training".to_owned()))?;
        let state: State = serde_json::from_str(state).map_err(|e| wrong(e.to_string()))?;
        if state.version != VERSION {
            let what = format!("version {} of the format, not {VERSION}", state.version);
            return Err(wrong(what));
        }
        let State { history, width, depth, seed, epochs, batch, rate, patience, .. } = state;
        let shape = UnetShape { history, width, depth };
        let found = TrainSettings { shape, seed, epochs, batch, rate, patience };
        if found != *settings {
            let (found, wanted) = (format!("{found:?}"), format!("{settings:?}"));
            return Err(DenoiseError::OtherSettings { what: "the training", found, wanted });
        }
        if state.base != base {
            let (found, wanted) = (state.base, base.to_owned());
            return Err(DenoiseError::OtherSettings { what: "the learning base", found, wanted });
        }
        settings.validate()?;
        let tensors = SafeTensors::deserialize(bytes).map_err(format_error)?;
        let wanted = shape.parameters();
        let list = |name: &str| {
            let tensor = tensors.tensor(name).map_err(format_error)?;
            let values: Vec<f32> = floats_of(tensor.data()).collect();
            match (tensor.dtype(), values.len()) {
                (Dtype::F32, found) if found == wanted => Ok(values),
                (_, found) => Err(DenoiseError::WrongLength { what: "weights", found, wanted }),
            }
        };
        let [parameters, best, mean, square] = NAMES.map(list);
        let adam = Adam { mean: mean?, square: square?, steps: state.adam_steps };
        let line = |&(epoch, train_error, held_out_error, rate): &(usize, f64, f64, f64)| Epoch {
            epoch,
            train_error,
            held_out_error,
            rate,
        };
        Ok(Self {
            settings: found,
            parameters: parameters?,
            adam,
            best: best?,
            curve: state.curve.iter().map(line).collect(),
            base: state.base,
            engine: Engine::default(),
        })
    }
}

/// Names of the arrays.
const NAMES: [&str; 4] = ["parameters", "best", "adam_mean", "adam_square"];
