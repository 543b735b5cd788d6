//! Determines which electrode is the first and in which direction they are counted.

use super::protocols::{NODES, SWAP_LEAD, is_signed};
use super::transfer::{PairMatrix, Placing, Transfer};
use super::{FirstScene, Outline};
use crate::error::SkinError;
use crate::scene::{ChangeSign, Direction};
use crate::skin::Skin;
use eit_hw::model_correlation;
use ndarray::Array1;

/// Radius of a press, metres: exp(-(d / radius)^2). That of a fingertip, and at least what the mesh of the
/// comparison resolves.
const PRESS_RADIUS_M: f64 = 0.007;
const MESH_RADII: f64 = 0.08;
/// Channels below this fraction of the largest voltage are not compared: their ratios are noise.
const LEAST_VOLTAGE: f64 = 1e-3;
/// Points per side of the grid on which a press is sought.
const GRID: usize = 25;

/// A press at a known place.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct KnownPress {
    /// Its position, metres.
    pub place_m: [f64; 2],
    /// Frame with the press minus frame without it, in the frame's unit.
    pub change: Vec<f64>,
}

/// The numbering that explains the presses best.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Numbering {
    /// Position of electrode 1, counter-clockwise from +x as seen from the centre, degrees.
    pub first_angle_deg: f64,
    /// Direction in which electrodes are counted.
    pub direction: Direction,
    /// Whether a touch raises or lowers the conductivity.
    pub sign: ChangeSign,
    /// Mean cosine between the measured changes and the model's changes for presses at their places; 1 is
    /// perfect.
    pub likeness: f64,
    /// The same for the next best numbering.
    pub next_likeness: f64,
    /// Distance from each press to the place that explains it best, metres.
    pub errors_m: Vec<f64>,
    /// Two neighbouring electrodes whose wires look exchanged, from 0. The other results hold once they are exchanged
    /// back.
    pub swapped: Option<[usize; 2]>,
}

/// Finds the numbering of the electrodes from presses at known places.
///
/// There are `2 n` numberings of `n` places along the rim (each first electrode, both directions), and each of them with
/// the wires of two neighbours exchanged. The result is the one whose modelled changes are most like the measured ones;
/// one with exchanged wires only if no other is nearly as like. Channels are compared as relative changes times the
/// model's voltage, so neither unit, gain nor polarity matters. `reference` is the frame of the untouched skin. Cost: one
/// forward solve with Jacobian on a mesh of 1 500 nodes, a fraction of a second.
///
/// Two presses at [`Outline::press_places_m`] distinguish all numberings; a single press leaves a mirror
/// image.
///
/// # Errors
/// No press; a change or reference with the wrong length for the protocol; a reference without a nonzero
/// voltage.
pub fn find_numbering(
    first: &FirstScene,
    reference: &[f64],
    presses: &[KnownPress],
) -> Result<Numbering, SkinError> {
    let base = FirstScene { direction: Direction::Counterclockwise, ..first.clone() };
    let mut scene = base.scene()?;
    scene.mesh.nodes = Some(NODES);
    let skin = Skin::from_scene(scene)?;
    let quadruples = first.protocol.quadruples()?;
    check(&quadruples, reference, presses)?;
    let search = Search::new(&skin, first, &quadruples, reference, presses)?;
    let mut tried: Vec<Tried> =
        Placing::all(first.electrodes).map(|p| search.try_placing(p)).collect();
    tried.sort_by(|one, other| other.score.abs().total_cmp(&one.score.abs()));
    let swaps = Placing::all(first.electrodes).flat_map(|p| p.swaps(first.electrodes));
    let swapped = swaps
        .map(|placing| search.try_placing(placing))
        .max_by(|one, other| one.score.abs().total_cmp(&other.score.abs()))
        .filter(|swapped| swapped.score.abs() > tried[0].score.abs() + SWAP_LEAD);
    let best = swapped.unwrap_or(tried[0]);
    // the next best without exchanged wires, or with the same ones: neighbouring exchanges are much alike
    let next = match swapped {
        None => tried[1],
        Some(best) => {
            let others = Placing::all(first.electrodes)
                .map(|p| Placing { swapped: best.placing.swapped, ..p });
            let others = others.filter(|p| *p != best.placing).map(|p| search.try_placing(p));
            others
                .chain([tried[0]])
                .max_by(|a, b| a.score.abs().total_cmp(&b.score.abs()))
                .unwrap_or(tried[0])
        }
    };
    Ok(Numbering {
        first_angle_deg: place_angle_deg(&skin, best.placing.start),
        direction: match best.placing.is_clockwise {
            true => Direction::Clockwise,
            false => Direction::Counterclockwise,
        },
        sign: if best.likeness < 0.0 { ChangeSign::Decrease } else { ChangeSign::Increase },
        likeness: best.likeness.abs(),
        next_likeness: next.likeness.abs(),
        errors_m: presses.iter().map(|press| search.error_m(best, press)).collect(),
        swapped: best.placing.pair(first.electrodes),
    })
}

/// A numbering and how well it explains the presses.
#[derive(Debug, Clone, Copy)]
struct Tried {
    placing: Placing,
    /// Mean cosine between measured and modelled changes; negative if touches lower the conductivity.
    likeness: f64,
    /// `likeness` times the correlation of the untouched frame, which may also depend on the numbering.
    score: f64,
}

/// The model, and the presses to be explained.
struct Search<'a> {
    first: &'a FirstScene,
    quadruples: &'a [[u32; 4]],
    reference: &'a [f64],
    presses: &'a [KnownPress],
    transfer: Transfer,
    untouched: PairMatrix,
    /// Modelled presses at the places of the measured ones.
    pressed: Vec<PairMatrix>,
    centroids: Vec<[f64; 3]>,
}

