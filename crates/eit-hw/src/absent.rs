//! Reading of numbers that a format without NaN and infinity holds as `null`, such as JSON.

use serde::{Deserialize, Deserializer};

/// Reads a list in which `null` is NaN.
pub(crate) fn nan_list<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    if !deserializer.is_human_readable() {
        return Vec::deserialize(deserializer);
    }
    let values = Vec::<Option<f64>>::deserialize(deserializer)?;
    Ok(values.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
}

/// Reads a number that is NaN if it is `null`.
pub(crate) fn nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    or(deserializer, f64::NAN)
}

/// Reads a number that is infinite if it is `null`.
pub(crate) fn infinite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    or(deserializer, f64::INFINITY)
}

/// Reads a number that is infinite if it is `null`.
pub(crate) fn infinite_f32<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    if !deserializer.is_human_readable() {
        return f32::deserialize(deserializer);
    }
    Ok(Option::deserialize(deserializer)?.unwrap_or(f32::INFINITY))
}

/// A binary format holds the number itself, and an option differently.
fn or<'de, D: Deserializer<'de>>(deserializer: D, absent: f64) -> Result<f64, D::Error> {
    if !deserializer.is_human_readable() {
        return f64::deserialize(deserializer);
    }
    Ok(Option::deserialize(deserializer)?.unwrap_or(absent))
}
