//! What a touch detector needs to know about a linearised skin: other effects on its voltages, and the noise.

use super::background::Sheet;
use crate::displacement;
use crate::error::SkinError;
use crate::faults::FaultMonitor;
use crate::fitted::FittedFrames;
use crate::linearised::LinearisedSkin;
use crate::progress::Progress;
use crate::skin::Skin;
use eit_fem::{Displacement, ElementOrder};
use eit_inverse::touch::{DentPlace, DetectorModel, UnknownKind};
use eit_inverse::{noise_std_of_quiet_frames, smallest_step};
use ndarray::{Array2, Axis, concatenate};

/// Standard deviations of effects other than touches.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spread {
    /// Displacement of electrodes, metres.
    pub movement_m: f64,
    /// Logarithm of a contact impedance.
    pub contact: f64,
    /// Logarithm of the conductivity of the whole sheet.
    pub sheet: f64,
}

impl Spread {
    /// Values while the skin is in use. By default a touch moves electrodes by about 0.2 mm; without a touch
    /// they move by a small part of that, see [`UnknownKind`].
    pub(crate) fn in_use(skin: &LinearisedSkin) -> Self {
        let movement_m = skin.skin.settings.reconstruction.electrode_movement_m.unwrap_or(2e-4);
        Self { movement_m, contact: 0.05, sheet: 1e-3 }
    }
}

/// Noise of voltages, volts.
#[derive(Debug, Clone)]
pub(super) struct VoltageNoise {
    /// Standard deviation in a single frame, `[measurement]`.
    pub std_v: Vec<f64>,
    /// Smallest step of the converter seen; 0 if there is none.
    pub step_v: f64,
    /// Factor by which a reference averaged over several frames raises the standard deviation.
    pub with_reference: f64,
    /// Source of the noise, in words.
    pub source: String,
    /// Whether it was measured on frames of the untouched skin.
    pub is_measured: bool,
}

impl VoltageNoise {
    /// Returns the noise of the settings, else that of the quiet frames; `None` if it is unknown.
    pub(crate) fn of(fitted: &FittedFrames) -> Result<Option<Self>, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let with_reference = (1.0 + 1.0 / frames.reference_frames.max(1) as f64).sqrt();
        let step_v = frames.quiet.as_ref().map_or(0.0, |quiet| smallest_step(quiet.values.view()));
        let keys = &skin.skin.settings.noise;
        if let Some(additive_v) = keys.additive_v {
            let std_v = additive_v.max(step_v / 12.0_f64.sqrt());
            let source = format!("{additive_v:e} V in a voltage, from the scene");
            let std_v = vec![std_v; frames.used.len()];
            let is_measured = false;
            return Ok(Some(Self { std_v, step_v, with_reference, source, is_measured }));
        }
        let Some(quiet) = &frames.quiet else { return Ok(None) };
        match noise_std_of_quiet_frames(quiet.values.view()) {
            Ok(std_v) => {
                let source = format!("measured on {}", quiet.source);
                Ok(Some(Self { std_v, step_v, with_reference, source, is_measured: true }))
            }
            Err(error) if keys.quiet_frames.is_some() => {
                Err(SkinError::from(error).within("noise.quiet_frames"))
            }
            Err(_) => Ok(None),
        }
    }
}

/// Other effects on the voltages of a sheet, for one standard deviation each: electrode movement, the whole
/// sheet, contacts; `[measurement, unknown]`, volts.
pub(crate) fn unknowns(
    skin: &Skin,
    background_s: &[f64],
    spread: &Spread,
    progress: &mut Progress,
) -> Result<Array2<f64>, SkinError> {
    let mut workspace = skin.model.workspace()?;
    let mut solution = skin.solve(background_s, &mut workspace)?;
    let sheet = (solution.measurements() * spread.sheet).insert_axis(Axis(1));
    if skin.model.element_order() != ElementOrder::Linear {
        return Ok(sheet);
    }
    let impedances = &skin.contact_impedance;
    let mut parts = vec![sheet];
    // shunts and ideal sources have no derivative
    if impedances.iter().all(|z| *z > 0.0 && z.is_finite()) {
        let mut contacts = solution.contact_jacobian()?;
        for (mut column, z) in contacts.columns_mut().into_iter().zip(impedances) {
            column *= spread.contact * z;
        }
        parts.push(contacts);
    }
    drop(solution);
    parts.insert(0, displacement::jacobian(background_s, skin, progress)? * spread.movement_m);
    let views: Vec<_> = parts.iter().map(|part| part.view()).collect();
    concatenate(Axis(1), &views).map_err(|e| SkinError::Failure(format!("unknowns: {e}")))
}

