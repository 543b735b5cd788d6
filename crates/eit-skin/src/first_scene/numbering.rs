//! Determines which electrode is the first and in which direction they are counted.

use super::protocols::{NODES, is_signed, renumbered};
use super::{FirstScene, Outline};
use crate::error::SkinError;
use crate::scene::{Direction, TouchSign};
use crate::skin::Skin;
use eit_fem::{ForwardModel, Protocol};
use eit_hw::model_correlation;
use ndarray::{Array1, Array2};

/// Radius of a press, metres: exp(-(d / radius)^2). That of a fingertip, and at least what the mesh of the
/// comparison resolves.
const PRESS_RADIUS_M: f64 = 0.007;
const MESH_RADII: f64 = 0.08;
/// Channels below this fraction of the largest voltage are not compared: their ratios are noise.
const LEAST_VOLTAGE: f64 = 1e-3;
/// Points per side of the grid on which a press is sought.
const GRID: usize = 25;

/// A press at a known place.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct KnownPress {
    /// Its position, metres.
    pub place_m: [f64; 2],
    /// Frame with the press minus frame without it, in the frame's unit.
    pub change: Vec<f64>,
}

/// The numbering that explains the presses best.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Numbering {
    /// Position of electrode 1, counter-clockwise from +x as seen from the centre, degrees.
    pub first_angle_deg: f64,
    /// Direction in which electrodes are counted.
    pub direction: Direction,
    /// Whether a touch raises or lowers the conductivity.
    pub sign: TouchSign,
    /// Mean cosine between the measured changes and the model's changes for presses at their places; 1 is
    /// perfect.
    pub likeness: f64,
    /// The same for the next best numbering.
    pub next_likeness: f64,
    /// Distance from each press to the place that explains it best, metres.
    pub errors_m: Vec<f64>,
}

/// Finds the numbering of the electrodes from presses at known places.
///
/// There are `2 n` numberings of `n` places along the rim (each first electrode, both directions). The result
/// is the one whose modelled changes are most like the measured ones. Channels are compared as relative
/// changes times the model's voltage, so neither unit, gain nor polarity matters. `reference` is the frame of
/// the untouched skin. Cost: `2 n` forward solves with Jacobian on a mesh of 1 500 nodes, a fraction of a
/// second for 16 electrodes.
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
    let centroids = skin.mesh.surface().centroids();
    let radius_m = press_radius_m(first.outline);
    let bells: Vec<Array1<f64>> =
        presses.iter().map(|press| bell(&centroids, press.place_m, radius_m)).collect();
    let mut tried = Vec::new();
    for start in 0..first.electrodes {
        for is_clockwise in [false, true] {
            let mapped = renumbered(&quadruples, first.electrodes, start, is_clockwise);
            let model = Linear::new(&skin, &mapped, first.protocol.current_a)?;
            let changes = presses.iter().map(|press| model.scaled(reference, &press.change));
            let cosines = changes
                .zip(&bells)
                .map(|(change, bell)| cosine(&change, &model.jacobian.dot(bell)));
            let mean = cosines.sum::<f64>() / presses.len() as f64;
            // weight by the untouched frame, which may also depend on the numbering
            let untouched = model.likeness(reference);
            tried.push((mean * untouched, mean, start, is_clockwise));
        }
    }
    tried.sort_by(|one, other| other.0.abs().total_cmp(&one.0.abs()));
    let [(_, likeness, start, is_clockwise), next] = [tried[0], tried[1]];
    let mapped = renumbered(&quadruples, first.electrodes, start, is_clockwise);
    let model = Linear::new(&skin, &mapped, first.protocol.current_a)?;
    let errors_m = presses
        .iter()
        .map(|press| {
            let change = model.scaled(reference, &press.change) * likeness.signum();
            let found = model.place(&change, &centroids, first.outline);
            (found[0] - press.place_m[0]).hypot(found[1] - press.place_m[1])
        })
        .collect();
    Ok(Numbering {
        first_angle_deg: place_angle_deg(&skin, start),
        direction: if is_clockwise { Direction::Clockwise } else { Direction::Counterclockwise },
        sign: if likeness < 0.0 { TouchSign::Decrease } else { TouchSign::Increase },
        likeness: likeness.abs(),
        next_likeness: next.1.abs(),
        errors_m,
    })
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

/// The linearised skin, measured with one numbering.
struct Linear {
    voltages: Array1<f64>,
    jacobian: Array2<f64>,
}

impl Linear {
    fn new(skin: &Skin, quadruples: &[[u32; 4]], current_a: f64) -> Result<Self, SkinError> {
        let protocol =
            Protocol::from_quadruples(skin.mesh.electrodes().len(), quadruples, current_a)?;
        let model = ForwardModel::new(&skin.mesh, &protocol, &skin.contact_impedance)?;
        let background = skin.background_s();
        let mut workspace = model.workspace()?;
        let mut solution = model.solve(&background, &mut workspace)?;
        Ok(Self { voltages: solution.measurements(), jacobian: solution.jacobian() })
    }

    /// A measured change in the model's volts: the relative change times the model's voltage.
    fn scaled(&self, reference: &[f64], change: &[f64]) -> Array1<f64> {
        let largest = reference.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let channels = self.voltages.iter().zip(reference.iter().zip(change));
        channels
            .map(|(model, (value, change))| {
                let is_used = value.abs() > LEAST_VOLTAGE * largest && change.is_finite();
                if is_used { model * change / value } else { 0.0 }
            })
            .collect()
    }

    /// Correlation with the untouched frame, regardless of polarity; of magnitudes if the frame has no signs.
    fn likeness(&self, reference: &[f64]) -> f64 {
        let value = |value: &f64| if is_signed(reference) { *value } else { value.abs() };
        let measured: Vec<f64> = reference.iter().map(value).collect();
        let modelled: Vec<f64> = self.voltages.iter().map(value).collect();
        model_correlation(&measured, &modelled).map_or(0.0, f64::abs)
    }

    /// The grid point whose modelled press is most like the change.
    fn place(&self, change: &Array1<f64>, centroids: &[[f64; 3]], outline: Outline) -> [f64; 2] {
        let ([x, y], radius_m) = (outline.half_extent_m(), press_radius_m(outline));
        let step = |k: usize| 2.0 * (k as f64 + 0.5) / GRID as f64 - 1.0;
        let points = (0..GRID * GRID).map(|k| [x * step(k % GRID), y * step(k / GRID)]);
        let best = points
            .map(|point| {
                let response = self.jacobian.dot(&bell(centroids, point, radius_m));
                (cosine(change, &response), point)
            })
            .max_by(|one, other| one.0.total_cmp(&other.0));
        best.map_or([0.0; 2], |(_, point)| point)
    }
}
