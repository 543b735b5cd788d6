//! Pair protocols that match what a board prints.

use super::{FirstScene, Outline};
use crate::error::SkinError;
use crate::skin::Skin;
use eit_fem::{DrivenElectrodes, ForwardModel, Order, PairPattern, PairProtocol, Protocol};
use eit_hw::{model_correlation, reciprocity_error};

/// Largest number of electrodes tried if it is not known.
const MOST_ELECTRODES: usize = 64;
/// Reciprocity error above which an order is doubted (as in [`eit_hw::recognise_order`]).
const DOUBTED_ERROR: f64 = 0.2;
/// A frame has both signs if the largest value of one is above this fraction of the other's.
const SIGNED: f64 = 0.05;
/// Number of mesh nodes for the comparison: discretisation errs by a few percent at the electrodes, wrong
/// orders by tens.
pub(super) const NODES: usize = 1500;

/// A protocol with as many measurements as a frame has values.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct FittingProtocol {
    /// The protocol.
    pub protocol: PairProtocol,
    /// Reciprocity error of the frame in its order ([`reciprocity_error`]); `None` if it has no reciprocal
    /// pairs.
    pub reciprocity: Option<f64>,
    /// Correlation with the untouched model, for the electrode numbering that fits best; 1 is perfect.
    /// Compares magnitudes if all values have one sign; ignores polarity otherwise.
    pub correlation: f64,
}

impl FittingProtocol {
    /// Returns whether reciprocity contradicts the order.
    pub fn is_doubted(&self) -> bool {
        self.reciprocity.is_some_and(|error| error > DOUBTED_ERROR)
    }
}

/// Finds pair protocols with as many measurements as `frame` has values. Those that reciprocity does not
/// contradict come first, sorted by their correlation with the model.
///
/// Tries adjacent, skip-N and opposite drive, measured on adjacent pairs or on pairs like the driven ones,
/// with and without current-carrying electrodes, in both orders, for `electrodes` electrodes or, if `None`,
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
        let candidates = candidates(count, frame.len());
        if candidates.is_empty() {
            continue;
        }
        let model = Untouched::new(outline, count)?;
        for (protocol, quadruples) in candidates {
            let reciprocity = reciprocity_error(&quadruples, frame);
            let correlation = model.correlation(&protocol, frame)?;
            fitting.push(FittingProtocol { protocol, reciprocity, correlation });
        }
    }
    fitting.sort_by(|one, other| {
        let rank = (one.is_doubted(), -one.correlation);
        rank.partial_cmp(&(other.is_doubted(), -other.correlation))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    Ok(fitting)
}

/// Protocols with this number of electrodes and values, each order once.
fn candidates(electrodes: usize, values: usize) -> Vec<(PairProtocol, Vec<[u32; 4]>)> {
    let mut drives = vec![PairPattern::Adjacent];
    // skip-N beyond half of the electrodes equals skip-M from the other side; half is "opposite"
    drives
        .extend((1..).take_while(|between| 2 * (between + 1) < electrodes).map(PairPattern::Skip));
    drives.extend(electrodes.is_multiple_of(2).then_some(PairPattern::Opposite));
    let mut found: Vec<(PairProtocol, Vec<[u32; 4]>)> = Vec::new();
    for drive in &drives {
        for measure in [&PairPattern::Adjacent, drive] {
            for driven_electrodes in [DrivenElectrodes::Drop, DrivenElectrodes::Keep] {
                for order in [Order::Rotated, Order::Ascending] {
                    let (drive, measure) = (drive.clone(), measure.clone());
                    let current_a = PairProtocol::default().current_a;
                    let protocol = PairProtocol {
                        electrodes,
                        drive,
                        measure,
                        driven_electrodes,
                        order,
                        current_a,
                    };
                    // for example four electrodes with opposite drive: nothing is left to measure
                    let Ok(quadruples) = protocol.quadruples() else { continue };
                    if quadruples.len() == values && found.iter().all(|known| known.1 != quadruples)
                    {
                        found.push((protocol, quadruples));
                    }
                }
            }
        }
    }
    found
}

/// The untouched skin, which any protocol can measure.
pub(super) struct Untouched {
    skin: Skin,
    /// Number of first electrodes to try: on a disc all numberings are alike.
    starts: usize,
}

impl Untouched {
    fn new(outline: Outline, electrodes: usize) -> Result<Self, SkinError> {
        let mut scene = FirstScene::new(outline, electrodes).scene()?;
        scene.mesh.nodes = Some(NODES);
        let skin = Skin::from_scene(scene)?;
        let starts = match outline {
            Outline::Disc { .. } => 1,
            Outline::Rectangle { .. } => electrodes,
        };
        Ok(Self { skin, starts })
    }

    /// Correlation for the numbering that fits best.
    fn correlation(&self, protocol: &PairProtocol, frame: &[f64]) -> Result<f64, SkinError> {
        let quadruples = protocol.quadruples()?;
        let is_signed = is_signed(frame);
        let mut best = 0.0_f64;
        for start in 0..self.starts {
            for is_clockwise in [false, true] {
                let mapped = renumbered(&quadruples, protocol.electrodes, start, is_clockwise);
                let protocol =
                    Protocol::from_quadruples(protocol.electrodes, &mapped, protocol.current_a)?;
                let (mesh, contacts) = (&self.skin.mesh, &self.skin.contact_impedance);
                let model = ForwardModel::new(mesh, &protocol, contacts)?;
                let voltages = model.forward(&self.skin.background_s())?;
                let value = |value: &f64| if is_signed { *value } else { value.abs() };
                let modelled: Vec<f64> = undriven(&mapped, voltages.iter().map(value));
                let measured: Vec<f64> = undriven(&mapped, frame.iter().map(value));
                // the board's polarity is unknown
                best = best.max(model_correlation(&measured, &modelled).map_or(0.0, f64::abs));
                if self.starts == 1 {
                    break;
                }
            }
        }
        Ok(best)
    }
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

/// Quadruples in terms of places along the rim, where electrode `i` of the board is at place `start + i`, or
/// `start - i` if the board counts clockwise.
pub(super) fn renumbered(
    quadruples: &[[u32; 4]],
    electrodes: usize,
    start: usize,
    is_clockwise: bool,
) -> Vec<[u32; 4]> {
    let place = |electrode: u32| {
        let electrode = electrode as usize % electrodes;
        let step = if is_clockwise { electrodes - electrode } else { electrode };
        ((start + step) % electrodes) as u32
    };
    quadruples.iter().map(|quadruple| quadruple.map(place)).collect()
}
