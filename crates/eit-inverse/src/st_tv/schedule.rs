//! Numbers that whole sequences and streams share.

/// Smoothing of the norms relative to the size of the image and the requested gap.
pub(super) const SMOOTHING: f64 = 0.04;

/// Iterations between two checks of the clock.
pub(super) const CLOCK: usize = 4;

/// Assumed decay of the gap, as a power of the iterations.
pub(super) const POWER: f64 = 3.0;

/// Steps of the flow before each change of the data dual, and force of a bound towards the image relative to the
/// target gap.
pub(super) const FLOW_STEPS: usize = 5;
pub(super) const LEAN: f64 = 0.4;

/// Gap below which `f32` rounding errors matter.
pub(super) const SINGLE_PRECISION_GAP: f64 = 1e-4;
