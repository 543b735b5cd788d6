//! The sign of recorded values, compared with a model.

/// Returns the correlation of a frame with that of a model, sum (v w) / sqrt(sum v^2 sum w^2), in
/// [-1, 1], over the measurements where both are finite.
///
/// Instruments that do not name electrodes also differ in sign: they send magnitudes, or the drive
/// or voltmeter is reversed. Near -1, the recording has the opposite sign to the convention of
/// [`Quadruple`](crate::Quadruple), and every difference image is inverted unless the values are
/// negated. On real tanks in the right order the magnitude is above 0.95. Reciprocity cannot detect
/// the sign.
///
/// Returns `None` if the lengths differ or one of the frames is zero.
pub fn model_correlation(frame: &[f64], model_frame: &[f64]) -> Option<f64> {
    if frame.len() != model_frame.len() {
        return None;
    }
    let both = || frame.iter().zip(model_frame).filter(|(v, w)| v.is_finite() && w.is_finite());
    // scaled so that the squares neither overflow nor underflow, whatever the unit
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
