//! The weave of a fabric: how much better it conducts along one direction than across.
//!
//! Woven and knitted fabrics conduct 1.1 to 7 times as well along one direction as across, and a model of a scalar
//! sheet then finds touches at the wrong places, or none. Ratio and angle follow from the reference frame, whatever
//! its gain, because a sheet of scalar conductivity cannot give the same voltages on the same outline.

use crate::error::SkinError;
use crate::frames::ALIKE;
use crate::progress::Progress;
use crate::skin::Skin;
use crate::touches::{
    LEAK, UNTOUCHED, common_mode, reference_errors, reference_of_model, uneven_sheet, unknowns,
};
use eit_fem::Anisotropy;
use eit_inverse::ReferenceModel;
#[cfg(doc)]
use eit_inverse::UnevenSheet;
use ndarray::{Array1, Axis, concatenate};

/// Ratio and direction of the conductivity of a whole sheet.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Weave {
    /// Conductivity along divided by that across, above zero; at least 1 where it was found.
    pub ratio: f64,
    /// Angle from the x axis to the direction along, counter-clockwise seen from +z, degrees from -90 to 90
    /// ([`Anisotropy::uniform`] says what it is on curved skins).
    pub angle_deg: f64,
}

/// A weave that was found from a reference frame.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FoundWeave {
    /// Ratio and angle.
    pub weave: Weave,
    /// Standard deviation of the logarithm of the ratio, ...
    pub ratio_std: f64,
    /// ... and of the angle, degrees.
    pub angle_std_deg: f64,
    /// Logarithm of the evidence relative to that of a scalar sheet.
    pub log_evidence: f64,
}

/// Standard deviation of the logarithm of a fabric's ratio before anything is known: 1.1 to 7.2 were measured
/// (docs/FABRIC.md), most below 4.
const PRIOR: f64 = 0.7;
/// Logarithm of the evidence above which a weave is accepted: odds of 20 000 to 1.
const ACCEPTED: f64 = 10.0;
/// Largest plausible ratio, as in a scene.
const MOST: f64 = 10.0;
/// Largest number of Gauss-Newton steps; from a ratio of 2.5 it takes five.
const STEPS: usize = 12;
/// Change of a component at which the steps end: a hundredth of the error that is allowed.
const SETTLED: f64 = 1e-4;
/// Largest step of a component.
const LONGEST: f64 = 0.5;

impl Weave {
    /// Weave of these components: `ln(ratio)` times cosine and sine of twice the angle.
    fn of_components([x, y]: [f64; 2]) -> Self {
        Self { ratio: x.hypot(y).exp(), angle_deg: (0.5 * y.atan2(x)).to_degrees() }
    }

    /// Describes the weave for people.
    pub fn description(&self) -> String {
        format!(
            "conducts {:.2} times as well along {:.0} degrees (counter-clockwise from x) as across",
            self.ratio, self.angle_deg
        )
    }
}

impl FoundWeave {
    /// Describes the weave and its errors for people, with the keys that set it.
    pub fn description(&self) -> String {
        format!(
            "the fabric {}, to {:.1} % and {:.1} degrees, by the reference frame; [skin] weave_ratio = {:.3} and \
             weave_angle_deg = {:.1} say so",
            self.weave.description(),
            100.0 * self.ratio_std,
            self.angle_std_deg,
            self.weave.ratio,
            self.weave.angle_deg
        )
    }
}

impl Skin {
    /// Returns the same skin of a fabric that conducts better along one direction than across.
    ///
    /// # Errors
    ///
    /// A ratio or angle that is not finite, or a ratio that is not above zero.
    pub fn with_weave(&self, weave: Weave) -> Result<Self, SkinError> {
        let angle_rad = weave.angle_deg.to_radians();
        let anisotropy = Anisotropy::uniform(self.mesh.surface(), weave.ratio, angle_rad)?;
        Ok(self.of_weave(weave, self.model.clone().with_anisotropy(&anisotropy)?))
    }

