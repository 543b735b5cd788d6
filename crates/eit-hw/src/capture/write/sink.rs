//! The writer's target: a buffer in memory, from which complete chunks go to the disk.

use std::io::{self, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes that the container has written and the disk does not have yet, shared by both ends.
#[derive(Clone, Debug, Default)]
pub(super) struct Sink {
    pending: Arc<Mutex<Pending>>,
}

#[derive(Debug, Default)]
struct Pending {
    bytes: Vec<u8>,
    /// Number of bytes written so far.
    position: u64,
}

impl Sink {
    fn pending(&self) -> MutexGuard<'_, Pending> {
        // nothing panics while it holds the lock
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Passes pending bytes, if there are any, to `write` and then discards them.
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
            // the container was set not to seek
            _ => Err(io::Error::from(io::ErrorKind::Unsupported)),
        }
    }
}
