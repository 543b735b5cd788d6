//! Checks of measured frames: reciprocity, the sign relative to a model, and the state of each
//! electrode.

mod check;
mod correlation;
mod live;
mod order;

pub use check::{ElectrodeHealth, HealthReport, Resolution, StreamFacts, check_health};
pub use check::{Finding, Severity, Trouble, Verdict};
pub use correlation::model_correlation;
pub use live::{ReferenceFrames, measure_reference_frames};
pub use order::{OrderCandidate, OrderVerdict, reciprocity_error, recognise_order};