    /// Finds the weave of a fabric from a frame of the untouched skin, `[measurement]` in any unit, and whether each
    /// measurement is used; `None` if a scalar sheet explains it as well, or if the scene states a weave.
    ///
    /// Gauss-Newton steps on both components of the weave, with the unevenness of the sheet, contacts, places
    /// of electrodes and gain as unknowns ([`UnevenSheet::estimate`]).
    ///
    /// # Errors
    ///
    /// Another number of values than measurements; errors of the model.
    pub fn find_weave(
        &self,
        reference: &[f64],
        used: &[bool],
    ) -> Result<Option<FoundWeave>, SkinError> {
        if self.weave.is_some() {
            return Ok(None);
        }
        let (mut components, mut log_evidence) = ([0.0; 2], None);
        for _ in 0..STEPS {
            let here = Weave::of_components(components);
            let skin = self.with_weave(here)?;
            let Some(step) = step(&skin, reference, used, here)? else { return Ok(None) };
            let log_evidence = *log_evidence.get_or_insert(step.log_evidence);
            let longest = step.components[0].hypot(step.components[1]);
            let scale = (LONGEST / longest).min(1.0);
            components = std::array::from_fn(|k| components[k] + scale * step.components[k]);
            let weave = Weave::of_components(components);
            if log_evidence < ACCEPTED || weave.ratio > MOST {
                return Ok(None);
            }
            if longest < SETTLED {
                // a weave of voltages that are not those of the scene's skin would be one of chance
                return Ok((step.correlation >= ALIKE).then(|| FoundWeave {
                    weave,
                    ratio_std: step.std[0],
                    angle_std_deg: (0.5 * step.std[1] / weave.ratio.ln()).to_degrees(),
                    log_evidence,
                }));
            }
        }
        Ok(None)
    }
}

/// A Gauss-Newton step.
struct WeaveStep {
    /// Change of the components.
    components: [f64; 2],
    /// Standard deviations of the logarithms of the ratio and of a further one at 45 degrees from it.
    std: [f64; 2],
    log_evidence: f64,
    /// Correlation of the model's voltages with the reference, at the weave that the step is from.
    correlation: f64,
}

/// Computes the step from a skin of the weave `here`; `None` for a reference without voltages.
fn step(
    skin: &Skin,
    reference: &[f64],
    used: &[bool],
    here: Weave,
) -> Result<Option<WeaveStep>, SkinError> {
    let even_s = skin.background_s();
    let mut workspace = skin.model.workspace()?;
    let mut solution = skin.solve(&even_s, &mut workspace)?;
    let (voltages, jacobian) = (solution.measurements().to_vec(), solution.jacobian());
    let by_weave = solution.anisotropy_jacobian()? * PRIOR;
    drop(solution);
    let mut reference_v = reference_of_model(reference, used, 1.0, &voltages);
    let known = || reference_v.iter().zip(&voltages).zip(used).filter(|(_, used)| **used);
    let sum = |of: fn(f64, f64) -> f64| -> f64 { known().map(|((v, m), _)| of(*v, *m)).sum() };
    let (product, square) = (sum(|v, m| v * m), sum(|_, m| m * m));
    let (gain, correlation) = (product / square, product / (sum(|v, _| v * v) * square).sqrt());
    if gain == 0.0 || !gain.is_finite() {
        return Ok(None);
    }
    reference_v.iter_mut().for_each(|v| *v /= gain);
    let unknowns = unknowns(skin, &even_s, &UNTOUCHED, &mut Progress::silent())?;
    let leak = Array1::from(common_mode(skin, &even_s)?).insert_axis(Axis(1)) * LEAK;
    let unknowns = concatenate![Axis(1), unknowns, leak];
    let model = ReferenceModel {
        jacobian: &jacobian,
        conductivity_s: &even_s,
        model_v: &voltages,
        reference_v: &reference_v,
        error_v: &reference_errors(&voltages, &vec![0.0; voltages.len()], gain),
        unknowns: &unknowns,
        used,
    };
    let found = uneven_sheet(skin)?.estimate(&model, &by_weave)?;
    let [along, turned] = [found.mean[0], found.mean[1]].map(|mean| PRIOR * mean);
    let (sin, cos) = (2.0 * here.angle_deg.to_radians()).sin_cos();
    Ok(Some(WeaveStep {
        components: [cos * along - sin * turned, sin * along + cos * turned],
        std: [found.std[0], found.std[1]].map(|std| PRIOR * std),
        log_evidence: found.log_evidence,
        correlation: correlation.abs(),
    }))
}
