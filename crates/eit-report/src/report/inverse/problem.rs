//! The inverse problem of one simulated recording, and the evaluation of its images.
//!
//! All images are evaluated on the finest raster, where the pixels of a coarser one appear as
//! squares.

use super::super::named_net::NamedNet;
use super::super::recording::SimulatedRecording;
use super::super::roofline::Roofline;
use super::super::settings::Size;
use super::super::work_precision::{
    Convergence, SolverDescription, Spread, WorkPrecisionCurve, WorkPrecisionPoint,
};
use crate::comparison::ReconstructionModel;
use crate::comparison::{BoundedMethod, SetUpCost};
use crate::comparison::{Scores, Truth};
use crate::error::ReportError;
use eit_skin::scene::{ReconstructionSettings, Rule};
use eit_skin::{FittedFrames, StopFlag};
use ndarray::{Array2, Array3, ArrayView2};

/// A recording and the models used to reconstruct it.
pub(in super::super) struct InverseProblem<'a> {
    /// The same skin with ascending numbers of pixels; images are evaluated on the last one.
    pub models: &'a [ReconstructionModel],
    pub recording: &'a SimulatedRecording,
    pub size: &'a Size,
    pub roofline: &'a Roofline,
    /// Networks for this skin and the finest raster.
    pub nets: &'a [NamedNet],
    /// Set when the user interrupts.
    pub stop: &'a StopFlag,
}

/// Time and convergence of a solver's run.
pub(super) struct SolverRun {
    pub time: Spread,
    /// Time floor per frame, from the roofline.
    pub floor_s: f64,
    pub convergence: Convergence,
    pub target_gap: Option<f64>,
}

impl InverseProblem<'_> {
    /// Whether the recording is a single frame, without a time term.
    pub(crate) fn is_still(&self) -> bool {
        self.frames() == 1
    }

    /// Number of frames.
    pub(crate) fn frames(&self) -> usize {
        self.recording.truth.nrows()
    }

    /// Returns the model with the finest raster; there is at least one model.
    pub(crate) fn finest(&self) -> &ReconstructionModel {
        &self.models[self.models.len() - 1]
    }

    /// Fits the recording for a method, with a rule for its hyperparameter.
    pub(crate) fn fit(
        &self,
        model: &ReconstructionModel,
        method: BoundedMethod,
        rule: Rule,
    ) -> FittedFrames {
        self.fit_with(model, method.settings(model, rule))
    }

    /// Fits the recording, with its noise, for reconstruction with these settings.
    pub(crate) fn fit_with(
        &self,
        model: &ReconstructionModel,
        settings: ReconstructionSettings,
    ) -> FittedFrames {
        let simulated = &self.recording.simulated;
        model.fit(&simulated.frames, simulated.noise_std_v, settings)
    }

    /// Maps images from another raster to the finest, both [frame, masked pixel].
    pub(crate) fn on_finest(
        &self,
        model: &ReconstructionModel,
        pixels: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, ReportError> {
        let (finest, own) = (&self.finest().raster, &model.raster);
        if own.pixels() == finest.pixels() {
            return Ok(pixels.to_owned());
        }
        let images: Array3<f64> = own.images_from_pixels(pixels)?;
        let mut shown = Array2::zeros((pixels.nrows(), finest.masked_pixels().len()));
        for ((frame, k), value) in shown.indexed_iter_mut() {
            let [row, column] = finest.masked_pixels()[k];
            let [x_m, y_m] = finest.centre_m(row, column);
            let found = own.pixel_at([x_m, y_m]).map(|[row, column]| images[[frame, row, column]]);
            // a rim pixel outside the coarse raster's mask shows no change
            *value = found.filter(|v| v.is_finite()).unwrap_or(0.0);
        }
        Ok(shown)
    }

    /// Evaluates images on the finest raster.
    pub(super) fn point(
        &self,
        images: &Array2<f64>,
        run: &SolverRun,
    ) -> Result<WorkPrecisionPoint, ReportError> {
        let SimulatedRecording { simulated, truth, .. } = self.recording;
        let truth = Truth { pixels: truth, positions_m: &simulated.positions_m };
        Ok(WorkPrecisionPoint {
            target_gap: run.target_gap,
            time: run.time,
            floor_s: run.floor_s,
            scores: Scores::new(self.finest(), images.view(), &truth)?,
            convergence: run.convergence,
        })
    }

    /// Returns the curve of a solver with a single setting.
    pub(super) fn curve(
        &self,
        solver: SolverDescription,
        cost: SetUpCost,
        images: Array2<f64>,
        run: &SolverRun,
    ) -> Result<WorkPrecisionCurve, ReportError> {
        let points = vec![self.point(&images, run)?];
        Ok(WorkPrecisionCurve { solver, cost, points, images })
    }
}
