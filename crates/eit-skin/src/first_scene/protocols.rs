//! Pair protocols that match what a board prints.

use super::transfer::{PairMatrix, Placing};
use super::{FirstScene, Outline};
use crate::arrangement::arrangements;
use crate::error::SkinError;
use crate::skin::Skin;
use eit_fem::{DrivenElectrodes, PairProtocol};
use eit_hw::{model_correlation, reciprocity_error};
use std::cmp::Ordering;

/// Largest number of electrodes tried if it is not known.
const MOST_ELECTRODES: usize = 64;
/// Reciprocity error above which an order counts as wrong (as in [`eit_hw::recognise_order`]).
const WRONG_ORDER_ERROR: f64 = 0.2;
/// Factor by which the reciprocity error must fall without a place of the scan (as in [`eit_hw::recognise_order`]).
const MUCH: f64 = 3.0;
/// A frame has both signs if the largest value of one is above this fraction of the other's.
const SIGNED: f64 = 0.05;
/// Number of mesh nodes for the comparison: discretisation errs by a few percent at the electrodes, wrong
/// orders by tens.
pub(super) const NODES: usize = 1500;
/// How much better a numbering with exchanged wires must explain presses and untouched frame. On simulated boards with
/// other contacts, finger and mesh than the model's, right wires gain 0.00 by an exchange, exchanged ones 0.1 and more.
pub(super) const SWAP_LEAD: f64 = 0.03;

/// A protocol with as many measurements as a frame has values.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct FittingProtocol {
    /// Protocol of the instrument that fits the recording; with potentials, of the pairs formed from them.
    pub protocol: PairProtocol,
    /// Where the values are potentials against a common electrode: whether those of driven electrodes are among them.
    pub ground: Option<DrivenElectrodes>,
    /// The frame in the protocol's order.
    pub values: Vec<f64>,
    /// Reciprocity error of the frame in its order ([`reciprocity_error`]); `None` if it has no reciprocal
    /// pairs.
    pub reciprocity: Option<f64>,
    /// Correlation with the untouched model, for the electrode numbering that fits best; 1 is perfect.
    /// Compares magnitudes if all values have one sign; ignores polarity otherwise.
    pub correlation: f64,
    /// Two neighbouring electrodes, from 0, whose wires look exchanged: `correlation` is that with their wires exchanged
    /// back, and much better than without. On a disc the untouched skin alone shows this.
    pub swapped: Option<[usize; 2]>,
    /// Values at one place in the measurements of every drive that contradict reciprocity.
    pub off: Option<OffPlace>,
}

/// A place in the measurements of every drive whose values are off, such as the first one after switching.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct OffPlace {
    /// The place, from 0.
    pub place: usize,
    /// Reciprocity error without its values.
    pub reciprocity: f64,
}

impl FittingProtocol {
    /// Correlation from which those with exchanged wires, of which there are many, are judged.
    fn rank(&self) -> f64 {
        self.correlation - if self.swapped.is_some() { SWAP_LEAD } else { 0.0 }
    }

    /// Returns whether reciprocity contradicts the order.
    pub fn violates_reciprocity(&self) -> bool {
        let left = self.off.map(|off| off.reciprocity);
        left.or(self.reciprocity).is_some_and(|error| error > WRONG_ORDER_ERROR)
    }
}