/// Mean potential of the measured electrodes above the sink of the current, volts, `[measurement]`: what an amplifier of finite
/// rejection lets through in part.
pub(crate) fn common_mode(skin: &Skin, background_s: &[f64]) -> Result<Vec<f64>, SkinError> {
    let mut workspace = skin.model.workspace()?;
    let potentials = skin.solve(background_s, &mut workspace)?.electrode_potentials();
    let (currents, patterns) =
        (skin.protocol.stimulations_a(), skin.protocol.measurement_patterns());
    let of = |[drive, pattern]: &[u32; 2]| {
        let [drive, pattern] = [*drive, *pattern].map(|k| k as usize);
        let (potentials, weights) = (potentials.row(drive), patterns.row(pattern));
        let driven = currents.row(drive);
        let sink = driven.iter().zip(potentials).min_by(|a, b| a.0.total_cmp(b.0));
        let whole: f64 = weights.iter().map(|w| w.abs()).sum();
        let sum: f64 = weights.iter().zip(potentials).map(|(w, v)| w.abs() * v).sum();
        sum / whole - sink.map_or(0.0, |(_, v)| *v)
    };
    Ok(skin.protocol.data().iter().map(of).collect())
}

/// Radius of the strongest strain around a touch, metres: between a fingertip's contact and the width of its dent.
const DENT_M: f64 = 15e-3;
/// Distance at which a pull moves the skin by [`PULL`] times the displacement of electrodes, metres, if the dent is small.
const PULL_M: f64 = 30e-3;
const PULL: f64 = 1.0;
/// Distance at which a drag moves the skin by [`DRAG`] times the displacement of electrodes, metres (twice and four times find no
/// more fingers that slide slowly on the plate), ...
const DRAG_M: f64 = 30e-3;
const DRAG: f64 = 1.0;
/// ... and the distance up to which the skin moves as far as at the finger: half of a contact.
const CONTACT_M: f64 = 7e-3;
/// Displacements of nodes by places that are held in memory at a time: 96 bytes for each, 16 MB.
const AT_ONCE: usize = 160_000;

