//! One stage of a plan.

use super::machine::Machine;
use super::rates::{CACHED_BYTES, FITTED_FLOPS_PER_S, NEW_BYTES_PER_S, STORE_BYTES_PER_S};

/// Sizes, work and expected time of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// What is done.
    pub name: &'static str,
    /// On how much.
    pub size: String,
    /// Multiplications and additions.
    pub flops: f64,
    /// Bytes that are kept.
    pub bytes: f64,
    /// Expected time on this machine, seconds.
    pub time_s: f64,
    /// Why it is done so.
    pub why: String,
}

/// From the machine that the rates are of to this one.
pub(super) fn scale(stages: &mut [Stage], machine: &Machine) {
    let slowness = FITTED_FLOPS_PER_S / machine.double_flops_per_s;
    stages.iter_mut().for_each(|stage| stage.time_s *= slowness);
}

/// Bytes a second at which an array of this size is stored.
pub(super) fn store_rate(bytes: f64) -> f64 {
    if bytes > CACHED_BYTES { NEW_BYTES_PER_S } else { STORE_BYTES_PER_S }
}
