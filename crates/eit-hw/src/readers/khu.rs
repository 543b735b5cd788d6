//! KHU Mark2.5: a folder of scans with the table of projections.
//!
//! `ProjectionTableSendLog.txt` has a row per projection and channel, of which the reader takes
//! `ProjIndex`, `Ch`, `ChInfo` (2 = source, 3 = sink) and the gain code `Gain1`. `NScan.txt` is
//! frame N: rows `channel overflow real imaginary` in counts, projection after projection.
//!
//! Volt = count / (2^15 gain) with gain = code 40 / 200. A record with its overflow flag set is
//! flagged [`Quality::SATURATED`] and keeps its value.
//!
//! Sign: the voltmeter of a channel lies between it and the channel before. In every projection of
//! the recordings at hand the record of the source is negative and that of the sink positive, while
//! a passive body has its highest potential at the source. So the value is the potential of the
//! channel before minus that of the channel: the quadruple is [source, sink, channel - 1, channel].

mod table_log;

use std::path::Path;

use super::{Format, file_bytes, file_names, missing_numbers, table, text};
use crate::error::{HwError, Place};
use crate::frame::Quality;
use crate::recording::{Layout, Recording, Unit};
pub use table_log::ProjectionTable;

/// Name of the file with the projections.
pub(super) const TABLE_NAME: &str = "ProjectionTableSendLog.txt";

const RECORD: &str =
    "a record is `channel overflow real imaginary`: copy the file anew or move it away";

/// Counts of the full scale.
const FULL_SCALE: f64 = 32_768.0;

/// Reads a folder of scans in the order of their numbers.
///
/// The layout is [`Layout::Quadruples`], complex, in [`Unit::Volt`].
///
/// # Errors
/// [`HwError`], see [`ProjectionTable::parse`] and [`parse_scan`]; where a file cannot be read or
/// the table or every scan is missing.
pub fn read(path: &Path) -> Result<Recording, HwError> {
    if path.is_file() {
        return Err(HwError::NotAFolder { place: Place::file(path), format: Format::Khu.name() });
    }
    let names = file_names(path)?;
    let missing =
        |name| HwError::MissingFile { place: Place::file(path), name, format: Format::Khu.name() };
    if !names.iter().any(|name| name == TABLE_NAME) {
        return Err(missing(TABLE_NAME));
    }
    let table_path = path.join(TABLE_NAME);
    let table = ProjectionTable::parse(&file_bytes(&table_path, Format::Khu.name())?, &table_path)?;
    let mut scans: Vec<_> =
        names.iter().filter_map(|name| Some((scan_number(name)?, name))).collect();
    scans.sort();
    if scans.is_empty() {
        return Err(missing("1Scan.txt"));
    }
    let (mut real, mut imaginary, mut quality) = (Vec::new(), Vec::new(), Vec::new());
    for (_, name) in &scans {
        let path = path.join(name);
        let scan = parse_scan(&file_bytes(&path, Format::Khu.name())?, &path, &table)?;
        real.extend(scan.real);
        imaginary.extend(scan.imaginary);
        quality.extend(scan.quality);
    }
    let values = table.quadruples.len();
    let real = table::frames(real, values, path, 0)?;
    let imaginary = table::frames(imaginary, values, path, 0)?;
    let layout = Layout::Quadruples(table.quadruples);
    let mut recording =
        Recording::new(real, Some(imaginary), layout, Unit::Volt, Format::Khu, path);
    for (slot, flags) in recording.quality.iter_mut().zip(quality) {
        *slot = flags;
    }
    recording.notes.extend(missing_numbers(scans.iter().map(|(number, _)| *number)));
    Ok(recording)
}

/// N of `NScan.txt` or `N Scan.txt`.
pub(super) fn scan_number(name: &str) -> Option<u64> {
    name.strip_suffix("Scan.txt")?.trim_end().parse().ok()
}

/// One scan in volt, in the order of [`ProjectionTable::quadruples`].
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// Real parts.
    pub real: Vec<f64>,
    /// Imaginary parts.
    pub imaginary: Vec<f64>,
    /// [`Quality::SATURATED`] where the overflow flag is set, [`Quality::NON_FINITE`] where a count
    /// is NaN or infinite.
    pub quality: Vec<Quality>,
}

impl Scan {
    /// Appends a record of counts.
    fn push(&mut self, [overflow, real, imaginary]: [f64; 3], gain: f64) {
        let mut quality = Quality::GOOD;
        if overflow != 0.0 {
            quality |= Quality::SATURATED;
        }
        if !(real.is_finite() && imaginary.is_finite()) {
            quality |= Quality::NON_FINITE;
        }
        self.real.push(real / (FULL_SCALE * gain));
        self.imaginary.push(imaginary / (FULL_SCALE * gain));
        self.quality.push(quality);
    }
}

/// The scan of a file with this content; `path` is for messages.
///
/// # Errors
/// [`HwError`] for an empty or binary file, a row that is not four numbers, a channel out of order,
/// and another number of rows than the table has (a file of mixed frequencies has three times as
/// many and is not read).
pub fn parse_scan(bytes: &[u8], path: &Path, table: &ProjectionTable) -> Result<Scan, HwError> {
    let content = text::decode(bytes, path)?;
    let wanted = table.quadruples.len();
    let mut scan = Scan { real: Vec::new(), imaginary: Vec::new(), quality: Vec::new() };
    let mut rows = 0;
    for (line, content) in text::lines(content) {
        if content.trim().is_empty() {
            continue;
        }
        // rows beyond the table are only counted
        if let Some(gain) = table.gains.get(rows) {
            let [channel, overflow, real, imaginary] = text::numbers(content, line, path, RECORD)?;
            let expected = rows % table.channels;
            if channel != expected as f64 {
                return Err(HwError::Field {
                    place: Place::line(path, line),
                    field: "channel",
                    text: format!("{channel} where {expected} follows"),
                    wanted: "every channel of a projection in order",
                    mend: "the file is cut or damaged: copy it anew or move it away",
                });
            }
            scan.push([overflow, real, imaginary], *gain);
        }
        rows += 1;
    }
    if rows == wanted {
        text::require_end(content, path)?;
        return Ok(scan);
    }
    Err(HwError::Count {
        place: Place::file(path),
        what: "records",
        found: rows,
        wanted,
        mend: "the projection table says so: copy the file anew or move it away",
    })
}
