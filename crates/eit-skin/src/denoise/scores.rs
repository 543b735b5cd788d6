//! Errors of a net's images beside those of the raw images and of the threshold rule.

use crate::error::SkinError;
use eit_denoise::{DenoiseError, Threshold};
use ndarray::{ArrayView2, ArrayView3, Axis};

/// Errors of denoised images relative to the truth.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Scores {
    /// Squared error of the net's image divided by that of the raw image, median over the frames.
    pub net_over_raw: f64,
    /// The same for the threshold rule of the paper.
    pub rule_over_raw: f64,
    /// Fraction of the frames in which the net's image is closer to the truth than the raw image.
    pub nearer_than_raw: f64,
    /// Fraction of the frames in which the net's image is closer to the truth than that of the threshold rule.
    pub nearer_than_rule: f64,
    /// Number of frames compared: those whose raw image is not zero.
    pub frames: usize,
}

/// Compares images with the truth, over the pixels that are finite in all of them.
///
/// # Errors
///
/// The errors of [`Threshold::apply_into`], except for a constant image, of which the rule keeps nothing.
pub fn scores(
    raw: ArrayView3<'_, f64>,
    made: ArrayView3<'_, f64>,
    truth: ArrayView3<'_, f64>,
    rule: &mut Threshold,
) -> Result<Scores, SkinError> {
    let mut ratios = Vec::new();
    let mut kept = raw.index_axis(Axis(0), 0).to_owned();
    for ((raw, made), truth) in raw.outer_iter().zip(made.outer_iter()).zip(truth.outer_iter()) {
        if raw.iter().all(|v| v.is_nan() || *v == 0.0) {
            continue;
        }
        match rule.apply_into(raw, kept.view_mut()) {
            // total variation may leave the inner pixels of a noisy frame equal: nothing is kept
            Ok(()) | Err(DenoiseError::ConstantImage { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let of_raw = squared(raw, truth);
        ratios.push([squared(made, truth) / of_raw, squared(kept.view(), truth) / of_raw]);
    }
    let median = |k: usize| eit_core::median(ratios.iter().map(|r| r[k])).unwrap_or(f64::NAN);
    let part = |nearer: &dyn Fn(&[f64; 2]) -> bool| {
        ratios.iter().filter(|r| nearer(r)).count() as f64 / ratios.len() as f64
    };
    Ok(Scores {
        net_over_raw: median(0),
        rule_over_raw: median(1),
        nearer_than_raw: part(&|r| r[0] < 1.0),
        nearer_than_rule: part(&|r| r[0] < r[1]),
        frames: ratios.len(),
    })
}

/// Sum of squares over pixels of the skin in both; a mask may differ by a pixel of the rim.
fn squared(image: ArrayView2<'_, f64>, truth: ArrayView2<'_, f64>) -> f64 {
    let off = image.iter().zip(truth).map(|(v, t)| (v - t) * (v - t));
    off.filter(|v| v.is_finite()).sum()
}

impl Scores {
    /// Describes it in words.
    pub fn description(&self) -> String {
        format!(
            "mean squared error against the truth, median of {} frames: {:.3} of the raw image's \
             (threshold rule {:.3}); nearer than raw in {:.0} %, than the rule in {:.0} % of them",
            self.frames,
            self.net_over_raw,
            self.rule_over_raw,
            100.0 * self.nearer_than_raw,
            100.0 * self.nearer_than_rule
        )
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;
    use eit_denoise::ThresholdRule;
    use ndarray::{Array2, Array3};

    /// Images of total variation whose inner pixels are equal are compared like others: the rule keeps
    /// nothing of them.
    #[test]
    fn flat_images_are_compared() {
        let mask = Array2::from_elem((16, 16), true);
        let mut rule = ThresholdRule::default().on(mask.view()).unwrap();
        let raw = Array3::from_elem((1, 16, 16), -1e-10);
        let (made, truth) = (0.5 * &raw, Array3::zeros((1, 16, 16)));
        let scores = scores(raw.view(), made.view(), truth.view(), &mut rule).unwrap();
        assert_eq!((scores.frames, scores.net_over_raw, scores.rule_over_raw), (1, 0.25, 0.0));
    }
}
