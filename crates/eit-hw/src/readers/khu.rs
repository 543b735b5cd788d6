//! KHU Mark2.5: a folder of scans with a projection table.
//!
//! `ProjectionTableSendLog.txt` has a row per projection and channel, of which the reader uses
//! `ProjIndex`, `Ch`, `ChInfo` (2 = source, 3 = sink) and the gain code `Gain1`. `NScan.txt` is
//! frame N: rows `channel overflow real imaginary` in counts, projection after projection.
//!
//! Volt = count / (2^15 gain) with gain = code 40 / 200. A record whose overflow flag is set keeps
//! its value and is flagged [`Quality::SATURATED`].
//!
//! Sign: the voltmeter of a channel lies between it and the previous channel. In every projection
//! of the recordings at hand the record of the source is negative and that of the sink positive,
//! while a passive body has its highest potential at the source. The value is therefore the
//! potential of the previous channel minus that of the channel: the quadruple is [source, sink,
//! channel - 1, channel].

mod table_log;

use std::path::Path;

use super::files::{file_bytes, file_names, missing_numbers};
use super::text;
use crate::error::{HwError, Place};
use crate::frame::Quality;
use crate::recording::{Contents, Format, Layout, Recording, Unit};
use table_log::ProjectionTable;

/// File that lists the electrodes and gain of every record.
pub(super) const TABLE_NAME: &str = "ProjectionTableSendLog.txt";

const RECORD: &str =
    "a record is `channel overflow real imaginary`: copy the file again or remove it";

/// Count at full scale.
const FULL_SCALE: f64 = 32_768.0;

/// Reads a folder of scans in the order of their numbers.
///
/// The layout is [`Layout::Quadruples`], complex, in [`Unit::Volt`].
///
/// # Errors
/// [`HwError`] if
/// - a file cannot be read, is empty or binary, or the table or every scan is missing;
/// - a table row lacks columns or a field is not a whole number, a gain code is outside 1 to 255,
///   or a projection lacks channels, has them out of order, or does not have exactly one source and
///   one sink;
/// - a scan row is not four numbers, a channel is out of order, or the number of rows differs from
///   the table (files of mixed frequencies have three times as many and are not supported).
pub(super) fn read(path: &Path) -> Result<Recording, HwError> {
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
    let values = table.quadruples.len();
    let size = scans.len() * values;
    let (mut real, mut imaginary) = (Vec::with_capacity(size), Vec::with_capacity(size));
    let mut quality = Vec::with_capacity(size);
    for (_, name) in &scans {
        let path = path.join(name);
        let scan = parse_scan(&file_bytes(&path, Format::Khu.name())?, &path, &table)?;
        real.extend(scan.real);
        imaginary.extend(scan.imaginary);
        quality.extend(scan.quality);
    }
    let contents = Contents {
        real,
        imaginary: Some(imaginary),
        quality: Some(quality),
        value_count: values,
        ..Contents::default()
    };
    let layout = Layout::Quadruples(table.quadruples);
    let mut recording = Recording::new(contents, layout, Unit::Volt, Format::Khu, path)?;
    recording.notes.extend(missing_numbers(scans.iter().map(|(number, _)| *number)));
    Ok(recording)
}

/// Returns N of `NScan.txt` or `N Scan.txt`.
pub(super) fn scan_number(name: &str) -> Option<u64> {
    name.strip_suffix("Scan.txt")?.trim_end().parse().ok()
}

/// One scan in volts, in the order of [`ProjectionTable::quadruples`].
#[derive(Debug)]
struct Scan {
    real: Vec<f64>,
    imaginary: Vec<f64>,
    /// [`Quality::SATURATED`] if the overflow flag is set, [`Quality::NON_FINITE`] if a count is
    /// NaN or infinite.
    quality: Vec<Quality>,
}

impl Scan {
    /// Adds one record.
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

/// Parses the content of a scan file; `path` is used in messages only.
fn parse_scan(bytes: &[u8], path: &Path, table: &ProjectionTable) -> Result<Scan, HwError> {
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
                    text: format!("{channel} instead of {expected}"),
                    wanted: "every channel of a projection in order",
                    mend: "the file is truncated or damaged: copy it again or remove it",
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
    Err(HwError::count(
        Place::file(path),
        "records",
        [rows, wanted],
        "as in the projection table: copy the file again or remove it",
    ))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TABLE: &[u8] = b"0 0 0 2 3 1 128 1 128 1\n0 1 0 3 3 1 128 1 128 232\n";
    const SCAN: &[u8] = b"0 1 25000.000 -3\n1 0 4 5\n";

    fn table() -> ProjectionTable {
        ProjectionTable::parse(TABLE, Path::new("t")).unwrap()
    }

    /// Parses the bytes as table and as scan: results are consistent, errors are one line.
    fn parse_both(bytes: &[u8]) {
        let path = Path::new("f");
        let mut tables = vec![table()];
        match ProjectionTable::parse(bytes, path) {
            Ok(table) => {
                assert!(table.channels > 0 && !table.gains.is_empty());
                assert_eq!(table.quadruples.len(), table.gains.len());
                tables.push(table);
            }
            Err(error) => assert!(!error.to_string().contains('\n')),
        }
        for table in tables {
            match parse_scan(bytes, path, &table) {
                Ok(scan) => assert_eq!(scan.real.len(), table.quadruples.len()),
                Err(error) => assert!(!error.to_string().contains('\n')),
            }
        }
    }

    proptest! {
        #![proptest_config(fixtures::cases(256))]

        #[test]
        fn arbitrary_bytes_do_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
            parse_both(&bytes);
        }

        #[test]
        fn arbitrary_text_does_no_harm(text in "[0-9.+eEnainf \t\r\n-]{0,300}") {
            parse_both(text.as_bytes());
        }

        #[test]
        fn damaged_files_do_no_harm(
            scan in any::<bool>(),
            edits in prop::collection::vec((any::<usize>(), any::<u8>(), 0..3_u8), 1..6),
        ) {
            let mut bytes = if scan { SCAN } else { TABLE }.to_vec();
            for (at, byte, kind) in edits {
                let at = at % bytes.len().max(1);
                match kind {
                    0 if at < bytes.len() => bytes[at] = byte,
                    1 => bytes.truncate(at),
                    _ => bytes.insert(at, byte),
                }
            }
            parse_both(&bytes);
        }

        #[test]
        fn a_scan_is_read_back(
            counts in prop::collection::vec((any::<i16>(), any::<i16>(), any::<bool>()), 2),
        ) {
            let text: String = counts
                .iter()
                .enumerate()
                .map(|(channel, (re, im, over))| {
                    format!("{channel}\t{}\t{re}.000000\t{im}.0\t\r\n", u8::from(*over))
                })
                .collect();
            let scan = parse_scan(text.as_bytes(), Path::new("1Scan.txt"), &table()).unwrap();
            for (channel, (re, im, over)) in counts.into_iter().enumerate() {
                let gain = [1.0, 232.0][channel] * 0.2;
                prop_assert_eq!(scan.real[channel], f64::from(re) / (32768.0 * gain));
                prop_assert_eq!(scan.imaginary[channel], f64::from(im) / (32768.0 * gain));
                prop_assert_eq!(scan.quality[channel].is_good(), !over);
            }
        }
    }

    #[test]
    fn samples_are_read() {
        assert_eq!(table().quadruples, [[0, 1, 1, 0], [0, 1, 0, 1]]);
        assert!(parse_scan(SCAN, Path::new("1Scan.txt"), &table()).is_ok());
    }
}
