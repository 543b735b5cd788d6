//! The inverse problem of one simulated recording, and how its images are judged.
//!
//! All images are judged on the finest raster; the pixels of a coarser one become squares on it.

use super::super::super::named_net::NamedNet;
use super::super::super::reconstruction_model::ReconstructionModel;
use super::super::super::scores::{Scores, Truth};
use super::super::super::solver::{BoundedMethod, SetUpCost};
use super::super::recording::SimulatedRecording;
use super::super::roofline::Roofline;
use super::super::settings::Size;
use super::super::work_precision::{
    Convergence, SolverDescription, Spread, WorkPrecisionCurve, WorkPrecisionPoint,
};
use crate::error::ReportError;
use eit_skin::scene::{ReconstructionSettings, Rule};
use eit_skin::{FittedFrames, StopFlag};
use ndarray::{Array2, Array3, ArrayView2};
use std::path::Path;

/// A recording and what it is reconstructed with.
pub(in super::super) struct InverseProblem<'a> {
    /// The same skin with ascending numbers of pixels; images are judged on the last one.
    pub models: &'a [ReconstructionModel],
    pub recording: &'a SimulatedRecording,
    pub size: &'a Size,
    pub roofline: &'a Roofline,
    /// Nets that belong to the skin and to the finest raster.
    pub nets: &'a [NamedNet],
    /// An interpreter that runs the Python peers.
    pub peers: Option<&'a Path>,
    /// Set when the user interrupts.
    pub stop: &'a StopFlag,
}

/// How images were made.
pub(super) struct SolverRun {
    pub time: Spread,
    /// Of a frame, by the roofline.
    pub floor_s: f64,
    pub convergence: Convergence,
    pub target_gap: Option<f64>,
}

impl InverseProblem<'_> {
    /// Whether it is one frame, with nothing in time.
    pub fn is_still(&self) -> bool {
        self.frames() == 1
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.recording.truth.nrows()
    }

    /// The model with the finest raster; a problem has one at least.
    pub fn finest(&self) -> &ReconstructionModel {
        &self.models[self.models.len() - 1]
    }

    /// The recording for a method, with a rule for its hyperparameter.
    pub fn fit(
        &self,
        model: &ReconstructionModel,
        method: BoundedMethod,
        rule: Rule,
    ) -> FittedFrames {
        self.fit_with(model, method.settings(model, rule))
    }

    /// The recording with its noise, to be reconstructed with these settings.
    pub fn fit_with(
        &self,
        model: &ReconstructionModel,
        settings: ReconstructionSettings,
    ) -> FittedFrames {
        let simulated = &self.recording.simulated;
        model.fit(&simulated.frames, simulated.noise_std_v, settings)
    }

    /// Images of another raster on the finest, both [frame, masked pixel].
    pub fn on_finest(
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
            // a rim pixel that the coarse raster leaves out shows no change
            *value = found.filter(|v| v.is_finite()).unwrap_or(0.0);
        }
        Ok(shown)
    }

    /// Judges images on the finest raster.
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

    /// The curve of a solver with one setting.
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
