//! The learning base: pairs of raw and wanted images on disk, from which a net learns.
//!
//! A folder with one file per sequence ([`Shard`], safetensors) and `manifest.json`, which lists
//! complete shards with their checksums. Each file is written under a temporary name and renamed,
//! shards before manifests: after a kill, every shard that a manifest lists is complete, and the others are
//! made again.
//!
//! Several processes or machines can fill one folder: each takes a [`Part`] and lists its shards
//! in a manifest of its own, `manifest.3-of-64.json`. Opening the folder combines all lists;
//! [`LearningBase::create`] without a part writes them as one `manifest.json`, byte for byte the one of a
//! base that was made by one process.

mod manifest;
mod shard;
mod whole_file;

pub use shard::{Beside, Shard, ShardData, ShardTouches};
pub(crate) use whole_file::write_whole;

use crate::DenoiseError;
use manifest::{Listed, MANIFEST, Manifest, differing, manifests};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Settings of a learning base. Two bases with equal settings hold equal bytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseSettings {
    /// Fingerprint of the skin: any text.
    pub skin: String,
    /// Rows and columns of the images.
    pub pixels: [usize; 2],
    /// Seed of all random numbers.
    pub seed: u64,
    /// Number of shards that the complete base has.
    pub shards: usize,
    /// Everything else that the pairs depend on, as text: method, scripts, ranges.
    pub recipe: String,
}

/// One of several parts of a learning base: the shards whose index has the remainder `number - 1` on
/// division by `count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    number: usize,
    count: usize,
}

impl Part {
    /// Part `number`, from 1, of `count`.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`].
    pub fn new(number: usize, count: usize) -> Result<Self, DenoiseError> {
        let (is_part, must) = ((1..=count).contains(&number), "from 1 to the number of parts");
        DenoiseError::check_range(is_part, "the number of a part", number as f64, must)?;
        Ok(Self { number, count })
    }

    /// Name of its manifest.
    fn manifest(self) -> String {
        format!("manifest.{}-of-{}.json", self.number, self.count)
    }

    /// Whether a shard belongs to it.
    pub fn contains(self, index: usize) -> bool {
        index % self.count == self.number - 1
    }
}

impl FromStr for Part {
    type Err = DenoiseError;