/// Effects of a touch on the voltages of a sheet through the fabric around it, for one standard deviation at each place: a
/// pull `u(r) = K r / (r^2 + r_0^2)` towards it, and a drag `u(r) = K ln(L / max(r, r_0))` along each of its tangents up to
/// half of the skin's longer side `L` away; `[measurement, (place, effect)]`, volts.
pub(super) fn dents(
    skin: &LinearisedSkin,
    background_s: &[f64],
    places: &[DentPlace],
    movement_m: f64,
) -> Result<Array2<f64>, SkinError> {
    let mut workspace = skin.skin.model.workspace()?;
    let mut solution = skin.skin.solve(background_s, &mut workspace)?;
    let surface = skin.skin.mesh.surface();
    let nodes_m = surface.nodes();
    let [low, high] = surface.bounds_m();
    let held_m = 0.5 * (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let drag_m = DRAG * movement_m / (held_m / DRAG_M).ln().max(1.0);
    let strength_m2 = PULL * movement_m * PULL_M;
    let effects = |place: &DentPlace| {
        let mut pull = Vec::with_capacity(nodes_m.len());
        let mut drags = [pull.clone(), pull.clone()];
        for node_m in nodes_m {
            let way: [f64; 3] = std::array::from_fn(|k| place.position_m[k] - node_m[k]);
            let squared: f64 = way.iter().map(|w| w * w).sum();
            pull.push(way.map(|w| strength_m2 * w / (squared + DENT_M * DENT_M)));
            let far = held_m / squared.sqrt().max(CONTACT_M);
            let dragged = drag_m * far.ln().max(0.0);
            let along = drags.iter_mut().zip(place.tangents);
            along.for_each(|(drag, tangent)| drag.push(tangent.map(|t| dragged * t)));
        }
        let [first, second] = drags;
        [pull, first, second].map(|field| Displacement::of_field(&field))
    };
    let mut parts = Vec::new();
    for places in places.chunks((AT_ONCE / nodes_m.len().max(1)).max(1)) {
        let dents: Vec<Displacement> = places.iter().flat_map(effects).collect();
        parts.push(solution.movement_jacobian(&dents)?);
    }
    let views: Vec<_> = parts.iter().map(|part| part.view()).collect();
    concatenate(Axis(1), &views).map_err(|e| SkinError::Failure(format!("dents: {e}")))
}

/// Displacement of the skin under a finger by the drag of [`dents`], relative to that of electrodes.
pub(super) fn drag_at_finger(skin: &LinearisedSkin) -> f64 {
    let [low, high] = skin.skin.mesh.surface().bounds_m();
    let held_m = 0.5 * (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let at_finger = (held_m / CONTACT_M).ln() / (held_m / DRAG_M).ln().max(1.0);
    DRAG * at_finger.max(f64::MIN_POSITIVE)
}

/// What each column of [`unknowns`] is.
fn electrode_kinds(skin: &LinearisedSkin, unknowns: usize) -> Result<Vec<UnknownKind>, SkinError> {
    if unknowns == 1 {
        return Ok(vec![UnknownKind::Other]);
    }
    let mesh = &skin.skin.mesh;
    let directions = displacement::directions(mesh)?;
    let displacement = |[at_m, along]: [[f64; 3]; 2]| UnknownKind::Displacement { at_m, along };
    let moved = directions.into_iter().map(displacement);
    let contact = |at_m| UnknownKind::Contact { at_m };
    let centres = (0..mesh.electrodes().len()).filter_map(|e| mesh.electrode_centre_m(e));
    let kinds = moved.chain([UnknownKind::Other]).chain(centres.map(contact));
    Ok(kinds.take(unknowns).collect())
}

/// A skin as touches are sought in its frames: linearised at the sheet that explains its reference.
pub(super) struct SoughtSkin<'a> {
    fitted: &'a FittedFrames,
    monitor: &'a FaultMonitor,
    /// Conductivity of the sheet, siemens.
    pub background_s: &'a [f64],
    jacobian: &'a Array2<f64>,
    model_v: Vec<f64>,
    unknowns: Array2<f64>,
    kinds: Vec<UnknownKind>,
}

impl<'a> SoughtSkin<'a> {
    /// Computes the other effects on the voltages, for one standard deviation of each.
    pub(super) fn new(
        fitted: &'a FittedFrames,
        sheet: &'a Sheet,
        monitor: &'a FaultMonitor,
        spread: &Spread,
    ) -> Result<Self, SkinError> {
        let (background_s, jacobian, voltages) = sheet.linearised(fitted);
        let model_v = voltages.to_vec();
        let skin = &fitted.skin;
        let unknowns = unknowns(&skin.skin, background_s, spread, &mut Progress::silent())?;
        let kinds = electrode_kinds(skin, unknowns.ncols())?;
        Ok(Self { fitted, monitor, background_s, jacobian, model_v, unknowns, kinds })
    }

    /// Whether electrodes move, and with them the fabric: not on every kind of mesh.
    pub(super) fn is_moving(&self) -> bool {
        self.unknowns.ncols() > 1
    }

    /// What a detector is told, with the noise of a frame.
    pub(super) fn model<'b>(&'b self, noise_std_v: &'b [f64]) -> DetectorModel<'b> {
        let FittedFrames { skin, frames, .. } = self.fitted;
        let no_frames = frames.values.slice_axis(Axis(0), (0..0).into());
        DetectorModel {
            surface: skin.skin.mesh.surface(),
            jacobian: self.jacobian,
            model_v: &self.model_v,
            unknowns: &self.unknowns,
            kinds: &self.kinds,
            reference_v: &frames.reference,
            noise_std_v,
            quiet_v: frames.quiet.as_ref().map_or(no_frames, |quiet| quiet.values.view()),
            used: &frames.used,
            reciprocal: self.monitor.reciprocal(),
            of_electrode: self.monitor.of_electrode(),
        }
    }
}
