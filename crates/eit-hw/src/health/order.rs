//! Reciprocity of a frame, and what it says about the order of its measurements.
//!
//! By reciprocity (Geselowitz 1971) a linear body has v(a, b, m, n) = v(m, n, a, b), so a frame
//! that contains both can be checked without a model. In the right order of measurements the two
//! agree to the accuracy of the instrument; in a wrong one they differ as two arbitrary
//! measurements do.
//!
//! Reciprocity cannot detect a different first electrode or direction of numbering, since
//! reciprocal pairs remain reciprocal. Nor can it detect that drives and measured pairs are
//! swapped.

use std::collections::HashMap;

use crate::frame::{Quadruple, unsigned};

/// Error above which an order is wrong or a contact at fault. Right orders with sound contacts are
/// below 0.15 on every real recording at hand (the worst is a voltage over current of 2004), wrong
/// ones above 0.75.
pub(super) const MOST_ERROR: f64 = 0.2;

/// Factor by which the error of another order, or without an electrode, must be smaller. It is at least 7 on the recordings
/// above; one open electrode raises the error of right and wrong orders alike to about 1.
pub(super) const CLEAR_FACTOR: f64 = 3.0;

/// Returns the relative root mean square difference of reciprocal measurements, sqrt(sum (v(abmn) -
/// v(mnab))^2 / (sum (v(abmn)^2 + v(mnab)^2) / 2)).
///
/// The sums run over all pairs of measurements of which one has the drive and measured pair of the
/// other swapped; the sign change from swapping `a` with `b` or `m` with `n` is accounted for. 0 is
/// perfect; two unrelated measurements give about 1.
///
/// Measurements on a driven electrode are ignored, since instruments treat driven electrodes
/// differently (1.36 with and 0.056 without them on the KHU/IIRC rod recording), and so are
/// non-finite values.
///
/// `frame` has one value per quadruple. Returns `None` if the lengths differ or no two measurements
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
    // scaled so that the squares neither overflow nor underflow, whatever the unit
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

/// An order of measurements other than the scene's, and the setting that selects it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct OrderCandidate {
    /// Setting that selects the order, such as `[protocol] order = "ascending"`.
    pub setting: String,
    /// Reciprocity error of the frame in this order.
    pub error: f64,
}

/// What reciprocity says about the order of a file.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum OrderVerdict {
    /// The scene's order fits: its reciprocity error is at most 0.2.
    Consistent {
        /// Reciprocity error in the scene's order.
        error: f64,
    },
    /// The scene's order does not fit (error above 0.2), and another fits at least 3 times better.
    Other {
        /// Every order that fits at least 3 times better, best first; never empty. If there are
        /// several, reciprocity cannot distinguish them.
        better: Vec<OrderCandidate>,
        /// Reciprocity error in the scene's order.
        ours: f64,
    },
    /// Undecided: the scene's order has no reciprocal measurements, or it does not fit and no other
    /// fits clearly better (an electrode is off, or the order is none of these).
    Unclear {
        /// Reciprocity error in the scene's order.
        ours: Option<f64>,
        /// The best alternative.
        best: Option<OrderCandidate>,
    },
}

/// Compares the scene's order of measurements with others by the reciprocity error of a frame.
///
/// `frame` has one value per measurement in file order; the mean over a recording is less noisy
/// than one frame. `alternatives` are other orders and the settings that select them; those of
/// another length than the frame are ignored. Unsigned magnitudes serve as well if reciprocal
/// measurements have the same sign, as in adjacent protocols.
///
/// Chooses nothing: the caller reports the verdict.
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
        Some(error) if error <= MOST_ERROR => OrderVerdict::Consistent { error },
        Some(ours) if others.first().is_some_and(|best| CLEAR_FACTOR * best.error <= ours) => {
            others.retain(|other| CLEAR_FACTOR * other.error <= ours);
            OrderVerdict::Other { better: others, ours }
        }
        ours => OrderVerdict::Unclear { ours, best: others.into_iter().next() },
    }
}