impl<'a> Search<'a> {
    fn new(
        skin: &Skin,
        first: &'a FirstScene,
        quadruples: &'a [[u32; 4]],
        reference: &'a [f64],
        presses: &'a [KnownPress],
    ) -> Result<Self, SkinError> {
        let transfer = Transfer::new(skin, first.protocol.current_a)?;
        let centroids = skin.mesh.surface().centroids();
        let radius_m = press_radius_m(first.outline);
        let bells = presses.iter().map(|press| bell(&centroids, press.place_m, radius_m));
        let pressed = bells.map(|bell| transfer.change(&bell)).collect();
        let untouched = transfer.untouched();
        Ok(Self { first, quadruples, reference, presses, transfer, untouched, pressed, centroids })
    }

    fn try_placing(&self, placing: Placing) -> Tried {
        let mapped = placing.map(self.quadruples, self.first.electrodes);
        let voltages = self.untouched.measured(&mapped);
        let cosines = self.presses.iter().zip(&self.pressed).map(|(press, model)| {
            cosine(&scaled(&voltages, self.reference, &press.change), &model.measured(&mapped))
        });
        let likeness = cosines.sum::<f64>() / self.presses.len() as f64;
        Tried { placing, likeness, score: likeness * correlation(&voltages, self.reference) }
    }

    /// Distance from a press to the grid point whose modelled press is most like its change, metres.
    fn error_m(&self, best: Tried, press: &KnownPress) -> f64 {
        let mapped = best.placing.map(self.quadruples, self.first.electrodes);
        let voltages = self.untouched.measured(&mapped);
        let change = scaled(&voltages, self.reference, &press.change) * best.likeness.signum();
        let outline = self.first.outline;
        let ([x, y], radius_m) = (outline.half_extent_m(), press_radius_m(outline));
        let step = |k: usize| 2.0 * (k as f64 + 0.5) / GRID as f64 - 1.0;
        let points = (0..GRID * GRID).map(|k| [x * step(k % GRID), y * step(k / GRID)]);
        let likest = points
            .map(|point| {
                let model = self.transfer.change(&bell(&self.centroids, point, radius_m));
                (cosine(&change, &model.measured(&mapped)), point)
            })
            .max_by(|one, other| one.0.total_cmp(&other.0));
        let found = likest.map_or([0.0; 2], |(_, point)| point);
        (found[0] - press.place_m[0]).hypot(found[1] - press.place_m[1])
    }
}

fn check(
    quadruples: &[[u32; 4]],
    reference: &[f64],
    presses: &[KnownPress],
) -> Result<(), SkinError> {
    if presses.is_empty() {
        return Err(SkinError::input(
            "no press is given: finding the numbering of electrodes needs one or more",
        ));
    }
    let frames = presses.iter().map(|press| &press.change[..]);
    for frame in std::iter::once(reference).chain(frames) {
        if frame.len() != quadruples.len() {
            return Err(SkinError::input(format!(
                "a frame has {} values, the protocol {} measurements",
                frame.len(),
                quadruples.len()
            )));
        }
    }
    if !reference.iter().any(|value| value.is_finite() && *value != 0.0) {
        return Err(SkinError::input("the untouched frame has no voltage other than 0"));
    }
    Ok(())
}

fn press_radius_m(outline: Outline) -> f64 {
    let [x, y] = outline.half_extent_m();
    PRESS_RADIUS_M.max(MESH_RADII * x.min(y))
}

fn bell(centroids: &[[f64; 3]], place_m: [f64; 2], radius_m: f64) -> Array1<f64> {
    let value = |[x, y, _]: &[f64; 3]| {
        (-((x - place_m[0]).powi(2) + (y - place_m[1]).powi(2)) / radius_m.powi(2)).exp()
    };
    centroids.iter().map(value).collect()
}

/// Angle of a place along the rim, counter-clockwise from +x, in [0, 360).
fn place_angle_deg(skin: &Skin, place: usize) -> f64 {
    let [x, y, _] = skin.mesh.electrode_centre_m(place).unwrap_or_default();
    // to a thousandth of a degree: the mesh approximates arcs by chords
    let angle = (y.atan2(x).to_degrees().rem_euclid(360.0) * 1e3).round() / 1e3;
    if angle >= 360.0 { 0.0 } else { angle }
}

fn cosine(one: &Array1<f64>, other: &Array1<f64>) -> f64 {
    let sizes = (one.dot(one) * other.dot(other)).sqrt();
    if sizes > 0.0 { one.dot(other) / sizes } else { 0.0 }
}

/// A measured change in the model's volts: the relative change times the model's voltage.
fn scaled(voltages: &Array1<f64>, reference: &[f64], change: &[f64]) -> Array1<f64> {
    let largest = reference.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let channels = voltages.iter().zip(reference.iter().zip(change));
    channels
        .map(|(model, (value, change))| {
            let is_used = value.abs() > LEAST_VOLTAGE * largest && change.is_finite();
            if is_used { model * change / value } else { 0.0 }
        })
        .collect()
}

/// Correlation of modelled voltages with the untouched frame, regardless of polarity; of magnitudes if the frame has no
/// signs.
fn correlation(voltages: &Array1<f64>, reference: &[f64]) -> f64 {
    let value = |value: &f64| if is_signed(reference) { *value } else { value.abs() };
    let measured: Vec<f64> = reference.iter().map(value).collect();
    let modelled: Vec<f64> = voltages.iter().map(value).collect();
    model_correlation(&measured, &modelled).map_or(0.0, f64::abs)
}