    /// `3/64`.
    fn from_str(text: &str) -> Result<Self, DenoiseError> {
        let what =
            || format!("\"{text}\" is no part: write its number and how many there are, as 3/64");
        let wrong = || DenoiseError::Format { what: what() };
        let (number, count) = text.split_once('/').ok_or_else(wrong)?;
        let parse = |text: &str| text.trim().parse::<usize>().map_err(|_| wrong());
        Self::new(parse(number)?, parse(count)?)
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

/// A folder of shards.
#[derive(Debug, Clone)]
pub struct LearningBase {
    folder: PathBuf,
    /// Settings, and the shards that this process lists.
    manifest: Manifest,
    /// Shards that other manifests list.
    others: BTreeMap<usize, Listed>,
    part: Option<Part>,
}

impl LearningBase {
    /// Starts a base, or continues one with the same settings, and merges the work of all parts.
    ///
    /// # Errors
    /// [`DenoiseError::OtherSettings`] for a folder with another base, [`DenoiseError::Io`],
    /// [`DenoiseError::InFile`] for a damaged manifest.
    pub fn create(folder: impl AsRef<Path>, settings: &BaseSettings) -> Result<Self, DenoiseError> {
        let folder = folder.as_ref();
        Self::start(folder, settings, None)
    }

    /// Starts or continues one part of a base, while other processes make the other parts.
    ///
    /// # Errors
    /// Those of [`LearningBase::create`].
    pub fn create_part(
        folder: impl AsRef<Path>,
        settings: &BaseSettings,
        part: Part,
    ) -> Result<Self, DenoiseError> {
        let folder = folder.as_ref();
        Self::start(folder, settings, Some(part))
    }

    fn start(
        folder: &Path,
        settings: &BaseSettings,
        part: Option<Part>,
    ) -> Result<Self, DenoiseError> {
        DenoiseError::check_range(settings.shards > 0, "shards", 0.0, "at least 1")?;
        std::fs::create_dir_all(folder).map_err(|e| DenoiseError::io(folder, &e))?;
        let own = match part {
            None => MANIFEST.to_owned(),
            Some(part) => part.manifest(),
        };
        let empty = Manifest::empty(settings.clone());
        let (mut manifest, mut others) = (empty, BTreeMap::new());
        for path in manifests(folder)? {
            let found = Manifest::read(&path)?;
            differing(&found.settings, settings).map_err(|e| e.in_file(&path))?;
            match path.file_name().is_some_and(|name| name == own.as_str()) {
                true => manifest.shards = found.shards,
                false => others.extend(found.shards),
            }
        }
        let mut base = Self { folder: folder.to_path_buf(), manifest, others, part };
        if part.is_none() {
            for (index, listed) in std::mem::take(&mut base.others) {
                base.manifest.shards.entry(index).or_insert(listed);
            }
        }
        base.write_manifest()?;
        Ok(base)
    }

    /// Opens a base as it is, with the work of all parts. Shards may still be missing.
    ///
    /// # Errors
    /// [`DenoiseError::Io`], [`DenoiseError::InFile`].
    pub fn open(folder: impl AsRef<Path>) -> Result<Self, DenoiseError> {
        let folder = folder.as_ref();
        let mut found = manifests(folder)?.into_iter();
        let first = found.next().unwrap_or_else(|| folder.join(MANIFEST));
        let mut manifest = Manifest::read(&first)?;
        for path in found {
            let other = Manifest::read(&path)?;
            differing(&other.settings, &manifest.settings).map_err(|e| e.in_file(&path))?;
            for (index, listed) in other.shards {
                manifest.shards.entry(index).or_insert(listed);
            }
        }
        Ok(Self { folder: folder.to_path_buf(), manifest, others: BTreeMap::new(), part: None })
    }

    /// Returns the settings that every shard was made with.
    pub fn settings(&self) -> &BaseSettings {
        &self.manifest.settings
    }

    /// Returns the shards still to be made (never written, lost or damaged), of this part if there is one.
    pub fn missing(&self) -> Vec<usize> {
        let own = |index: &usize| self.part.is_none_or(|part| part.contains(*index));
        let all = (0..self.manifest.settings.shards).filter(own);
        all.filter(|&index| self.bytes(index).is_err()).collect()
    }

    /// Returns the number of shards that the manifests list.
    pub fn complete(&self) -> usize {
        self.merged().shards.len()
    }

    /// Returns the number of frames in all complete shards.
    pub fn frames(&self) -> usize {
        self.merged().shards.values().map(|listed| listed.frames).sum()
    }

    fn merged(&self) -> Manifest {
        let mut merged = self.manifest.clone();
        for (index, listed) in &self.others {
            merged.shards.entry(*index).or_insert_with(|| listed.clone());
        }
        merged
    }

    /// Writes a shard, then lists it in the manifest.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`] for an index beyond the number of shards,
    /// [`DenoiseError::ShapeMismatch`] for images with another number of pixels,
    /// [`DenoiseError::Io`].
    pub fn write(&mut self, index: usize, shard: &Shard) -> Result<(), DenoiseError> {
        let Manifest { settings, .. } = &self.manifest;
        let must = "below the number of shards";
        DenoiseError::check_range(index < settings.shards, "shard", index as f64, must)?;
        let (frames, rows, columns) = shard.raw.dim();
        DenoiseError::check_size((rows, columns), settings.pixels.into())?;
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

    /// Returns a checksum of settings and shards: bases with equal checksums hold equal pairs.
    ///
    /// # Errors
    /// [`DenoiseError::Format`] if the settings cannot be encoded.
    pub fn checksum(&self) -> Result<String, DenoiseError> {
        Ok(format!("{:08x}", crc32fast::hash(&self.merged().to_bytes()?)))
    }

    fn bytes(&self, index: usize) -> Result<Vec<u8>, DenoiseError> {
        let path = self.path(index);
        let damaged =
            |found: String| DenoiseError::DamagedShard { path: path.display().to_string(), found };
        let listed = self.manifest.shards.get(&index).or_else(|| self.others.get(&index));
        let Some(listed) = listed else {
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

    fn write_manifest(&self) -> Result<(), DenoiseError> {
        let name = match self.part {
            None => MANIFEST.to_owned(),
            Some(part) => part.manifest(),
        };
        write_whole(&self.folder.join(name), &self.manifest.to_bytes()?)
    }
}
