//! Stimulation and measurement patterns. Their order is the order of all data.
//!
//! A protocol consists of stimulation patterns, measurement patterns, and an ordered list that says
//! which measurement pattern is read under which stimulation. If all patterns are electrode pairs,
//! each measurement has a quadruple `[a, b, m, n]`: current enters the skin at `a` and leaves at
//! `b`, and the value is the potential at `m` minus the potential at `n`.

mod fields;
mod pair_protocol;
mod pairs;
mod pattern_entries;
mod patterns;
#[cfg(feature = "serde")]
mod serialised;

pub(crate) use fields::{Fields, Product};
pub use pair_protocol::{DrivenElectrodes, Order, PairProtocol};
pub use pairs::PairPattern;
pub(crate) use pattern_entries::PatternEntries;
pub use patterns::Protocol;