/// Finds pair protocols with as many measurements as `frame` has values. Those that reciprocity does not
/// contradict come first, sorted by their correlation with the model; of those that are as good as the best, the most usual one is
/// first.
///
/// Tries adjacent, skip-N and opposite drive, measured on adjacent pairs, on pairs like the driven ones or against a common
/// electrode, with and without current-carrying electrodes, in both orders, for `electrodes` electrodes or, if `None`,
/// all numbers from 4 to 64. `frame` is the mean of frames of the untouched skin, in any unit; magnitudes
/// suffice.
///
/// # Errors
/// A skin that cannot be meshed; a frame with a value that is not finite.
pub fn fitting_protocols(
    frame: &[f64],
    outline: Outline,
    electrodes: Option<usize>,
) -> Result<Vec<FittingProtocol>, SkinError> {
    if let Some(at) = frame.iter().position(|value| !value.is_finite()) {
        let message = format!("value {} of the untouched frame is {}", at + 1, frame[at]);
        return Err(SkinError::input(message));
    }
    let counts = electrodes.map_or(4..=MOST_ELECTRODES, |count| count..=count);
    let mut fitting = Vec::new();
    for count in counts {
        let arrangements = arrangements(count, frame.len(), None);
        if arrangements.is_empty() {
            continue;
        }
        let model = Untouched::new(outline, count)?;
        for arrangement in arrangements {
            let (quadruples, values) = (&arrangement.quadruples, arrangement.values(frame));
            let reciprocity = reciprocity_error(quadruples, &values);
            let (correlation, swapped) = model.correlation(quadruples, &values);
            let off = reciprocity.and_then(|error| off_place(quadruples, &values, error));
            let (protocol, ground) = (arrangement.protocol, arrangement.ground);
            let fit = FittingProtocol {
                protocol,
                ground,
                values,
                reciprocity,
                correlation,
                swapped,
                off,
            };
            fitting.push(fit);
        }
    }
    let order = |fit: &FittingProtocol| (fit.violates_reciprocity(), -fit.rank());
    let best = fitting.iter().map(order).min_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
    // candidates come from the usual to the rare
    let is_as_good = |fit: &FittingProtocol| {
        let (violates, rank) = order(fit);
        best.is_some_and(|best| violates == best.0 && rank - best.1 < SWAP_LEAD)
    };
    let usual = fitting.iter().position(is_as_good).map(|at| fitting.remove(at));
    fitting.sort_by(|one, other| order(one).partial_cmp(&order(other)).unwrap_or(Ordering::Equal));
    Ok(usual.into_iter().chain(fitting).collect())
}

/// Whether a pair protocol of this many electrodes has as many values, or potentials.
pub fn is_frame(values: usize, electrodes: usize) -> bool {
    !arrangements(electrodes, values, None).is_empty()
}

/// Finds a place in the measurements of every drive without which the frame is reciprocal.
fn off_place(quadruples: &[[u32; 4]], frame: &[f64], error: f64) -> Option<OffPlace> {
    if error <= WRONG_ORDER_ERROR {
        return None;
    }
    let drive = |q: &[u32; 4]| [q[0], q[1]];
    let runs = quadruples.chunk_by(|a, b| drive(a) == drive(b));
    let places: Vec<usize> = runs.flat_map(|run| 0..run.len()).collect();
    let last = places.iter().copied().max().filter(|last| *last > 1)?;
    let without = |place: usize| {
        let value = |(value, at): (&f64, &usize)| if *at == place { f64::NAN } else { *value };
        let left: Vec<f64> = frame.iter().zip(&places).map(value).collect();
        let reciprocity = reciprocity_error(quadruples, &left)?;
        Some(OffPlace { place, reciprocity })
    };
    // the reciprocal of a place is as good: of both, the one after switching
    let found = [0, last].into_iter().chain(1..last).filter_map(without);
    found
        .into_iter()
        .find(|off| off.reciprocity <= WRONG_ORDER_ERROR && MUCH * off.reciprocity < error)
}

/// The untouched skin, which any protocol can measure.
struct Untouched {
    matrix: PairMatrix,
    electrodes: usize,
    /// Whether all numberings are alike.
    is_round: bool,
}

impl Untouched {
    fn new(outline: Outline, electrodes: usize) -> Result<Self, SkinError> {
        let mut scene = FirstScene::new(outline, electrodes).scene()?;
        scene.mesh.nodes = Some(NODES);
        let skin = Skin::from_scene(scene)?;
        let matrix = PairMatrix::untouched(&skin, PairProtocol::default().current_a)?;
        Ok(Self { matrix, electrodes, is_round: matches!(outline, Outline::Disc { .. }) })
    }

