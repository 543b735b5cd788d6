//! Results of a benchmark so far.

use super::forward::results::ForwardResults;
use super::images::ImageResults;

/// Results of a benchmark so far.
#[derive(Default)]
pub(super) struct BenchmarkResults {
    /// The forward problem of each skin.
    pub forward: Vec<ForwardResults>,
    /// The images of each scene.
    pub images: Vec<ImageResults>,
}
