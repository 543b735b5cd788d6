//! Stimulation and measurement patterns; their order is the order of all data.
//!
//! A protocol is a list of stimulation patterns, a list of measurement patterns, and an ordered
//! list of which measurement pattern is read under which stimulation. Pairs of electrodes are the
//! special case with a quadruple `[a, b, m, n]` per measurement: current enters the skin at `a`
//! and leaves at `b`, the value is the potential at `m` minus the potential at `n`.

mod fields;
mod pair_protocol;
mod pairs;
mod pattern_entries;
mod patterns;

pub(crate) use fields::{Fields, Product};
pub use pair_protocol::{DrivenElectrodes, Order, PairProtocol};
pub use pairs::PairPattern;
pub(crate) use pattern_entries::PatternEntries;
pub use patterns::Protocol;
