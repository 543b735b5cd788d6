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
//!
//! Over 300 lines because parts, manifests and shards on disk are one format.

mod shard;

pub use shard::{Beside, Shard, ShardData, ShardTouches};

use crate::DenoiseError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Format version; others are rejected.
const VERSION: u32 = 2;
const MANIFEST: &str = "manifest.json";

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

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    version: u32,
    settings: BaseSettings,
    /// Complete shards by index.
    shards: BTreeMap<usize, Listed>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Listed {
    frames: usize,
    bytes: u64,
    crc32: u32,
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
        if number == 0 || number > count {
            let (quantity, must) = ("the number of a part", "from 1 to the number of parts");
            return Err(DenoiseError::OutOfRange { quantity, value: number as f64, must });
        }
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
        if settings.shards == 0 {
            let (quantity, must) = ("shards", "at least 1");
            return Err(DenoiseError::OutOfRange { quantity, value: 0.0, must });
        }
        std::fs::create_dir_all(folder).map_err(|e| DenoiseError::io(folder, &e))?;
        let own = match part {
            None => MANIFEST.to_owned(),
            Some(part) => part.manifest(),
        };
        let empty =
            Manifest { version: VERSION, settings: settings.clone(), shards: BTreeMap::new() };
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

impl Manifest {
    fn read(path: &Path) -> Result<Self, DenoiseError> {
        let bytes = std::fs::read(path).map_err(|e| DenoiseError::io(path, &e))?;
        let format = |what: String| DenoiseError::Format { what }.in_file(path);
        let manifest: Self = serde_json::from_slice(&bytes).map_err(|e| format(e.to_string()))?;
        if manifest.version != VERSION {
            let what = format!("version {} of the format, not {VERSION}", manifest.version);
            return Err(format(what));
        }
        Ok(manifest)
    }

    fn to_bytes(&self) -> Result<Vec<u8>, DenoiseError> {
        serde_json::to_vec_pretty(self).map_err(|e| DenoiseError::Format { what: e.to_string() })
    }
}

/// The manifests of a folder in the order of their names, the whole base's first where it is there.
fn manifests(folder: &Path) -> Result<Vec<PathBuf>, DenoiseError> {
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

/// Writes a temporary file and renames it. A program that is killed meanwhile leaves the temporary file,
/// which the next one that writes the same file replaces.
///
/// # Errors
/// [`DenoiseError::Io`].
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), DenoiseError> {
    let failed = |e: &std::io::Error| DenoiseError::io(path, e);
    let (mut file, temporary) = temporary_of(path).map_err(|e| failed(&e))?;
    // flushed to the disk before it gets its name
    let written = file
        .write_all(bytes)
        .and_then(|()| file.sync_all())
        .and_then(|()| std::fs::rename(&temporary, path));
    written.map_err(|e| {
        // created above; the first error matters more
        let _ = std::fs::remove_file(&temporary);
        failed(&e)
    })
}

/// Creates the temporary file of a file, `.eit-NAME`, or with a number if another program is writing one.
fn temporary_of(path: &Path) -> std::io::Result<(File, PathBuf)> {
    for number in 0_u32.. {
        let mut name = std::ffi::OsString::from(".eit-");
        name.push(path.file_name().unwrap_or_default());
        if number > 0 {
            name.push(format!(".{number}"));
        }
        let place = path.with_file_name(name);
        match File::options().write(true).create_new(true).open(&place) {
            Ok(file) => {
                // where there are no locks, nobody takes it for one that was left
                let _ = file.try_lock();
                return Ok((file, place));
            }
            Err(e) if e.kind() != std::io::ErrorKind::AlreadyExists => return Err(e),
            Err(_) => {
                let left = File::open(&place).is_ok_and(|file| file.try_lock().is_ok());
                if left {
                    std::fs::remove_file(&place)?;
                    let file = File::options().write(true).create_new(true).open(&place)?;
                    let _ = file.try_lock();
                    return Ok((file, place));
                }
            }
        }
    }
    Err(std::io::ErrorKind::AlreadyExists.into())
}
