//! The file of a learnt skin: a JSON line with format, version and checksum, then a JSON line with the
//! content.

mod check;

use super::{Frame, HeldOut, LearnedSkin, PlacesBy};
use crate::error::SkinError;
use crate::scene::read_file_of;
use eit_inverse::learn::{ForceCurve, MapSettings, Orientation, Presses};
use eit_inverse::touch::Stated;
use ndarray::Array2;
use serde::{Deserialize, Serialize};
use std::path::Path;

const FORMAT: &str = "eit learned skin";
/// Version that is written; other versions are rejected.
const VERSION: u32 = 2;
/// Maximum file size; a thousand presses of a thousand measurements take twenty megabytes.
const MOST_BYTES: u64 = 512 << 20;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    format: String,
    version: u32,
    crc32: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    skin: String,
    measurements: usize,
    channels: Vec<usize>,
    levels: Vec<f64>,
    interval_s: f64,
    bell_m: f64,
    frame: Frame,
    shift_m: [f64; 3],
    orientation: Orientation,
    places_m: Vec<[f64; 3]>,
    forces_n: Vec<Option<f64>>,
    /// Session of each press; absent if all were made in one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    sessions: Vec<u32>,
    /// Changes, `[press][channel]`, volts.
    frames: Vec<Vec<f64>>,
    /// The untouched skin before each press, likewise.
    untouched: Vec<Vec<f64>>,
    map: MapSettings,
    stated: Stated,
    places_by: PlacesBy,
    held_out: HeldOut,
    force: Option<ForceCurve>,
}

impl LearnedSkin {
    /// Serialises the learnt skin to the bytes of a file.
    ///
    /// # Errors
    ///
    /// Numbers that are not finite.
    pub fn to_bytes(&self) -> Result<Vec<u8>, SkinError> {
        let failed = |e: serde_json::Error| SkinError::Failure(format!("learnt skin: {e}"));
        let content = self.content();
        // JSON would write non-finite numbers as null
        content.check().map_err(|e| SkinError::Failure(format!("learnt skin: {e}")))?;
        let content = serde_json::to_string(&content).map_err(failed)?;
        let crc32 = format!("{:08x}", crc32fast::hash(content.as_bytes()));
        let header = Header { format: FORMAT.to_owned(), version: VERSION, crc32 };
        let header = serde_json::to_string(&header).map_err(failed)?;
        Ok(format!("{header}\n{content}\n").into_bytes())
    }

    /// Writes the file, which has its name once it is complete.
    ///
    /// # Errors
    ///
    /// Numbers that are not finite, and a file that cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), SkinError> {
        let path = path.as_ref();
        let bytes = self.to_bytes()?;
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let written = std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path));
        written.map_err(|error| SkinError::at(path, error))
    }

    /// Reads a file written by [`LearnedSkin::to_bytes`].
    ///
    /// # Errors
    ///
    /// A file that cannot be read, is not in this format, has another version or is damaged.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, SkinError> {
        let path = path.as_ref();
        let bytes = read_file_of(path, MOST_BYTES)?;
        Self::from_bytes(&bytes).map_err(|e| e.within(&path.display().to_string()))
    }

    /// Parses the bytes of such a file.
    ///
    /// # Errors
    ///
    /// As [`LearnedSkin::read`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SkinError> {
        let none = || SkinError::input("not a file of `eit learn`");
        let text = std::str::from_utf8(bytes).map_err(|_| none())?;
        let (header, content) = text.split_once('\n').ok_or_else(none)?;
        let header: Header = serde_json::from_str(header).map_err(|_| none())?;
        if header.format != FORMAT {
            return Err(none());
        }
        if header.version != VERSION {
            return Err(SkinError::input(format!(
                "version {} of the format; this program reads version {VERSION}: learn again",
                header.version
            )));
        }
        let content = content.strip_suffix('\n').unwrap_or(content);
        let crc32 = format!("{:08x}", crc32fast::hash(content.as_bytes()));
        if crc32 != header.crc32 {
            return Err(SkinError::input(format!(
                "damaged: its checksum is {crc32}, but it states {}",
                header.crc32
            )));
        }
        let content: Content =
            serde_json::from_str(content).map_err(|e| SkinError::input(format!("content: {e}")))?;
        content.check()?;
        content.learned()
    }

    fn content(&self) -> Content {
        let rows = |of: &Array2<f64>| of.rows().into_iter().map(|row| row.to_vec()).collect();
        Content {
            skin: self.fingerprint.clone(),
            measurements: self.measurements,
            channels: self.channels.clone(),
            levels: self.levels.clone(),
            interval_s: self.interval_s,
            bell_m: self.bell_m,
            frame: self.frame,
            shift_m: self.shift_m,
            orientation: self.orientation,
            places_m: self.presses.places_m.clone(),
            forces_n: self.forces_n.clone(),
            sessions: self.presses.sessions.clone(),
            frames: rows(&self.presses.frames),
            untouched: rows(&self.untouched),
            map: self.map,
            stated: self.stated,
            places_by: self.places_by,
            held_out: self.held_out,
            force: self.force.clone(),
        }
    }
}

impl Content {
    fn learned(self) -> Result<LearnedSkin, SkinError> {
        let shape = (self.places_m.len(), self.channels.len());
        let rows = |of: Vec<Vec<f64>>| {
            Array2::from_shape_vec(shape, of.concat())
                .map_err(|e| SkinError::input(format!("content: {e}")))
        };
        Ok(LearnedSkin {
            fingerprint: self.skin,
            measurements: self.measurements,
            channels: self.channels,
            levels: self.levels,
            untouched: rows(self.untouched)?,
            interval_s: self.interval_s,
            bell_m: self.bell_m,
            frame: self.frame,
            shift_m: self.shift_m,
            orientation: self.orientation,
            presses: Presses {
                frames: rows(self.frames)?,
                places_m: self.places_m,
                sessions: self.sessions,
            },
            forces_n: self.forces_n,
            map: self.map,
            stated: self.stated,
            places_by: self.places_by,
            held_out: self.held_out,
            force: self.force,
        })
    }
}
