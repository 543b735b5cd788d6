//! Crash-safe recordings of a live instrument in MCAP (feature `mcap`).
//!
//! [MCAP](https://mcap.dev) is a container for time-stamped messages that stores its own schemas,
//! so any MCAP tool can open a recording without this crate. Messages are JSON, grouped into chunks
//! that are compressed with LZ4 and carry a CRC each; the file ends with an index. A chunk is
//! written at most one second after its first message, so a program that is killed loses at most
//! its last second. docs/RECORDING.md lists the schemas.

mod container;
mod entry;
mod json;
mod parts;
mod read;
mod record;
mod recorder;
mod records;
mod recover;
mod scene;
mod stream;
mod write;

pub use container::MAGIC;
pub use entry::Entry;
pub use parts::{check_new, files, is_recording};
pub(crate) use read::read_frames;
pub use read::{Capture, SameSetUp, parse, read};
pub use record::{ReferenceRecord, SessionRecord, TouchesRecord, UnitName};
pub use recorder::{Recorder, Tape};
pub use recover::{Recovered, recover};
pub use stream::{CaptureReader, Damage, MessageTimes};
pub use write::{CaptureSettings, CaptureWriter, CutTail, PartFile};
