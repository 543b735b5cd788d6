//! The list of a base's complete shards, `manifest.json`.

use super::BaseSettings;
use crate::DenoiseError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Format version; others are rejected.
const VERSION: u32 = 2;
pub(super) const MANIFEST: &str = "manifest.json";

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    version: u32,
    pub settings: BaseSettings,
    /// Complete shards by index.
    pub shards: BTreeMap<usize, Listed>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Listed {
    pub frames: usize,
    pub bytes: u64,
    pub crc32: u32,
}

impl Manifest {
    pub(super) fn empty(settings: BaseSettings) -> Self {
        Self { version: VERSION, settings, shards: BTreeMap::new() }
    }

    pub(super) fn read(path: &Path) -> Result<Self, DenoiseError> {
        let bytes = std::fs::read(path).map_err(|e| DenoiseError::io(path, &e))?;
        let format = |what: String| DenoiseError::format(what).in_file(path);
        let manifest: Self = serde_json::from_slice(&bytes).map_err(|e| format(e.to_string()))?;
        if manifest.version != VERSION {
            let what = format!("version {} of the format, not {VERSION}", manifest.version);
            return Err(format(what));
        }
        Ok(manifest)
    }

    pub(super) fn to_bytes(&self) -> Result<Vec<u8>, DenoiseError> {
        serde_json::to_vec_pretty(self).map_err(|e| DenoiseError::format(e.to_string()))
    }
}

/// The manifests of a folder in the order of their names, the whole base's first where it is there.
pub(super) fn manifests(folder: &Path) -> Result<Vec<PathBuf>, DenoiseError> {
    let failed = |e: &std::io::Error| DenoiseError::io(folder, e);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| failed(&e))? {
        let path = entry.map_err(|e| failed(&e))?.path();
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
        let is_manifest = |name: &str| {
            name == MANIFEST
                || name.strip_prefix("manifest.").is_some_and(|rest| rest.ends_with(".json"))
        };
        if name.as_deref().is_some_and(is_manifest) {
            found.push(path);
        }
    }
    found.sort_by_key(|path| (!path.ends_with(MANIFEST), path.clone()));
    Ok(found)
}

/// Rejects other settings, naming the first that differs.
pub(super) fn differing(found: &BaseSettings, wanted: &BaseSettings) -> Result<(), DenoiseError> {
    let text = |s: &BaseSettings| {
        [
            s.skin.clone(),
            format!("{} x {}", s.pixels[0], s.pixels[1]),
            s.seed.to_string(),
            s.shards.to_string(),
            s.recipe.clone(),
        ]
    };
    let names =
        ["the skin", "the number of pixels", "the seed", "the number of shards", "the recipe"];
    for ((what, found), wanted) in names.into_iter().zip(text(found)).zip(text(wanted)) {
        if found != wanted {
            return Err(DenoiseError::OtherSettings { what, found, wanted });
        }
    }
    Ok(())
}
