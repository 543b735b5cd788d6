//! NumPy `.npz` archives: a zip archive of `.npy` files, as `numpy.savez` and `savez_compressed`
//! write them.

use std::io::Read;
use std::path::Path;

use flate2::read::DeflateDecoder;
use rawzip::{CompressionMethod, ZipArchive, ZipArchiveEntryWayfinder, ZipSliceArchive};

use super::ReadOptions;
use super::arrays::{Listed, check_memory, choose};
use super::npy::{self, Header};
use crate::error::{HwError, Place};
use crate::recording::{Format, Recording};

/// Most bytes of a header of an array of numbers; NumPy writes 128.
const HEADER_BYTES: u64 = 4096;

/// Parses the content of an NPZ file; `path` is used in messages only. For the types that are read
/// see [`Format::Npy`].
///
/// # Errors
/// [`HwError`] for a damaged archive or array, [`HwError::Foreign`] for one without arrays, and those
/// of [`choose`] and [`Array::recording`](super::array::Array::recording).
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    options: &ReadOptions,
) -> Result<Recording, HwError> {
    let archive = ZipArchive::from_slice(bytes).map_err(|error| damaged(path, "", error))?;
    let (mut list, mut headers) = (Vec::new(), Vec::new());
    for entry in archive.entries() {
        let entry = entry.map_err(|error| damaged(path, "", error))?;
        let name = String::from_utf8_lossy(entry.file_path().as_ref()).into_owned();
        let Some(name) = name.strip_suffix(".npy").map(str::to_owned) else { continue };
        let packed = Packed { archive: &archive, at: entry.wayfinder(), path, name: &name };
        let mut start = Vec::new();
        let header = match packed.reader(entry.compression_method()) {
            Some(reader) => {
                let read = reader?.take(HEADER_BYTES).read_to_end(&mut start);
                read.map_err(|error| damaged(path, &name, error))?;
                Header::parse(&start, path).ok()
            }
            None => None,
        };
        let other = header.is_none().then_some("not of plain numbers");
        let shape = header.as_ref().map_or_else(Vec::new, |header| header.shape.clone());
        list.push(Listed { name, shape, other });
        headers.push((entry.wayfinder(), entry.compression_method(), header));
    }
    if list.is_empty() {
        return Err(HwError::Foreign {
            place: Place::file(path),
            what: "a zip archive without NumPy arrays, such as an Excel file (.xlsx)",
            mend: "save the sheet as CSV, or unpack the archive and name the file with the frames",
        });
    }
    let chosen = choose(&list, options, path)?;
    let name = list[chosen.index].name.as_str();
    let (at, method, Some(header)) = &headers[chosen.index] else {
        return Err(damaged(path, name, "its header is not read"));
    };
    let packed = Packed { archive: &archive, at: *at, path, name };
    let content = packed.content(*method, header, bytes)?;
    chosen.recording(npy::parse(&content, path)?, Format::Npz, options, path)
}

/// An entry of the archive.
struct Packed<'a> {
    archive: &'a ZipSliceArchive<&'a [u8]>,
    at: ZipArchiveEntryWayfinder,
    path: &'a Path,
    name: &'a str,
}

impl<'a> Packed<'a> {
    /// Returns a reader of the content, which compares checksums at its end; `None` for a method of
    /// compression that NumPy does not use.
    fn reader(&self, method: CompressionMethod) -> Option<Result<Box<dyn Read + 'a>, HwError>> {
        if ![CompressionMethod::STORE, CompressionMethod::DEFLATE].contains(&method) {
            return None;
        }
        let entry = match self.archive.get_entry(self.at) {
            Ok(entry) => entry,
            Err(error) => return Some(Err(damaged(self.path, self.name, error))),
        };
        Some(Ok(match method {
            CompressionMethod::STORE => Box::new(entry.verifying_reader(entry.data())),
            _ => Box::new(entry.verifying_reader(DeflateDecoder::new(entry.data()))),
        }))
    }

    /// Returns the content, which is as long as its header states.
    fn content(
        &self,
        method: CompressionMethod,
        header: &Header,
        file: &[u8],
    ) -> Result<Vec<u8>, HwError> {
        let unknown = || damaged(self.path, self.name, "its compression is not read");
        let mut reader = self.reader(method).ok_or_else(unknown)??;
        let parts = if header.complex { 2 } else { 1 };
        let data_bytes = header.data_bytes().unwrap_or(usize::MAX);
        let count = data_bytes / (parts * header.kind.size);
        check_memory(header.kind, data_bytes, [count, parts], file, self.path)?;
        let wanted = data_bytes + header.first_byte;
        let mut content = Vec::with_capacity(wanted + 1);
        // one more, so that the reader comes to its end and compares checksums
        let mut data = reader.by_ref().take(wanted as u64 + 1);
        data.read_to_end(&mut content).map_err(|error| damaged(self.path, self.name, error))?;
        Ok(content)
    }
}

fn damaged(path: &Path, name: &str, error: impl std::fmt::Display) -> HwError {
    HwError::damaged_array(Place::file(path), name, error)
}
