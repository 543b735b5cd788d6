//! Rates from which the times of a plan are computed.

/// Rate of a dense product in double precision on the machine where the rates below were fitted; times are
/// scaled with it to the current machine.
pub(crate) const FITTED_FLOPS_PER_S: f64 = 4e10;
/// Rates for predicted times, fitted by hand on one core of the machine of `docs/PERFORMANCE.md` with 16
/// electrodes at 2 000 and 20 000 nodes: sparse factorisation with its overhead per element, backward sweeps,
/// priors per entry of the Jacobian, dense products and factorisations, stores to memory, reads from cache.
/// On other scenes they are rough estimates.
pub(crate) const FACTOR_FLOPS_PER_S: f64 = 1.5e10;
pub(crate) const ELEMENT_S: f64 = 3.8e-8;
pub(crate) const SWEEP_FLOPS_PER_S: f64 = 1e10;
pub(crate) const PRIOR_ENTRY_S: f64 = 2.5e-8;
pub(crate) const PRODUCT_FLOPS_PER_S: f64 = 3.3e10;
pub(crate) const DECOMPOSITION_FLOPS_PER_S: f64 = 1.5e10;
/// Between the rate for memory that is reused (5 and more) and for memory whose pages are touched for the
/// first time (2), as for the single Jacobian of a command: either is within a factor of two.
pub(crate) const STORE_BYTES_PER_S: f64 = 3.2e9;
/// Beyond the caches, where every page is new: between 1.3 and 3.
pub(crate) const NEW_BYTES_PER_S: f64 = 2e9;
pub(crate) const CACHED_BYTES: f64 = 1.6e7;
/// Number of directions of the data that a smooth prior or rounding leaves in practice, however many
/// electrodes: 261 for 32 with trigonometric currents.
pub(crate) const USUAL_DIRECTIONS: f64 = 250.0;
pub(crate) const READ_BYTES_PER_S: f64 = 4.5e10;
/// Solves with bounded error, in seconds per node (2 000 and 20 000 nodes): electrodes eliminated
/// analytically in `f64`, and in twice the precision.
pub(crate) const ELIMINATED_NODE_S: f64 = 6e-6;
pub(crate) const EXTENDED_NODE_S: f64 = 3.5e-5;
/// Meshing, seconds per node.
pub(crate) const NODE_S: f64 = 5.5e-6;
/// Total variation, effective rate: an iteration of 64 x 64 pixels and 20 frames in single precision.
pub(crate) const TV_FLOPS_PER_S: f64 = 5e10;
/// Number of frames that its kernels process together.
pub(crate) const TV_LANES: usize = 8;
/// Number of iterations of total variation, if none were measured.
pub(crate) const TV_ITERATIONS: f64 = 260.0;
/// Number of passes over the values of a movie, single precision, per iteration.
pub(crate) const TV_PASSES: f64 = 14.0;
/// Number of trial solves that choose the weights, and their frames.
pub(crate) const TV_TRIALS: f64 = 10.0;
pub(crate) const TV_TRIAL_FRAMES: usize = 12;
/// Steps of the absolute method per frame.
pub(crate) const ABSOLUTE_STEPS: f64 = 2.0;

/// Number of frames assumed if the recording is not known.
pub(crate) const ASSUMED_FRAMES: usize = 20;
