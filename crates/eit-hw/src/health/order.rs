//! Reciprocity of a frame, and what it tells about the order of its measurements.
//!
//! By reciprocity (Geselowitz 1971) a linear body gives v(a, b, m, n) = v(m, n, a, b), so a frame
//! that holds both can be checked without a model. In the right order of measurements the two
//! agree to the accuracy of the instrument; in a wrong one they differ as two arbitrary
//! measurements do.
//!
//! What it cannot see: numbering the electrodes from another start or the other way round leaves
//! every reciprocal pair a reciprocal pair. So does swapping drives with measured pairs.

use std::collections::HashMap;

use crate::frame::{Quadruple, unsigned};

/// Above this error an order is doubted. Right orders of all real recordings at hand are below
/// 0.15 (the worst is a voltage over current of 2004), wrong ones above 0.75.
const DOUBTED_ERROR: f64 = 0.2;

/// So many times smaller must the error of another order be. It is 7 times or more on the
/// recordings above; one open electrode raises right and wrong orders alike to about 1.
const CLEAR_FACTOR: f64 = 3.0;

/// Relative root mean square difference of reciprocal measurements,
/// sqrt(sum (v(abmn) - v(mnab))^2 / (sum (v(abmn)^2 + v(mnab)^2) / 2)), over all pairs of
/// measurements of which one is the other with drive and measured pair swapped; swapping `a` with
/// `b` or `m` with `n` flips the sign and is seen through.
///
/// Measurements on a driven electrode are left out, since instruments treat driven electrodes in
/// another way (1.36 with and 0.056 without them on the KHU/IIRC rod recording), and so are
/// non-finite values. 0 is perfect; two unrelated measurements give about 1.
///
/// `frame` holds one value per quadruple. `None` where the lengths differ or no two measurements
/// are reciprocal, as with opposite drive and adjacent measurement.
///
/// ```
/// let quadruples = [[0, 1, 2, 3], [3, 2, 0, 1]];
/// assert_eq!(eit_hw::reciprocity_error(&quadruples, &[0.5, -0.5]), Some(0.0));
/// assert_eq!(eit_hw::reciprocity_error(&quadruples[..1], &[0.5]), None);
/// ```
pub fn reciprocity_error(quadruples: &[Quadruple], frame: &[f64]) -> Option<f64> {
    if quadruples.len() != frame.len() {
        return None;
    }
    let mut signed = HashMap::with_capacity(frame.len());
    for (&quadruple, &value) in quadruples.iter().zip(frame) {
        let [a, b, m, n] = quadruple;
        let on_driven = m == a || m == b || n == a || n == b;
        if value.is_finite() && !on_driven {
            let (unsigned, sign) = unsigned(quadruple);
            signed.insert(unsigned, sign * value);
        }
    }
    // neither overflow nor underflow of the squares, whatever the unit
    let largest = signed.values().fold(0.0, |most: f64, value| most.max(value.abs()));
    let (mut pairs, mut difference, mut sum) = (0_usize, 0.0, 0.0);
    // in the order of the quadruples: the sum must not depend on the map's random order
    for &quadruple in quadruples {
        let (key @ [a, b, m, n], _) = unsigned(quadruple);
        if [a, b] < [m, n]
            && let (Some(v), Some(w)) = (signed.get(&key), signed.get(&[m, n, a, b]))
        {
            let (v, w) = (v / largest, w / largest);
            pairs += 1;
            difference += (v - w).powi(2);
            sum += 0.5 * (v * v + w * w);
        }
    }
    (pairs > 0 && sum > 0.0).then(|| (difference / sum).sqrt())
}

/// An order of measurements other than the scene's, by the setting that chooses it.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderCandidate {
    /// What to set, such as `[protocol] order = "ascending"`.
    pub setting: String,
    /// Its reciprocity error on the frame.
    pub error: f64,
}

/// What reciprocity says about the order of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum OrderVerdict {
    /// The scene's order fits: its reciprocity error is 0.2 or less.
    Consistent {
        /// Reciprocity error in the scene's order.
        error: f64,
    },
    /// The scene's order does not fit (above 0.2) and another fits at least 3 times better.
    Other {
        /// Every order that fits 3 times better, best first; never empty. Where there are several,
        /// reciprocity cannot tell them apart.
        better: Vec<OrderCandidate>,
        /// Reciprocity error in the scene's order.
        ours: f64,
    },
    /// Nothing can be said: no reciprocal measurements in the scene's order, or it does not fit
    /// and no other fits clearly better (an electrode is off, or the order is none of these).
    Unclear {
        /// Reciprocity error in the scene's order.
        ours: Option<f64>,
        /// The best of the others.
        best: Option<OrderCandidate>,
    },
}

/// Compares the scene's order of measurements with others by the reciprocity error of a frame.
///
/// `frame` is one value per measurement in file order; the mean over a recording is less noisy
/// than one frame. `alternatives` are orders by the setting that chooses them; one of another
/// length than the frame is passed over. Magnitudes without sign serve as well where reciprocal
/// measurements have the same sign, as in adjacent protocols.
///
/// Nothing is chosen: the caller reports the verdict.
pub fn recognise_order(
    frame: &[f64],
    quadruples: &[Quadruple],
    alternatives: &[(&str, Vec<Quadruple>)],
) -> OrderVerdict {
    let mut others: Vec<_> = alternatives
        .iter()
        .filter_map(|(setting, order)| {
            let error = reciprocity_error(order, frame)?;
            Some(OrderCandidate { setting: (*setting).to_owned(), error })
        })
        .collect();
    others.sort_by(|one, other| one.error.total_cmp(&other.error));
    match reciprocity_error(quadruples, frame) {
        Some(error) if error <= DOUBTED_ERROR => OrderVerdict::Consistent { error },
        Some(ours) if others.first().is_some_and(|best| CLEAR_FACTOR * best.error <= ours) => {
            others.retain(|other| CLEAR_FACTOR * other.error <= ours);
            OrderVerdict::Other { better: others, ours }
        }
        ours => OrderVerdict::Unclear { ours, best: others.into_iter().next() },
    }
}
