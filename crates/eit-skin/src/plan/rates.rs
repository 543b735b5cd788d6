//! Rates from which the times of a plan are computed.

/// Rate of a dense product in double precision on the machine where the rates below were fitted; times are
/// scaled with it to the current machine.
pub const FITTED_FLOPS_PER_S: f64 = 4e10;
/// Rates for predicted times, fitted by hand on one core of the machine of `docs/PERFORMANCE.md` with 16
/// electrodes at 2 000 and 20 000 nodes: sparse factorisation with its overhead per element, backward sweeps,
/// priors per entry of the Jacobian, dense products and factorisations, stores to memory, reads from cache.
/// On other scenes they are rough estimates.
pub const FACTOR_FLOPS_PER_S: f64 = 1.5e10;
pub const ELEMENT_S: f64 = 3.8e-8;
pub const SWEEP_FLOPS_PER_S: f64 = 1e10;
pub const PRIOR_ENTRY_S: f64 = 2.5e-8;
pub const PRODUCT_FLOPS_PER_S: f64 = 3.3e10;
pub const DECOMPOSITION_FLOPS_PER_S: f64 = 1.5e10;
/// Between the rate for memory that is reused (5 and more) and for memory whose pages are touched for the
/// first time (2), as for the single Jacobian of a command: either is within a factor of two.
pub const STORE_BYTES_PER_S: f64 = 3.2e9;
/// Beyond the caches, where every page is new: between 1.3 and 3.
pub const NEW_BYTES_PER_S: f64 = 2e9;
pub const CACHED_BYTES: f64 = 1.6e7;
/// Number of directions of the data that a smooth prior or rounding leaves in practice, however many
/// electrodes: 261 for 32 with trigonometric currents.
pub const USUAL_DIRECTIONS: f64 = 250.0;
pub const READ_BYTES_PER_S: f64 = 4.5e10;
/// Solves with bounded error, in seconds per node (2 000 and 20 000 nodes): electrodes eliminated
/// analytically in `f64`, and in twice the precision.
pub const ELIMINATED_NODE_S: f64 = 6e-6;
pub const EXTENDED_NODE_S: f64 = 3.5e-5;
/// Real multiplications and additions per complex one.
pub const COMPLEX_FLOPS: f64 = 4.0;
/// Meshing, seconds per node.
pub const NODE_S: f64 = 5.5e-6;
/// Total variation, effective rate: an iteration of 64 x 64 pixels and 20 frames in single precision.
pub const TV_FLOPS_PER_S: f64 = 5e10;
/// Number of frames that its kernels process together.
pub const TV_LANES: usize = 8;
/// Number of iterations of total variation, if none were measured.
pub const TV_ITERATIONS: f64 = 260.0;
/// Number of passes over the values of a movie, single precision, per iteration.
pub const TV_PASSES: f64 = 14.0;
/// Number of trial solves that choose the weights, and their frames.
pub const TV_TRIALS: f64 = 10.0;
pub const TV_TRIAL_FRAMES: usize = 12;
/// Steps of the absolute method per frame.
pub const ABSOLUTE_STEPS: f64 = 2.0;

/// Number of frames assumed if the recording is not known.
pub const ASSUMED_FRAMES: usize = 20;
