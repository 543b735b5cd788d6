//! Crash-safe recordings of a live instrument in MCAP (feature `mcap`).
//!
//! [MCAP](https://mcap.dev) is a container of time-stamped messages that names its own schemas, so
//! any MCAP tool shows a recording without this crate. Messages are JSON, in chunks with a CRC each,
//! compressed with LZ4, and the file ends with an index. A chunk is written at the latest one second
//! after its first message: whatever kills the program, all that came before the last second is
//! read back. docs/RECORDING.md has the schemas.

mod container;
mod content;
mod entry;
mod json;
mod read;
mod record;
mod records;
mod recover;
mod stream;
mod unpack;
mod write;

pub use container::MAGIC;
pub use entry::Entry;
pub(crate) use read::read_frames;
pub use read::{Capture, parse, read};
pub use record::{ReferenceRecord, SessionRecord, TouchRecord, TouchesRecord, UnitName};
pub use recover::{Recovered, recover};
pub use stream::{CaptureReader, Damage, MessageTimes};
pub use write::{CaptureSettings, CaptureWriter, CutTail};
