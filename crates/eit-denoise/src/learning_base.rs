//! Pairs of raw and wanted images on disk: what a net learns from.
//!
//! A folder with one file per sequence ([`Shard`], safetensors) and `manifest.json`, which lists whole shards with their checksums. Shards
//! and manifest are written beside their place and renamed, the shard first: whenever the work is
//! killed, what the manifest lists is whole, and the rest is made again.

mod shard;

pub use shard::{Shard, ShardData};

use crate::DenoiseError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Format that is written; others are refused.
const VERSION: u32 = 2;
const MANIFEST: &str = "manifest.json";

/// What a learning base is made of. Two bases of equal settings hold equal bytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseSettings {
    /// Fingerprint of the skin, any text.
    pub skin: String,
    /// Rows and columns of the images.
    pub pixels: [usize; 2],
    /// Where all random numbers come from.
    pub seed: u64,
    /// Number of shards.
    pub shards: usize,
    /// Everything else that the pairs depend on, in words: method, scripts, ranges.
    pub recipe: String,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    version: u32,
    settings: BaseSettings,
    /// Whole shards by index.
    shards: BTreeMap<usize, Listed>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Listed {
    frames: usize,
    bytes: u64,
    crc32: u32,
}

/// A folder of shards.
#[derive(Debug, Clone)]
pub struct LearningBase {
    folder: PathBuf,
    manifest: Manifest,
}

impl LearningBase {
    /// Starts a base, or goes on with one of the same settings.
    ///
    /// # Errors
    /// [`DenoiseError::OtherSettings`] for a folder with another base, [`DenoiseError::Io`],
    /// [`DenoiseError::InFile`] for a damaged manifest.
    pub fn create(folder: &Path, settings: &BaseSettings) -> Result<Self, DenoiseError> {
        if settings.shards == 0 {
            let (quantity, must) = ("shards", "at least 1");
            return Err(DenoiseError::OutOfRange { quantity, value: 0.0, must });
        }
        std::fs::create_dir_all(folder).map_err(|e| DenoiseError::io(folder, &e))?;
        if folder.join(MANIFEST).exists() {
            let base = Self::open(folder)?;
            differing(&base.manifest.settings, settings).map_err(|e| e.in_file(folder))?;
            return Ok(base);
        }
        let manifest =
            Manifest { version: VERSION, settings: settings.clone(), shards: BTreeMap::new() };
        let base = Self { folder: folder.to_path_buf(), manifest };
        base.write_manifest()?;
        Ok(base)
    }

    /// Opens a base as it is; it may still lack shards.
    ///
    /// # Errors
    /// [`DenoiseError::Io`], [`DenoiseError::InFile`].
    pub fn open(folder: &Path) -> Result<Self, DenoiseError> {
        let path = folder.join(MANIFEST);
        let bytes = std::fs::read(&path).map_err(|e| DenoiseError::io(&path, &e))?;
        let format = |what: String| DenoiseError::Format { what }.in_file(&path);
        let manifest: Manifest =
            serde_json::from_slice(&bytes).map_err(|e| format(e.to_string()))?;
        if manifest.version != VERSION {
            let what = format!("version {} of the format, not {VERSION}", manifest.version);
            return Err(format(what));
        }
        Ok(Self { folder: folder.to_path_buf(), manifest })
    }

    /// What it is made of.
    pub fn settings(&self) -> &BaseSettings {
        &self.manifest.settings
    }

    /// Shards that are still to be made: never written, gone or damaged since.
    pub fn missing(&self) -> Vec<usize> {
        (0..self.manifest.settings.shards).filter(|&index| self.bytes(index).is_err()).collect()
    }

    /// Frames of all whole shards.
    pub fn frames(&self) -> usize {
        self.manifest.shards.values().map(|listed| listed.frames).sum()
    }

    /// Writes a shard and lists it.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`] for an index that the settings do not have,
    /// [`DenoiseError::ShapeMismatch`] for images of other pixels than theirs,
    /// [`DenoiseError::Io`].
    pub fn write(&mut self, index: usize, shard: &Shard) -> Result<(), DenoiseError> {
        let Manifest { settings, .. } = &self.manifest;
        if index >= settings.shards {
            let (quantity, must) = ("shard", "below the number of shards");
            return Err(DenoiseError::OutOfRange { quantity, value: index as f64, must });
        }
        let (frames, rows, columns) = shard.raw.dim();
        if [rows, columns] != settings.pixels {
            let (images, mask) = ([rows, columns], settings.pixels);
            return Err(DenoiseError::ShapeMismatch { images, mask });
        }
        let bytes = shard.to_bytes()?;
        write_whole(&self.path(index), &bytes)?;
        let listed = Listed { frames, bytes: bytes.len() as u64, crc32: crc32fast::hash(&bytes) };
        self.manifest.shards.insert(index, listed);
        self.write_manifest()
    }

    /// Reads a shard and checks it against the manifest.
    ///
    /// # Errors
    /// [`DenoiseError::DamagedShard`], [`DenoiseError::InFile`].
    pub fn read(&self, index: usize) -> Result<Shard, DenoiseError> {
        let bytes = self.bytes(index)?;
        Shard::from_bytes(&bytes).map_err(|e| e.in_file(&self.path(index)))
    }

    /// Checksum of settings and shards: bases of the same one hold the same pairs.
    pub fn checksum(&self) -> Result<String, DenoiseError> {
        let bytes = self.manifest_bytes()?;
        Ok(format!("{:08x}", crc32fast::hash(&bytes)))
    }

    fn bytes(&self, index: usize) -> Result<Vec<u8>, DenoiseError> {
        let path = self.path(index);
        let damaged =
            |found: String| DenoiseError::DamagedShard { path: path.display().to_string(), found };
        let Some(listed) = self.manifest.shards.get(&index) else {
            return Err(damaged("not made yet".to_owned()));
        };
        let bytes = std::fs::read(&path).map_err(|e| damaged(e.kind().to_string()))?;
        let crc32 = crc32fast::hash(&bytes);
        if bytes.len() as u64 != listed.bytes || crc32 != listed.crc32 {
            return Err(damaged(format!(
                "{} bytes with checksum {crc32:08x}, but {} with {:08x} were written",
                bytes.len(),
                listed.bytes,
                listed.crc32
            )));
        }
        Ok(bytes)
    }

    fn path(&self, index: usize) -> PathBuf {
        self.folder.join(format!("shard-{index:05}.safetensors"))
    }

    fn manifest_bytes(&self) -> Result<Vec<u8>, DenoiseError> {
        serde_json::to_vec_pretty(&self.manifest)
            .map_err(|e| DenoiseError::Format { what: e.to_string() })
    }

    fn write_manifest(&self) -> Result<(), DenoiseError> {
        write_whole(&self.folder.join(MANIFEST), &self.manifest_bytes()?)
    }
}

/// The first setting that differs.
fn differing(found: &BaseSettings, wanted: &BaseSettings) -> Result<(), DenoiseError> {
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

/// Writes a file beside its place and renames it.
///
/// # Errors
/// [`DenoiseError::Io`].
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), DenoiseError> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let failed = |e: &std::io::Error| DenoiseError::io(path, e);
    let mut builder = tempfile::Builder::new();
    builder.prefix(".eit-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        // temporary files are private by default; this becomes the user's ordinary file
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder).map_err(|e| failed(&e))?;
    file.write_all(bytes).map_err(|e| failed(&e))?;
    // on the disk before it has its name
    file.as_file().sync_all().map_err(|e| failed(&e))?;
    file.persist(path).map_err(|e| failed(&e.error))?;
    Ok(())
}
