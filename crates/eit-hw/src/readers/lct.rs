//! LCT text of the University of Manchester: one frame per file.
//!
//! Header lines start with `#`; the last is `#Start`. Then follows a row `Vr Vi I` per measurement:
//! real and imaginary voltage and the current. The value is (Vr + i Vi) / I in ohms, since the
//! instrument drives a voltage and its current differs between drives. Some files repeat the last
//! row; the repeated row is dropped with a note. Order: per drive, the measured pairs ascending.

use std::path::Path;

use super::{text, wrong_field};
use crate::error::{HwError, Place, shortened};
use crate::recording::{Contents, Format, Layout, Note, Recording, Unit};

const MEND: &str = "export the file again";
/// Most measurements in the frame of a file; adjacent patterns of 256 electrodes have 64 768.
const MOST_ROWS: usize = 1 << 18;

/// Parses the content of an LCT file; `path` is used in messages only.
///
/// The layout is [`Layout::ProtocolOrder`], complex, in [`Unit::Ohm`].
///
/// # Errors
/// [`HwError`] for an empty or binary file, a header without `#MEAS`, `Length`, `Electrodes` and
/// `Operating_Frequency` or with inconsistent numbers, a row that is not three finite numbers, a
/// current of 0, or a number of rows other than `Length`.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Recording, HwError> {
    let content = text::decode(bytes, path)?;
    if !content.starts_with("#MEAS") {
        let text = shortened(content.lines().next().unwrap_or_default());
        return Err(field(path, 1, "first line", &text, "`#MEAS`"));
    }
    let header = Header::parse(content, path)?;
    let (mut real, mut imaginary, mut rows) = (Vec::new(), Vec::new(), 0);
    let (mut before, mut notes) = (None, Vec::new());
    for (line, content) in text::lines(content) {
        if content.starts_with('#') || content.trim().is_empty() {
            continue;
        }
        let row = text::numbers(content, line, path, MEND)?;
        if rows < header.length {
            let [x, y] = impedance(row, Place::line(path, line), rows)?;
            real.push(x);
            imaginary.push(y);
        } else if rows == header.length && before == Some(row) {
            notes.push(Note::RepeatedLastRow { line });
        }
        (before, rows) = (Some(row), rows + 1);
    }
    text::require_end(content, path)?;
    if rows != header.length + notes.len() {
        return Err(HwError::count(
            Place::file(path),
            "rows",
            [rows, header.length],
            "as in the header's `Length`: export the file again",
        ));
    }
    let (imaginary, value_count) = (Some(imaginary), header.length);
    let contents = Contents { real, imaginary, value_count, ..Contents::default() };
    let (layout, unit) = (Layout::ProtocolOrder, Unit::Ohm);
    let mut recording = Recording::new(contents, layout, unit, Format::Lct, path)?;
    recording.frequency_hz = Some(header.frequency_hz);
    recording.notes = notes;
    Ok(recording)
}

/// Returns (Vr + i Vi) / I of one row.
fn impedance(row: [f64; 3], place: Place, measurement: usize) -> Result<[f64; 2], HwError> {
    let [vr, vi, current] = row;
    if current == 0.0 {
        return Err(HwError::ZeroCurrent { place });
    }
    let quotient = [vr / current, vi / current];
    match row.into_iter().chain(quotient).find(|value| !value.is_finite()) {
        Some(value) => Err(HwError::NonFinite { place, frame: 0, measurement, value }),
        None => Ok(quotient),
    }
}

struct Header {
    length: usize,
    frequency_hz: f64,
}

impl Header {
    fn parse(content: &str, path: &Path) -> Result<Self, HwError> {
        let (mut length, mut electrodes, mut frequency_hz) = (None, None, None);
        let mut adjacent = false;
        for (line, content) in text::lines(content) {
            let Some(content) = content.strip_prefix('#') else { continue };
            if let Some(text) = value_of(content, "Length") {
                let whole = || field(path, line, "Length", text, "a whole number up to 262144");
                let count = text.parse::<usize>().ok().filter(|&count| count <= MOST_ROWS);
                length = Some(count.ok_or_else(whole)?);
            } else if let Some(text) = value_of(content, "Electrodes") {
                let whole = || field(path, line, "Electrodes", text, "a whole number from 4");
                let count = text.parse::<usize>().ok().filter(|&count| count >= 4);
                electrodes = Some((line, count.ok_or_else(whole)?));
            } else if let Some(text) = value_of(content, "Operating_Frequency") {
                let hertz = hertz(text)
                    .ok_or_else(|| field(path, line, "Operating_Frequency", text, "`10 , KHz`"))?;
                frequency_hz = Some(hertz);
            } else if let Some(text) = value_of(content, "Strategy") {
                adjacent = text.starts_with("Adjacent");
            }
        }
        let missing = |name| field(path, 1, name, "missing", "a header line of that name");
        let length: usize = length.ok_or_else(|| missing("Length"))?;
        let (line, electrodes) = electrodes.ok_or_else(|| missing("Electrodes"))?;
        if adjacent && electrodes.checked_mul(electrodes - 3) != Some(length) {
            let text = format!("{electrodes} with Length {length}");
            return Err(field(path, line, "Electrodes", &text, "Length = n (n - 3)"));
        }
        let frequency_hz = frequency_hz.ok_or_else(|| missing("Operating_Frequency"))?;
        Ok(Self { length, frequency_hz })
    }
}

/// Returns what follows `name` and an optional comma.
fn value_of<'a>(content: &'a str, name: &str) -> Option<&'a str> {
    let rest = content.strip_prefix(name)?;
    rest.starts_with([',', ' ']).then(|| rest.trim_start_matches([',', ' ']).trim_end())
}

/// Converts text such as `10 , KHz` to hertz.
fn hertz(text: &str) -> Option<f64> {
    let (number, unit) = text.split_once(',')?;
    let scale = match unit.trim() {
        "Hz" => 1.0,
        "KHz" | "kHz" => 1e3,
        "MHz" => 1e6,
        _ => return None,
    };
    let hertz = scale * number.trim().parse::<f64>().ok()?;
    (hertz.is_finite() && hertz >= 0.0).then_some(hertz)
}

fn field(
    path: &Path,
    line: usize,
    field: &'static str,
    text: &str,
    wanted: &'static str,
) -> HwError {
    wrong_field(Place::line(path, line), field, text, wanted, MEND)
}
