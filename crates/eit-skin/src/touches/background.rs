//! Estimates the untouched sheet from its reference frame: fabric is uneven, and where the current is dense a
//! few percent change the effect of a touch.

use super::choices::FoundSheet;
use super::model::{Spread, VoltageNoise, common_mode, unknowns};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::are_magnitudes;
use crate::learn::LocalSheet;
use crate::progress::Progress;
use crate::skin::Skin;
use eit_inverse::{ReferenceModel, UnevenSheet, Unevenness};
use ndarray::{Array1, Array2, ArrayView1, Axis};

/// Correlation length of the unevenness, as a fraction of the skin's longer side.
const LENGTH: f64 = 0.1;
/// Error of a voltage that no sheet explains, due to channel gains and the mesh: this fraction of the
/// voltage, ...
const ERROR: f64 = 2e-3;
/// ... and this fraction of the median voltage.
const FLOOR: f64 = 1e-4;
/// Uncertainty of electrode positions, contacts (logarithm) and gain, standard deviations.
pub(crate) const UNTOUCHED: Spread = Spread { movement_m: 5e-4, contact: 0.5, sheet: 0.05 };
/// Logarithm of the evidence above which an uneven sheet is accepted.
const BELIEVED: f64 = 10.0;
/// Largest plausible change of a conductivity, logarithm: no fabric varies by a factor of 150.
const LARGEST: f64 = 5.0;
/// Number of Gauss-Newton steps.
const STEPS: usize = 2;

/// The untouched sheet as far as its reference frame tells, and the model linearised there.
#[derive(Debug, Clone)]
pub(super) struct Sheet {
    /// The uneven sheet; `None` if an even one explains the frame as well.
    pub found: Option<Background>,
    /// Conductivity of an even sheet, siemens.
    pub even_s: Vec<f64>,
    /// What an amplifier adds to the voltages of the untouched skin, volts.
    pub leak_v: Vec<f64>,
}

impl Sheet {
    pub(super) fn new(fitted: &FittedFrames, noise: &VoltageNoise) -> Result<Self, SkinError> {
        let leak_v = leak_v(fitted, noise)?;
        let found = of_reference(fitted, noise, &leak_v)?;
        Ok(Self { found, even_s: fitted.skin.skin.background_s(), leak_v })
    }

    /// Conductivity, siemens, Jacobian and voltages.
    pub(super) fn linearised<'a>(
        &'a self,
        fitted: &'a FittedFrames,
    ) -> (&'a [f64], &'a Array2<f64>, &'a Array1<f64>) {
        match &self.found {
            Some(sheet) => (&sheet.conductivity_s, &sheet.jacobian, &sheet.voltages),
            None => (&self.even_s, &fitted.skin.jacobian, &fitted.skin.voltages),
        }
    }

    /// The sheet under a touch.
    pub(super) fn local(&self, fitted: &FittedFrames) -> LocalSheet {
        self.found.as_ref().map_or_else(LocalSheet::default, |found| {
            let surface = fitted.skin.skin.mesh.surface();
            LocalSheet::new(surface, &found.conductivity_s, &self.even_s)
        })
    }

    /// What is told of the sheet.
    pub(super) fn choice(&self) -> Option<FoundSheet> {
        self.found.as_ref().map(|sheet| FoundSheet {
            amplitude: sheet.found.amplitude,
            left_even: sheet.left[0],
            left: sheet.left[1],
        })
    }
}

/// The model linearised at the sheet that explains the reference.
#[derive(Debug, Clone)]
pub(super) struct Background {
    pub conductivity_s: Vec<f64>,
    pub voltages: Array1<f64>,
    pub jacobian: Array2<f64>,
    /// Fitted unevenness.
    pub found: Unevenness,
    /// Root mean square of the reference that an even sheet, and this one, leave unexplained, relative to its
    /// own.
    pub left: [f64; 2],
}

/// Part of the common potential that amplifiers do not reject, standard deviation: 50 dB, behind multiplexers.
pub(crate) const LEAK: f64 = 3e-3;

/// What an amplifier of finite rejection adds to the reference, volts, `[measurement]`: the part of the common potential that
/// explains it best; zero unless it is believed.
fn leak_v(fitted: &FittedFrames, noise: &VoltageNoise) -> Result<Vec<f64>, SkinError> {
    let FittedFrames { skin, frames, fit, .. } = fitted;
    let voltages = skin.voltages.to_vec();
    let even_s = skin.skin.background_s();
    let effect = Array1::from(common_mode(&skin.skin, &even_s)?).insert_axis(Axis(1)) * LEAK;
    let model = ReferenceModel {
        jacobian: &skin.jacobian,
        conductivity_s: &even_s,
        model_v: &voltages,
        reference_v: &reference_of_model(&frames.reference, &frames.used, fit.gain, &voltages),
        error_v: &reference_errors(&voltages, &noise.std_v, fit.gain),
        unknowns: &unknowns(&skin.skin, &even_s, &UNTOUCHED, &mut Progress::silent())?,
        used: &frames.used,
    };
    let found = uneven_sheet(&skin.skin)?.estimate(&model, &effect)?;
    let part = if found.log_evidence < BELIEVED { 0.0 } else { fit.gain * found.mean[0] };
    Ok(effect.iter().map(|v| part * v).collect())
}

