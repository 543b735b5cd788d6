//! What a benchmark has found so far.

use super::forward::results::ForwardResults;
use super::images::ImageResults;

/// What a benchmark has found so far.
#[derive(Default)]
pub(super) struct BenchmarkResults {
    /// The forward problem of each skin.
    pub forward: Vec<ForwardResults>,
    /// The images of each scene.
    pub images: Vec<ImageResults>,
}
