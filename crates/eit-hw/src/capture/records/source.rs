//! Random access to a file.

use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::unpack::MOST_CHUNK_BYTES;
use crate::error::{HwError, Place};

/// A file with random access, read mostly forwards.
#[derive(Debug)]
pub(super) struct Source<R> {
    from: R,
    path: PathBuf,
    /// Length of the file in bytes.
    pub(super) length: u64,
    /// Current position.
    at: u64,
}

impl<R: Read + Seek> Source<R> {
    pub(super) fn new(mut from: R, path: &Path) -> Result<Self, HwError> {
        let failed = |source| HwError::Read { place: Place::file(path), source };
        let length = from.seek(SeekFrom::End(0)).map_err(failed)?;
        from.seek(SeekFrom::Start(0)).map_err(failed)?;
        Ok(Self { from, path: path.to_path_buf(), length, at: 0 })
    }

    fn failed(&self, source: std::io::Error) -> HwError {
        HwError::Read { place: Place::file(&self.path), source }
    }

    /// Passes part of the file, such as an attachment, to `take` piece by piece.
    pub(super) fn copy<E: From<HwError>>(
        &mut self,
        place: Range<u64>,
        mut take: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut buffer = [0; 1 << 13];
        let mut at = place.start;
        while at < place.end {
            let wanted = usize::try_from(place.end - at).unwrap_or(usize::MAX).min(buffer.len());
            let found = self.read_at(at, &mut buffer[..wanted])?;
            if found == 0 {
                break;
            }
            take(&buffer[..found])?;
            at += found as u64;
        }
        Ok(())
    }

    /// Reads part of the file into memory, at most [`MOST_CHUNK_BYTES`].
    pub(super) fn held(&mut self, place: Range<u64>) -> Result<Vec<u8>, HwError> {
        let end = place.end.min(place.start + MOST_CHUNK_BYTES);
        let mut bytes = Vec::new();
        self.copy(place.start..end, |piece| {
            bytes.extend_from_slice(piece);
            Ok::<_, HwError>(())
        })?;
        Ok(bytes)
    }

    /// Replaces the content of `record` by that of a record in the file. The buffer grows as data
    /// are read, so a wrong length alone allocates nothing.
    pub(super) fn record(
        &mut self,
        place: Range<u64>,
        record: &mut Vec<u8>,
    ) -> Result<(), HwError> {
        self.seek(place.start)?;
        record.clear();
        let read = (&mut self.from).take(place.end - place.start).read_to_end(record);
        self.at += read.map_err(|source| self.failed(source))? as u64;
        Ok(())
    }

    fn seek(&mut self, to: u64) -> Result<(), HwError> {
        if self.at != to {
            // relative, so that the buffer is kept
            let step = to as i64 - self.at as i64;
            self.from.seek_relative(step).map_err(|source| self.failed(source))?;
            self.at = to;
        }
        Ok(())
    }

    /// Fills `bytes` from position `at`; returns the number read, which is lower at the end of the
    /// file.
    pub(super) fn read_at(&mut self, at: u64, bytes: &mut [u8]) -> Result<usize, HwError> {
        self.seek(at)?;
        let mut filled = 0;
        while filled < bytes.len() && at + (filled as u64) < self.length {
            let most = usize::try_from(self.length - at).unwrap_or(usize::MAX).min(bytes.len());
            match self.from.read(&mut bytes[filled..most]) {
                Ok(0) => break,
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(source) => return Err(self.failed(source)),
            }
        }
        self.at += filled as u64;
        Ok(filled)
    }
}