/// Fits the sheet that explains the reference; `None` if an even one does as well or better.
fn of_reference(
    fitted: &FittedFrames,
    noise: &VoltageNoise,
    leak_v: &[f64],
) -> Result<Option<Background>, SkinError> {
    let FittedFrames { skin, frames, fit, .. } = fitted;
    let sheet = uneven_sheet(&skin.skin)?;
    let reference: Vec<f64> =
        frames.reference.iter().zip(leak_v).map(|(v, leak)| v - leak).collect();
    let reference_v =
        reference_of_model(&reference, &frames.used, fit.gain, &skin.voltages.to_vec());
    let error_v = reference_errors(&skin.voltages.to_vec(), &noise.std_v, fit.gain);
    let even_s = skin.skin.background_s();
    let unknowns = unknowns(&skin.skin, &even_s, &UNTOUCHED, &mut Progress::silent())?;
    let mut best: Option<Background> = None;
    for _ in 0..STEPS {
        let (jacobian, conductivity_s, voltages) = match &best {
            Some(best) => (&best.jacobian, &best.conductivity_s, &best.voltages),
            None => (&skin.jacobian, &even_s, &skin.voltages),
        };
        let model = ReferenceModel {
            jacobian,
            conductivity_s,
            model_v: &voltages.to_vec(),
            reference_v: &reference_v,
            error_v: &error_v,
            unknowns: &unknowns,
            used: &frames.used,
        };
        let found = sheet.fit(&model, best.as_ref().map(|best| &best.found))?;
        if found.log_evidence < BELIEVED {
            return Ok(None);
        }
        // steps diverge if the scene does not describe the skin; the frames then have a note
        if !found.log_change.iter().all(|change| change.abs() < LARGEST) {
            return Ok(None);
        }
        let uneven_s: Vec<f64> =
            even_s.iter().zip(&found.log_change).map(|(s, change)| s * change.exp()).collect();
        let mut workspace = skin.skin.model.workspace()?;
        let mut solution = skin.skin.solve(&uneven_s, &mut workspace)?;
        let (voltages, jacobian) = (solution.measurements(), solution.jacobian());
        let left = [&skin.voltages, &voltages]
            .map(|voltages| left(&reference_v, voltages.view(), &frames.used));
        best = Some(Background { conductivity_s: uneven_s, voltages, jacobian, found, left });
    }
    // if the scene does not describe the skin, steps may diverge
    Ok(best.filter(|best| best.left[1] < best.left[0]))
}

/// Basis of the unevenness of a skin's sheet.
pub(crate) fn uneven_sheet(skin: &Skin) -> Result<UnevenSheet, SkinError> {
    let surface = skin.mesh.surface();
    let [low, high] = surface.bounds_m();
    let side_m = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    Ok(UnevenSheet::new(surface, LENGTH * side_m)?)
}

/// A reference divided by its gain relative to a model's voltages; magnitudes get the model's signs.
pub(crate) fn reference_of_model(
    reference: &[f64],
    used: &[bool],
    gain: f64,
    voltages: &[f64],
) -> Vec<f64> {
    let mut reference_v: Vec<f64> = reference.iter().map(|v| v / gain).collect();
    let of_used = reference.iter().zip(used).filter(|(_, used)| **used);
    if are_magnitudes(of_used.map(|(v, _)| v)) {
        let signed = reference_v.iter_mut().zip(voltages);
        signed.for_each(|(v, of_model)| *v = v.abs().copysign(*of_model));
    }
    reference_v
}

/// Errors of a model's voltages that no sheet explains, with noise of these standard deviations in frames of a gain.
pub(crate) fn reference_errors(voltages: &[f64], noise_std_v: &[f64], gain: f64) -> Vec<f64> {
    let floor_v = FLOOR * eit_core::median(voltages.iter().map(|v| v.abs())).unwrap_or(0.0);
    let error_of = |(v, std): (&f64, &f64)| (ERROR * v).hypot(std / gain).hypot(floor_v);
    voltages.iter().zip(noise_std_v).map(error_of).collect()
}

/// Root mean square of the reference that an even sheet leaves unexplained, relative to its own.
pub(super) fn left_even(fitted: &FittedFrames) -> f64 {
    let FittedFrames { skin, frames, fit, .. } = fitted;
    let voltages = skin.voltages.to_vec();
    let reference_v = reference_of_model(&frames.reference, &frames.used, fit.gain, &voltages);
    left(&reference_v, skin.voltages.view(), &frames.used)
}

/// Root mean square of a reference minus voltages, relative to the reference's own.
fn left(reference_v: &[f64], voltages: ArrayView1<'_, f64>, used: &[bool]) -> f64 {
    let (mut rest, mut whole) = (0.0, 0.0);
    for ((v, of_model), _) in reference_v.iter().zip(voltages).zip(used).filter(|(_, used)| **used)
    {
        rest += (v - of_model).powi(2);
        whole += v * v;
    }
    (rest / whole).sqrt()
}
