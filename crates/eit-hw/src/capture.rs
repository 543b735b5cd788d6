//! Crash-safe recordings of a live instrument in MCAP (feature `mcap`).
//!
//! [MCAP](https://mcap.dev) is a container of time-stamped messages that names its own schemas, so
//! any MCAP tool shows a recording without this crate. Messages are JSON, in chunks with a CRC each,
//! compressed with LZ4, and the file ends with an index. A chunk is written at the latest one second
//! after its first message: whatever kills the program, all that came before the last second is
//! read back. docs/RECORDING.md has the schemas.

mod container;
mod entry;
mod json;
mod read;
mod record;
mod stream;
mod write;

pub use entry::Entry;
pub use read::{Capture, parse, read};
pub use record::{ReferenceRecord, SessionRecord, TouchRecord, TouchesRecord, UnitName};
pub use stream::{CaptureReader, Damage};
pub use write::{CaptureSettings, CaptureWriter};
