//! Reading of numbers that a format without NaN and infinity holds as `null`, such as JSON; and positions
//! of any dimension.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Reads a number that is NaN if it is `null`.
pub(crate) fn nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    or(deserializer, f64::NAN)
}

/// Reads a number that is infinite if it is `null`.
pub(crate) fn infinite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    or(deserializer, f64::INFINITY)
}

/// Reads a number that is minus infinity if it is `null`.
#[cfg(feature = "st-tv")]
pub(crate) fn minus_infinite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    or(deserializer, f64::NEG_INFINITY)
}

/// A binary format holds the number itself, and an option differently.
fn or<'de, D: Deserializer<'de>>(deserializer: D, absent: f64) -> Result<f64, D::Error> {
    if !deserializer.is_human_readable() {
        return f64::deserialize(deserializer);
    }
    Ok(Option::deserialize(deserializer)?.unwrap_or(absent))
}

/// Writes a position: serde knows arrays of given lengths only.
pub(crate) fn position<S: Serializer, const D: usize>(
    position: &[f64; D],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    position.as_slice().serialize(serializer)
}

/// Writes positions, some of which may be missing.
pub(crate) fn positions<S: Serializer, const D: usize>(
    positions: &[Option<[f64; D]>],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer
        .collect_seq(positions.iter().map(|position| position.as_ref().map(<[f64; D]>::as_slice)))
}