    /// Correlation for the numbering that fits best, and two electrodes whose exchange improves it much.
    fn correlation(&self, quadruples: &[[u32; 4]], frame: &[f64]) -> (f64, Option<[usize; 2]>) {
        let of = |placing: Placing| {
            let voltages = self.matrix.measured(&placing.map(quadruples, self.electrodes));
            (likeness(quadruples, frame, &voltages.to_vec()), placing)
        };
        let best = |placings: &mut dyn Iterator<Item = Placing>| {
            placings.map(of).max_by(|one, other| one.0.total_cmp(&other.0))
        };
        let tried = if self.is_round { 1 } else { 2 * self.electrodes };
        let Some((plain, placing)) = best(&mut Placing::all(self.electrodes).take(tried)) else {
            return (0.0, None);
        };
        match best(&mut placing.swaps(self.electrodes)) {
            Some((swapped, placing)) if swapped > plain + SWAP_LEAD => {
                (swapped, placing.pair(self.electrodes))
            }
            _ => (plain, None),
        }
    }
}

/// Correlation of a frame with modelled voltages, without measurements on current-carrying electrodes: of magnitudes if all values
/// have one sign, and of either polarity, since a board's is not known.
pub(crate) fn likeness(quadruples: &[[u32; 4]], frame: &[f64], modelled: &[f64]) -> f64 {
    let signed = is_signed(frame);
    let of = |values: &[f64]| {
        undriven(quadruples, values.iter().map(|value| if signed { *value } else { value.abs() }))
    };
    model_correlation(&of(frame), &of(modelled)).map_or(0.0, f64::abs)
}

/// Whether a frame has values of both signs, beyond noise.
pub(super) fn is_signed(frame: &[f64]) -> bool {
    let [least, most] =
        frame.iter().fold([0.0_f64; 2], |[l, m], value| [l.min(*value), m.max(*value)]);
    -least > SIGNED * most && most > -SIGNED * least
}

/// Measurements without those on current-carrying electrodes, which contain the contact impedance.
fn undriven(quadruples: &[[u32; 4]], values: impl Iterator<Item = f64>) -> Vec<f64> {
    let on_driven = |[a, b, m, n]: &[u32; 4]| [m, n].iter().any(|e| *e == a || *e == b);
    quadruples.iter().zip(values).filter(|(q, _)| !on_driven(q)).map(|(_, value)| value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ordinary board whose first value after each switching is off: the place is named, and the pattern is the usual one. One
    /// that is as good as a rarer pattern's is the usual one, too.
    #[test]
    fn the_usual_pattern_wins_and_a_place_that_is_off_is_named() {
        let outline = Outline::Disc { radius_m: 0.1 };
        let skin = Skin::from_scene(FirstScene::new(outline, 16).scene().unwrap()).unwrap();
        let mut frame = skin.model.forward(&skin.background_s()).unwrap().to_vec();
        let best = |frame: &[f64]| fitting_protocols(frame, outline, Some(16)).unwrap().remove(0);
        let usual = PairProtocol { electrodes: 16, ..PairProtocol::default() };
        let perfect = best(&frame);
        assert_eq!((&perfect.protocol, perfect.off), (&usual, None));
        let mut alternately = 0..;
        for first in frame.iter_mut().step_by(13) {
            *first *= [2.2, 0.3, 1.8][alternately.next().unwrap_or(0) % 3];
        }
        let found = best(&frame);
        let off = found.off.unwrap();
        assert!(found.protocol == usual && off.place == 0, "{found:?}");
        assert!(found.reciprocity > Some(WRONG_ORDER_ERROR) && !found.violates_reciprocity());
    }
}
