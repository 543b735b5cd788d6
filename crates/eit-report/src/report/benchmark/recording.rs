//! A simulated recording, and what every solver made of it.

use super::work_precision::WorkPrecisionCurve;
use crate::simulate::SimulatedSequence;
use ndarray::Array2;

/// A simulated recording and its truth.
pub(super) struct SimulatedRecording {
    /// Shape or number of its fingers, for tables.
    pub shape: &'static str,
    pub simulated: SimulatedSequence,
    /// Siemens, [frame, masked pixel] on the finest raster.
    pub truth: Array2<f64>,
}

/// A recording and what every solver made of it.
pub(super) struct RecordingResults {
    pub recording: SimulatedRecording,
    pub curves: Vec<WorkPrecisionCurve>,
}
