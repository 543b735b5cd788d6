//! Checkpoints: everything that the next epoch depends on. Net and optimiser are stored as burn's
//! records, each with its checksum, in a single file, so that a kill leaves all of them or none.

use super::Trainer;
use crate::learning_base::write_whole;
use crate::unet::format_error;
use crate::{DenoiseError, Epoch, ImageNet, TrainSettings};
use burn::store::{ModuleRecord, RecordError};
use burn::tensor::Bytes;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// Format version; others are rejected.
const VERSION: u32 = 3;
const KEY: &str = "training";
/// Names of the records.
const NAMES: [&str; 3] = ["net", "best", "optimiser"];

/// All state other than tensors; `f64` values survive JSON exactly.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    version: u32,
    base: String,
    /// [`ImageNet::name`].
    net: String,
    settings: TrainSettings,
    curve: Vec<Epoch>,
    /// Checksums of the records.
    crc32: [u32; 3],
}

/// Reads the version only, because other versions have other fields.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

fn record(error: RecordError) -> DenoiseError {
    DenoiseError::burn(&error)
}

impl<N: ImageNet> Trainer<N> {
    /// Writes a checkpoint to a temporary file and renames it, so that a kill at any time leaves the
    /// previous one.
    ///
    /// # Errors
    /// [`DenoiseError::Io`], [`DenoiseError::Burn`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), DenoiseError> {
        let path = path.as_ref();
        let records = [
            self.net.clone().into_record().into_bytes().map_err(record)?,
            self.best.clone().into_record().into_bytes().map_err(record)?,
            self.optimiser.into_bytes().map_err(record)?,
        ];
        let state = State {
            version: VERSION,
            base: self.base.clone(),
            net: self.net.name(),
            settings: self.settings.clone(),
            curve: self.curve.clone(),
            crc32: records.each_ref().map(|bytes| crc32fast::hash(bytes)),
        };
        let state =
            serde_json::to_string(&state).map_err(|e| DenoiseError::format(e.to_string()))?;
        let mut tensors = Vec::new();
        for (name, bytes) in NAMES.into_iter().zip(&records) {
            let view = TensorView::new(Dtype::U8, vec![bytes.len()], bytes);
            tensors.push((name, view.map_err(format_error)?));
        }
        let metadata = HashMap::from([(KEY.to_owned(), state)]);
        let file = safetensors::serialize(tensors, Some(metadata)).map_err(format_error)?;
        write_whole(path, &file)
    }

    /// Resumes from a checkpoint of a net of the same name with the same settings and learning base,
    /// whatever device wrote it. Training continues on the device of `net`; its weights are replaced.
    ///
    /// # Errors
    /// [`DenoiseError::Io`], [`DenoiseError::InFile`] for a damaged file,
    /// [`DenoiseError::OtherSettings`].
    pub fn resume(
        path: impl AsRef<Path>,
        net: N,
        settings: &TrainSettings,
        base: &str,
    ) -> Result<Self, DenoiseError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|e| DenoiseError::io(path, &e))?;
        Self::from_bytes(&bytes, net, settings, base).map_err(|e| e.in_file(path))
    }

    fn from_bytes(
        bytes: &[u8],
        net: N,
        settings: &TrainSettings,
        base: &str,
    ) -> Result<Self, DenoiseError> {
        let state = State::read(bytes)?;
        let differs = |what, found: String, wanted: String| {
            if found == wanted {
                return Ok(());
            }
            Err(DenoiseError::OtherSettings { what, found, wanted })
        };
        differs("the net", state.net, net.name())?;
        differs("the training", format!("{:?}", state.settings), format!("{settings:?}"))?;
        differs("the learning base", state.base, base.to_owned())?;
        let tensors = SafeTensors::deserialize(bytes).map_err(format_error)?;
        let mut records = Vec::new();
        for (name, wanted) in NAMES.into_iter().zip(state.crc32) {
            let bytes = tensors.tensor(name).map_err(format_error)?.data();
            let found = crc32fast::hash(bytes);
            if found != wanted {
                let what = format!("{name} has checksum {found:08x}, not {wanted:08x}");
                return Err(DenoiseError::format(what));
            }
            records.push(Bytes::from_bytes_vec(bytes.to_vec()));
        }
        let mut made = Self::new(net, settings, base)?;
        let [of_net, of_best, of_optimiser] = <[Bytes; 3]>::try_from(records)
            .map_err(|_| DenoiseError::format("a record is missing"))?;
        let read = |bytes| ModuleRecord::from_bytes(bytes).map_err(record);
        made.net = made.net.try_load_record(read(of_net)?).map_err(record)?;
        made.best = made.best.try_load_record(read(of_best)?).map_err(record)?;
        made.optimiser = made.optimiser.from_bytes(of_optimiser).map_err(record)?;
        made.curve = state.curve;
        Ok(made)
    }
}

impl State {
    fn read(bytes: &[u8]) -> Result<Self, DenoiseError> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(format_error)?;
        let text = header.metadata().as_ref().and_then(|m| m.get(KEY));
        let text = text.ok_or_else(|| DenoiseError::format("no checkpoint of a training"))?;
        let json = |e: serde_json::Error| DenoiseError::format(e.to_string());
        let Version { version } = serde_json::from_str(text).map_err(json)?;
        if version != VERSION {
            let what = format!("version {version} of the format, not {VERSION}");
            return Err(DenoiseError::format(what));
        }
        serde_json::from_str(text).map_err(json)
    }
}
