//! A simulated recording and the results of every solver.

use super::work_precision::WorkPrecisionCurve;
use crate::comparison::SimulatedSequence;
use ndarray::Array2;

/// A simulated recording and its truth.
pub(super) struct SimulatedRecording {
    /// Shape or number of its fingers, for tables.
    pub shape: &'static str,
    pub simulated: SimulatedSequence,
    /// True change, siemens, [frame, masked pixel] on the finest raster.
    pub truth: Array2<f64>,
}

/// A recording and the results of every solver.
pub(super) struct RecordingResults {
    pub recording: SimulatedRecording,
    pub curves: Vec<WorkPrecisionCurve>,
}
