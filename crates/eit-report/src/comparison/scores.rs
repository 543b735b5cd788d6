//! Accuracy of a sequence of images compared with the truth.

use super::model::ReconstructionModel;
use crate::error::ReportError;
use eit_inverse::metrics::{
    ChangeSign, GreitTarget, TouchSettings, correlation_coefficient, greit_figures, relative_error,
    structural_similarity, touch_position_errors_m,
};
use ndarray::{Array2, ArrayView2};

/// A blob farther than this from a finger does not belong to it: two and a half standard deviations
/// of its bell.
const WITHIN_M: f64 = 0.03;

/// The truth of a simulated sequence.
pub struct Truth<'a> {
    /// True change, siemens, [frame, masked pixel].
    pub pixels: &'a Array2<f64>,
    /// Positions of the fingers, metres, `[frame][finger]`.
    pub positions_m: &'a [Vec<[f64; 2]>],
}

/// Figures of merit of a sequence of images.
#[derive(Debug, Clone, Copy)]
pub struct Scores {
    /// Relative error of the whole sequence: 0 for the truth, 1 for an empty one.
    pub relative_error: f64,
    /// Correlation, mean over frames.
    pub correlation: f64,
    /// Structural similarity, mean over frames, relative to the range of the true sequence.
    pub similarity: f64,
    /// Mean distance of the fingers found from their blobs, metres; NaN if none was found.
    pub position_error_m: f64,
    /// Fraction of fingers found.
    pub found: f64,
    /// False blobs per frame.
    pub extra: f64,
    /// GREIT figures for a single finger, means over frames.
    pub greit: Option<GreitFigures>,
}

/// GREIT figures, means over frames.
#[derive(Debug, Clone, Copy, Default)]
pub struct GreitFigures {
    /// Amount of the image over that of the truth: 1 best.
    pub amplitude_response: f64,
    /// Mean of the absolute position error, metres.
    pub position_error_m: f64,
    /// Radius of the blob relative to that of the skin.
    pub resolution: f64,
    /// Share of the blob outside the circle of its area.
    pub shape_deformation: f64,
    /// Amount of the opposite sign around the blob.
    pub ringing: f64,
}

impl Scores {
    /// Compares images [frame, masked pixel] with the first frames of the truth.
    ///
    /// # Errors
    /// Images of another raster than the model's.
    pub fn new(
        model: &ReconstructionModel,
        images: ArrayView2<'_, f64>,
        truth: &Truth<'_>,
    ) -> Result<Self, ReportError> {
        let count = images.nrows();
        let areas = model.cells.areas_m2();
        let shown: Vec<f64> = images.iter().copied().collect();
        let wanted: Vec<f64> =
            truth.pixels.rows().into_iter().take(count).flatten().copied().collect();
        let all_areas: Vec<f64> = areas.iter().copied().cycle().take(shown.len()).collect();
        let range = wanted.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let mut sums = Self {
            relative_error: relative_error(&shown, &wanted, &all_areas)?,
            correlation: 0.0,
            similarity: 0.0,
            position_error_m: 0.0,
            found: 0.0,
            extra: 0.0,
            greit: None,
        };
        let (mut fingers, mut found) = (0, 0);
        for (frame, image) in images.rows().into_iter().enumerate() {
            let image = image.to_vec();
            let wanted = truth.pixels.row(frame).to_vec();
            // an image without any change has no defined correlation and counts as uncorrelated
            let correlation = correlation_coefficient(&image, &wanted, areas)?;
            sums.correlation += if correlation.is_nan() { 0.0 } else { correlation };
            sums.similarity += similarity(model, &image, &wanted, range)?;
            let positions = &truth.positions_m[frame];
            let settings = TouchSettings { within_m: WITHIN_M, ..Default::default() };
            let touches = touch_position_errors_m(&image, &model.cells, positions, &settings)?;
            sums.position_error_m += touches.errors_m.iter().flatten().sum::<f64>();
            found += touches.errors_m.iter().flatten().count();
            fingers += positions.len();
            sums.extra += touches.extra as f64;
            if let [position_m] = positions[..] {
                let greit = sums.greit.get_or_insert_with(GreitFigures::default);
                greit.add(figures(model, &image, &wanted, position_m)?, 1.0 / count as f64);
            }
        }
        let mean = |sum: f64| sum / count as f64;
        Ok(Self {
            correlation: mean(sums.correlation),
            similarity: mean(sums.similarity),
            position_error_m: sums.position_error_m / found as f64,
            found: found as f64 / fingers as f64,
            extra: mean(sums.extra),
            ..sums
        })
    }
}

/// Computes the five figures of an image; `None` for an image without any change.
fn figures(
    model: &ReconstructionModel,
    image: &[f64],
    truth: &[f64],
    position_m: [f64; 2],
) -> Result<[f64; 5], ReportError> {
    let target = GreitTarget { position_m, amount_s_m2: model.cells.integral(truth)? };
    let figures = greit_figures(image, &model.cells, ChangeSign::Increase, &target)?;
    Ok(figures.map_or([0.0; 5], |f| {
        let error_m = f.position_error_m.abs();
        [f.amplitude_response, error_m, f.resolution, f.shape_deformation, f.ringing]
    }))
}

/// Structural similarity of pixels, relative to a range.
fn similarity(
    model: &ReconstructionModel,
    image: &[f64],
    truth: &[f64],
    range: f64,
) -> Result<f64, ReportError> {
    let image = model.raster.image_from_pixels(image)?;
    let truth = model.raster.image_from_pixels(truth)?;
    let mask = model.raster.mask().view();
    // a truth without any change has no range
    let range = Some(range).filter(|range| *range > 0.0);
    Ok(structural_similarity(image.view(), truth.view(), mask, range)?.unwrap_or(0.0))
}

impl GreitFigures {
    fn add(&mut self, figures: [f64; 5], weight: f64) {
        let sums = [
            &mut self.amplitude_response,
            &mut self.position_error_m,
            &mut self.resolution,
            &mut self.shape_deformation,
            &mut self.ringing,
        ];
        sums.into_iter().zip(figures).for_each(|(sum, figure)| *sum += weight * figure);
    }
}
