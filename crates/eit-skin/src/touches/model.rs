//! What a detector of touches needs of a linearised skin: what else changes its voltages, and the
//! noise.

use crate::displacement;
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::linearised::LinearisedSkin;
use crate::progress::Progress;
use eit_fem::ElementOrder;
use eit_inverse::{noise_std_of_quiet_frames, smallest_step};
use ndarray::{Array2, Axis, concatenate};

/// How far electrodes go with the fabric where the scene does not say, standard deviation, metres.
const MOVEMENT_M: f64 = 2e-4;
/// Standard deviation of the logarithm of a contact impedance.
const CONTACT: f64 = 0.05;
/// Standard deviation of the logarithm of the conductivity of the whole sheet.
const SHEET: f64 = 1e-3;

/// Noise of voltages, volts.
#[derive(Debug, Clone)]
pub(super) struct VoltageNoise {
    /// Of a single frame, `[measurement]`.
    pub std_v: Vec<f64>,
    /// Smallest step of the converter that was seen; 0 where there is none.
    pub step_v: f64,
    /// Factor of the standard deviation that a reference of several frames adds.
    pub with_reference: f64,
    /// Where it came from, in words.
    pub source: String,
}

impl VoltageNoise {
    /// That which the settings state, else that of the quiet frames; `None` where it is unknown.
    pub fn of(fitted: &FittedFrames) -> Result<Option<Self>, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let with_reference = (1.0 + 1.0 / frames.reference_frames.max(1) as f64).sqrt();
        let step_v = frames.quiet.as_ref().map_or(0.0, |quiet| smallest_step(quiet.values.view()));
        let keys = &skin.skin.settings.noise;
        if let Some(additive_v) = keys.additive_v {
            let std_v = additive_v.max(step_v / 12.0_f64.sqrt());
            let source = format!("{additive_v:e} V in a voltage, from the scene");
            let std_v = vec![std_v; frames.used.len()];
            return Ok(Some(Self { std_v, step_v, with_reference, source }));
        }
        let Some(quiet) = &frames.quiet else { return Ok(None) };
        match noise_std_of_quiet_frames(quiet.values.view()) {
            Ok(std_v) => {
                let source = format!("measured on {}", quiet.source);
                Ok(Some(Self { std_v, step_v, with_reference, source }))
            }
            Err(error) if keys.quiet_frames.is_some() => {
                Err(SkinError::from(error).within("noise.quiet_frames"))
            }
            Err(_) => Ok(None),
        }
    }
}

/// What else changes the voltages, for one standard deviation each: movement of electrodes, their
/// contacts, the sheet as a whole; `[measurement, unknown]`, volts.
pub(super) fn unknowns(
    skin: &LinearisedSkin,
    progress: &mut Progress,
) -> Result<Array2<f64>, SkinError> {
    let sheet = (&skin.voltages * SHEET).insert_axis(Axis(1));
    let is_linear = skin.skin.model.element_order() == ElementOrder::Linear;
    if !is_linear {
        return Ok(sheet);
    }
    let background = skin.skin.background_s();
    let movement_m = skin.skin.settings.reconstruction.electrode_movement_m.unwrap_or(MOVEMENT_M);
    let movement = match &skin.movement {
        Some(movement) => movement.clone(),
        None => displacement::jacobian(&background, &skin.skin, progress)?,
    };
    let mut parts = vec![movement * movement_m, sheet];
    let impedances = &skin.skin.contact_impedance;
    // shunts and ideal sources have no derivative
    if impedances.iter().all(|z| *z > 0.0 && z.is_finite()) {
        let mut workspace = skin.skin.model.workspace()?;
        let mut contacts = skin.skin.solve(&background, &mut workspace)?.contact_jacobian()?;
        for (mut column, z) in contacts.columns_mut().into_iter().zip(impedances) {
            column *= CONTACT * z;
        }
        parts.push(contacts);
    }
    let views: Vec<_> = parts.iter().map(|part| part.view()).collect();
    concatenate(Axis(1), &views).map_err(|e| SkinError::Failure(format!("unknowns: {e}")))
}
