//! Variation of untouched frames beyond the noise.

use super::rows::Rows;
use super::whitening::Whitening;
use faer::Mat;
use ndarray::{ArrayView2, Axis};

/// Fewest frames from which directions are estimated.
const LEAST_FRAMES: usize = 5;

/// Safety factor on the variance of a direction for later frames.
const MARGIN: f64 = 4.0;

/// Returns the directions of the rows in which quiet frames vary by more than noise and nuisance parameters
/// explain, one per column, in volts per standard deviation; `None` if there are none.
///
/// Whitened noise alone has sample variances up to `(1 + sqrt(n / k))^2` for `n` rows and `k` frames
/// (Marchenko, Pastur, *Math. USSR Sb.* 1 (1967), 457-483). Directions above that are kept, with a margin
/// of 4 in the variance.
pub(super) fn components(
    rows: &Rows,
    whitening: &Whitening,
    quiet_v: ArrayView2<'_, f64>,
) -> Option<Mat<f64>> {
    let (n, frames) = (rows.of.len(), quiet_v.nrows());
    if frames < LEAST_FRAMES {
        return None;
    }
    let mean = quiet_v.mean_axis(Axis(0))?;
    let mut deviations = Mat::<f64>::zeros(n, frames);
    let mut whitened = Mat::<f64>::zeros(n, frames);
    let (mut folded, mut white) = (vec![0.0; n], vec![0.0; n]);
    for (k, frame) in quiet_v.rows().into_iter().enumerate() {
        let deviation: Vec<f64> = frame.iter().zip(&mean).map(|(v, m)| v - m).collect();
        rows.fold(&deviation, &mut folded);
        whitening.apply(&folded, &mut white);
        for i in 0..n {
            deviations[(i, k)] = folded[i];
            whitened[(i, k)] = white[i];
        }
    }
    let svd = whitened.thin_svd().ok()?;
    let degrees = (frames - 1) as f64;
    let edge = (1.0 + (n as f64 / degrees).sqrt()).powi(2);
    let values: Vec<f64> = svd.S().column_vector().iter().map(|s| s * s / degrees).collect();
    let kept: Vec<usize> = (0..values.len()).filter(|&k| values[k] > edge).collect();
    if kept.is_empty() {
        return None;
    }
    let scale = (MARGIN / degrees).sqrt();
    let right = svd.V();
    Some(Mat::from_fn(n, kept.len(), |i, k| {
        let of_frame = |f: usize| deviations[(i, f)] * right[(f, kept[k])];
        scale * (0..frames).map(of_frame).sum::<f64>()
    }))
}
