//! Where the container writes to: memory, from which whole chunks go to the disk.

use std::io::{self, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes that the container has written and the disk has not, shared by both ends.
#[derive(Clone, Debug, Default)]
pub(super) struct Sink {
    pending: Arc<Mutex<Pending>>,
}

#[derive(Debug, Default)]
struct Pending {
    bytes: Vec<u8>,
    /// All bytes written so far.
    position: u64,
}

impl Sink {
    fn pending(&self) -> MutexGuard<'_, Pending> {
        // no code panics while it holds the lock
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `write` with what is pending, if anything is, and forgets it.
    pub(super) fn drain<T>(&self, write: impl FnOnce(&[u8]) -> T) -> Option<T> {
        let mut pending = self.pending();
        if pending.bytes.is_empty() {
            return None;
        }
        let result = write(&pending.bytes);
        pending.bytes.clear();
        Some(result)
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut pending = self.pending();
        pending.bytes.extend_from_slice(bytes);
        pending.position += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Sink {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = self.pending().position;
        match to {
            SeekFrom::Current(0) => Ok(position),
            // the container was told not to
            _ => Err(io::Error::from(io::ErrorKind::Unsupported)),
        }
    }
}
