//! Recognises the format of a file or folder: by content first, otherwise by file name ending.

use std::path::Path;

use super::files::file_names;
use super::serial_log::{self, SerialLogOptions};
use super::{black_sensor, khu, npy, text};
use crate::codec::text::line;
use crate::error::{HwError, Place};
use crate::recording::Format;

/// First bytes of files that are not read, what they are, and what to do.
const FOREIGN: [(&[u8], &str, &str); 3] = [
    (
        b"MATLAB 7.3",
        "a MATLAB file of version 7.3",
        "load it in MATLAB and write the matrix [frame, measurement] by save('frames.mat', 'v', '-v7')",
    ),
    (
        b"\x89HDF\r\n\x1a\n",
        "an HDF5 file",
        "write the matrix [frame, measurement] as NPY, in Python by numpy.save('frames.npy', h5py.File(FILE)[NAME])",
    ),
    (b"\xd0\xcf\x11\xe0", "an old Excel file", "save the sheet as CSV"),
];

/// First bytes of a zip archive.
const ZIP_MAGIC: &[u8] = b"PK\x03\x04";

/// Returns the format of a folder.
pub(super) fn folder(path: &Path) -> Result<Format, HwError> {
    let names = file_names(path)?;
    let sciospec = names.iter().any(|name| name.to_lowercase().ends_with(".eit"));
    let khu = names.iter().any(|name| name == khu::TABLE_NAME || khu::scan_number(name).is_some());
    match (sciospec, khu) {
        (true, false) => Ok(Format::Sciospec),
        (false, true) => Ok(Format::Khu),
        (true, true) => Err(ambiguous(path, Format::Sciospec, Format::Khu)),
        (false, false) => Err(unrecognised(path)),
    }
}

/// Returns the format of a file with this content.
pub(super) fn file(
    bytes: &[u8],
    path: &Path,
    log_options: &SerialLogOptions,
) -> Result<Format, HwError> {
    if bytes.is_empty() {
        return Err(HwError::Empty { place: Place::file(path) });
    }
    if bytes.starts_with(npy::MAGIC) {
        return Ok(Format::Npy);
    }
    if bytes.starts_with(super::MCAP_MAGIC) {
        return Ok(Format::Mcap);
    }
    if let Some((_, what, mend)) = FOREIGN.iter().find(|(magic, ..)| bytes.starts_with(magic)) {
        return Err(HwError::Foreign { place: Place::file(path), what, mend });
    }
    if bytes.starts_with(ZIP_MAGIC) {
        return Ok(Format::Npz);
    }
    if is_mat(bytes) {
        return Ok(Format::Mat);
    }
    if bytes.starts_with(b"#MEAS") {
        return Ok(Format::Lct);
    }
    if black_sensor::is_log(bytes) {
        return Ok(Format::BlackSensor);
    }
    if let Some(name) = path.file_name().and_then(|name| name.to_str())
        && khu::scan_number(name).is_some()
    {
        return Err(HwError::NotAFolder { place: Place::file(path), format: Format::Khu.name() });
    }
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("eit") => return Ok(Format::Sciospec),
        Some("get") => return Ok(Format::Goe),
        Some("npy") => return Ok(Format::Npy),
        Some("mat") => return Ok(Format::Mat),
        Some("csv") => return Ok(Format::Csv),
        _ => {}
    }
    let mut lines = bytes.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    if lines.any(serial_log::is_mark) {
        return Ok(Format::SerialLog);
    }
    let Ok(content) = text::decode(bytes, path) else { return Err(unrecognised(path)) };
    if serial_log::looks_like_unmarked(content, log_options) {
        return Err(ambiguous(path, Format::Csv, Format::SerialLog));
    }
    // anything that starts with numbers; the reader reports what is wrong further on
    let numbers = text::lines(content)
        .map(|(_, line)| line.split('#').next().unwrap_or_default().trim())
        .filter(|line| !line.is_empty())
        .take(2)
        .any(|line| line::numbers(line, |_| ()).is_ok());
    if numbers { Ok(Format::Csv) } else { Err(unrecognised(path)) }
}

/// Returns whether the header is that of a MATLAB file of version 5 in either byte order; its text is any.
fn is_mat(bytes: &[u8]) -> bool {
    matches!(bytes.get(124..128), Some([0, 1, b'I', b'M'] | [1, 0, b'M', b'I']))
}

fn unrecognised(path: &Path) -> HwError {
    HwError::Unrecognised { place: Place::file(path), known: Format::known() }
}

fn ambiguous(path: &Path, one: Format, other: Format) -> HwError {
    HwError::Ambiguous { place: Place::file(path), one: one.name(), other: other.name() }
}
