//! Reconstruction of a sequence, each frame warm-started from the one before.

use super::step::FrameData;
use super::{AbsoluteFrameReport, AbsoluteGaussNewton, dot};
use crate::sequence::modes::whiten;
use crate::{
    DifferenceFrames, ImageSequence, InverseError, SequenceReport, SequenceSolver, SequenceStatus,
};
use eit_core::event;
use ndarray::Array2;
use std::time::Instant;

impl AbsoluteGaussNewton<'_> {
    /// One event per sequence: a warning if any frame did not converge.
    fn report_events(&self, report: &SequenceReport) {
        let frames = self.reports.len();
        let mut failed =
            self.reports.iter().filter(|report| report.status != SequenceStatus::Converged);
        let Some(first) = failed.next() else {
            event!(
                DEBUG,
                "absolute Gauss-Newton converged",
                frames = frames,
                iterations = report.iterations,
            );
            return;
        };
        event!(
            WARN,
            "absolute Gauss-Newton stopped before it converged",
            unconverged_frames = 1 + failed.count(),
            frames = frames,
            iterations = report.iterations,
            predicted_decrease = first.predicted_decrease,
            wanted_decrease = self.settings.relative_decrease,
            seconds = report.seconds,
        );
    }
}

impl SequenceSolver for AbsoluteGaussNewton<'_> {
    fn name(&self) -> &'static str {
        "gauss-newton-absolute"
    }

    /// `report.residual` is that of the non-linear model, `|W^1/2 (F(sigma) - F(sigma_ref) - dv)|`;
    /// `report.iterations` is the sum over all frames, and `report.status` the worst of any frame.
    ///
    /// # Errors
    /// In addition to those of the trait, the prior and model errors of [`AbsoluteGaussNewton::new`].
    fn reconstruct_sequence(
        &mut self,
        frames: &DifferenceFrames<'_>,
    ) -> Result<ImageSequence, InverseError> {
        let start = Instant::now();
        frames.check_shape(self.channels.count)?;
        self.reports.clear();
        let count = frames.values.nrows();
        let mut images = Array2::zeros((count, self.map.len()));
        let mut residual = Vec::with_capacity(count);
        let unit = self.channels.noise_scale.unwrap_or(1.0);
        let mut before = None;
        for (t, mut image) in images.rows_mut().into_iter().enumerate() {
            let mut whitened = vec![0.0; self.channels.used.len()];
            let masked = whiten(&self.channels, frames, t, &mut whitened)?;
            let data = FrameData { whitened: &whitened, masked: &masked };
            let (point, report) = self.frame(before.as_ref(), &data)?;
            for ((value, s), reference) in
                image.iter_mut().zip(self.conductivity(&point.x)).zip(&self.reference_s)
            {
                *value = s - reference;
            }
            residual.push(dot(&point.residual, &point.residual).sqrt() / unit);
            self.reports.push(report);
            if masked.len() < self.channels.used.len() {
                before = Some(point);
            }
        }
        let report = SequenceReport {
            method: self.name(),
            status: worst(&self.reports),
            iterations: self.reports.iter().map(|report| report.iterations).sum(),
            seconds: start.elapsed().as_secs_f64(),
            residual,
            certificate: None,
            trace: Vec::new(),
        };
        self.report_events(&report);
        Ok(ImageSequence { images, report })
    }
}

fn worst(reports: &[AbsoluteFrameReport]) -> SequenceStatus {
    let any = |status| reports.iter().any(|report| report.status == status);
    [SequenceStatus::Stalled, SequenceStatus::IterationCap]
        .into_iter()
        .find(|&status| any(status))
        .unwrap_or(SequenceStatus::Converged)
}
