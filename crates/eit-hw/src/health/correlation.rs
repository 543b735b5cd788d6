//! The sign of recorded values, by a model.

/// Correlation of a frame with the same frame of a model, sum (v w) / sqrt(sum v^2 sum w^2), in
/// [-1, 1], over the measurements where both are finite.
///
/// Instruments that do not name electrodes also differ in sign: magnitudes, or a reversed drive or
/// voltmeter. Near -1 the recording has the other sign than the convention of
/// [`Quadruple`](crate::Quadruple), and without `-v` every difference image is inverted. On real
/// tanks in the right order it is beyond 0.95 either way; reciprocity cannot see it.
///
/// `None` where the lengths differ or one of the two is zero.
pub fn model_correlation(frame: &[f64], model_frame: &[f64]) -> Option<f64> {
    if frame.len() != model_frame.len() {
        return None;
    }
    let both = || frame.iter().zip(model_frame).filter(|(v, w)| v.is_finite() && w.is_finite());
    // neither overflow nor underflow of the squares, whatever the unit
    let largest = both().fold([0.0_f64; 2], |[v, w], (x, y)| [v.max(x.abs()), w.max(y.abs())]);
    if largest.contains(&0.0) {
        return None;
    }
    let [mut product, mut square, mut model_square] = [0.0; 3];
    for (v, w) in both() {
        let (v, w) = (v / largest[0], w / largest[1]);
        product += v * w;
        square += v * v;
        model_square += w * w;
    }
    Some(product / (square * model_square).sqrt())
}
