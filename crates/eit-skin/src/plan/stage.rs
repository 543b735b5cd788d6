//! One stage of a plan.

use super::machine::Machine;
use super::rates::{CACHED_BYTES, FITTED_FLOPS_PER_S, NEW_BYTES_PER_S, STORE_BYTES_PER_S};

/// Size, work and expected time of one stage.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub(crate) struct Stage {
    /// Name, as `eit plan` prints it.
    #[serde(rename = "stage")]
    pub name: &'static str,
    /// Size of the problem, in words.
    pub size: String,
    /// Number of multiplications and additions.
    pub flops: f64,
    /// Bytes stored.
    pub bytes: f64,
    /// Expected time on this machine, seconds.
    #[serde(rename = "expected_time_s")]
    pub time_s: f64,
    /// Reason for doing it this way.
    pub why: String,
}

/// Scales times from the machine of the rates to this one.
pub(super) fn scale(stages: &mut [Stage], machine: &Machine) {
    let slowness = FITTED_FLOPS_PER_S / machine.double_flops_per_s;
    stages.iter_mut().for_each(|stage| stage.time_s *= slowness);
}

/// Bytes per second at which an array of this size is stored.
pub(super) fn store_rate(bytes: f64) -> f64 {
    if bytes > CACHED_BYTES { NEW_BYTES_PER_S } else { STORE_BYTES_PER_S }
}
