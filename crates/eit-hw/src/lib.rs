#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

#[cfg(feature = "serde")]
mod absent;
#[cfg(feature = "mcap")]
pub mod capture;
pub mod codec;
pub mod driver;
pub mod emulator;
mod error;
mod frame;
mod health;
mod readers;
mod recording;
mod regular;
mod transport;

/// ndarray, in the version of this crate's interface.
pub use ndarray;

pub use error::{ArrayFault, At, HwError, Place};
pub use frame::{Frame, Quadruple, Quality, UnknownFlags};
pub use health::{
    ElectrodeHealth, Finding, HealthReport, Resolution, Severity, StreamFacts, Trouble, Verdict,
    check_health,
};
pub use health::{
    OrderCandidate, OrderVerdict, ReferenceFrames, measure_reference_frames, model_correlation,
    reciprocity_error, recognise_order,
};
pub use readers::{ReadOptions, SerialLogOptions, parse_recording, read_array, read_recording};
pub use recording::{
    Component, CountHint, Format, FrameMap, FrameOrientation, Layout, MeasuredFrames, Note,
    Recording, SkipReason, Skipped, SkippedFrame, Unit,
};
pub use regular::regular_file;
pub use transport::{Endpoint, Link};
#[cfg(feature = "serial")]
pub use transport::{PortDescription, UsbDescription, serial_ports};
