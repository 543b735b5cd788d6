//! Removes electrode movement from data and Jacobian before reconstruction.
//!
//! `reconstruction.electrode_movement_m` states how far electrodes move with the fabric. Displacements of
//! each electrode along the rim and outward are then unknowns in addition to the image
//! ([`NuisanceParameters`]). Any linear method can use the data and Jacobian without them.
//!
//! With a Gaussian prior, two measures keep the balance between image and displacements. First, the
//! hyperparameter and prior are those chosen for the original data. The noise figure of the remaining data
//! would require an image as noisy as data that lost part of their signal, and so a weaker prior. Second,
//! displacements are weighted against the error that this prior implies: lambda is the ratio of noise to
//! expected signal, 0.08 at noise figure 1 on the paper's skin, which is far above the noise of an
//! instrument. If displacements were weighted against the instrument's noise beside such a prior, they would
//! be cheaper than any image and would explain the touch. Total variation, whose weights follow from the
//! noise, needs neither measure.

mod whitening;

pub(crate) use whitening::Whitening;

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::Frames;
use crate::linearised::LinearisedSkin;
use crate::method::Method;
use crate::noise::DataNoise;
use crate::one_step::{ChosenBy, Imaging, choose};
use crate::progress::Progress;
use crate::scene::DifferenceKind;
use crate::synthetic_touch::{self, Places};
use eit_inverse::{NuisanceParameters, OneStepGaussNewton};
use ndarray::{Array2, ArrayView1};
use std::sync::Arc;

/// The model without electrode movement, and the operator that removes movement from differences.
pub(crate) struct MovementRemoved {
    /// Error against which displacements are weighted, in units of the noise.
    pub error: f64,
    /// Converts differences to white ones with standard deviation 1, without movement.
    pub side: NuisanceParameters,
    /// Model with the Jacobian of those differences; voltages are unchanged.
    pub linearised: LinearisedSkin,
}

/// Frames without electrode movement, as a replacement for the original ones.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct WithoutMovement {
    /// White differences relative to a reference of zero, and their model.
    pub fitted: FittedFrames,
    /// Removes movement from further differences.
    pub side: NuisanceParameters,
    /// Line for the report.
    pub line: String,
    /// Note about frames without an image, if there are any.
    pub note: Option<String>,
    /// For Gaussian priors, the reconstruction of the original data.
    before: Option<Before>,
}

/// One-step reconstruction of the original data, and how its hyperparameter was chosen.
#[derive(Debug, Clone)]
struct Before {
    difference: OneStepGaussNewton,
    chosen: ChosenBy,
}

/// Describes how far electrodes may move.
pub(crate) fn description(movement_m: f64) -> String {
    format!("electrodes may move by {:.2} mm", 1e3 * movement_m)
}

/// Removes movement from a model, for differences with this noise; `None` if electrodes do not move. `before`
/// is the reconstruction of the original data if its prior is Gaussian.
pub(crate) fn remove(
    linearised: &LinearisedSkin,
    noise: &DataNoise,
    used: &[bool],
    before: Option<&OneStepGaussNewton>,
) -> Result<Option<MovementRemoved>, SkinError> {
    let movement_m = linearised.skin.settings.reconstruction.electrode_movement_m;
    let (Some(movement_m), Some(movement)) = (movement_m, &linearised.movement) else {
        return Ok(None);
    };
    let jacobian = linearised.rows_of_differences(linearised.jacobian.clone(), used)?;
    let error = before.map_or(1.0, |before| {
        let signal = expected_signal(linearised, &jacobian, noise, used);
        (before.report().hyperparameter * signal).max(1.0)
    });
    // the weights are those of the noise, so deviations count in its units
    let std = vec![movement_m / error; movement.ncols()];
    let movement = linearised.rows_of_differences(movement.clone(), used)?;
    let side = NuisanceParameters::new(&movement, &std, &noise.std, Some(used))?;
    let linearised = linearised.whitened(side.whiten_jacobian(&jacobian)?);
    Ok(Some(MovementRemoved { error, side, linearised }))
}

/// Root mean square of the differences of a synthetic touch, in units of the noise. It does not depend on a
/// recording, so the image of a frame does not depend on other frames.
fn expected_signal(
    linearised: &LinearisedSkin,
    jacobian: &Array2<f64>,
    noise: &DataNoise,
    used: &[bool],
) -> f64 {
    let surface = linearised.skin.mesh.surface();
    let [low, high] = surface.bounds_m();
    let places = Places {
        at_m: surface.centroids().iter().map(|c| [c[0], c[1]]).collect(),
        side_m: (high[0] - low[0]).max(high[1] - low[1]),
    };
    let touch = synthetic_touch::touch(jacobian, &places, noise, linearised.skin.conductivity_s);
    let good = Array2::from_shape_fn(touch.dim(), |(_, i)| used[i]);
    noise.of_signal(&touch, &good)
}

impl FittedFrames {
    /// Returns frames and model without electrode movement; `None` if the settings do not enable it.
    ///
    /// # Errors
    ///
    /// A method that does not take differences; unknown noise.
    pub fn without_movement(
        &self,
        method: Method,
        progress: &mut Progress,
    ) -> Result<Option<WithoutMovement>, SkinError> {
        let settings = &self.skin.skin.settings;
        let Some(movement_m) = settings.reconstruction.electrode_movement_m else {
            return Ok(None);
        };
        if method == Method::GaussNewtonAbsolute {
            return Err(SkinError::input(
                "gauss-newton-absolute and reconstruction.electrode_movement_m exclude each other: \
                 movement is removed from differences before a linear method; use another method, \
                 or remove the key",
            ));
        }
        let Some(noise) = self.noise()? else {
            return Err(SkinError::UnknownNoise { who: "reconstruction.electrode_movement_m" });
        };
        let (noise, before) = match method.is_tv() {
            true => (noise, None),
            false => {
                // without stated noise, all measurements have the same
                let stated = settings.noise.additive_v.is_some();
                let noise = if stated { noise } else { noise.alike(&self.frames.used) };
                let before = self.before(&noise, progress)?;
                (noise, Some(before))
            }
        };
        progress.stage("electrode movement", || {
            let first = before.as_ref().map(|before| &before.difference);
            let removed = remove(&self.skin, &noise, &self.frames.used, first)?;
            let Some(MovementRemoved { error, side, linearised }) = removed else {
                return Ok(None);
            };
            let given = side.kept_variance().iter().map(|kept| 1.0 - kept).sum::<f64>();
            let mut line = format!(
                "{}: this takes {given:.1} directions of the data",
                description(movement_m)
            );
            if error > 1.0 {
                line += &format!(", weighted against {error:.0} times the noise");
            }
            let White { frames, note } =
                whitened(&self.frames, self.skin.difference_kind(), &side)?;
            let fitted = FittedFrames {
                skin: Arc::new(linearised),
                frames,
                fit: self.fit,
                weave: self.weave,
            };
            Ok(Some(WithoutMovement { fitted, side, line, note, before }))
        })
    }

    /// The one-step reconstruction of the original data, with its hyperparameter.
    fn before(&self, noise: &DataNoise, progress: &mut Progress) -> Result<Before, SkinError> {
        let mut settings = self.one_step_settings()?;
        settings.noise_std = Some(noise.std.clone());
        let prior = self.skin.prior()?;
        progress.stage("hyperparameter", || {
            let mut difference =
                OneStepGaussNewton::new(&self.skin.jacobian, prior.as_ref(), settings)?;
            let ChosenBy { chosen, rule } = choose(self, &mut difference)?;
            let rule = format!("{rule} of the data with movement");
            Ok(Before { difference, chosen: ChosenBy { chosen, rule } })
        })
    }
}

impl WithoutMovement {
    /// Prepares one-step images without movement, with the prior of the original data; `None` for total
    /// variation.
    ///
    /// # Errors
    ///
    /// The errors of the reconstruction.
    pub fn one_step(&self, progress: &mut Progress) -> Result<Option<Imaging>, SkinError> {
        let Some(Before { difference: before, chosen }) = &self.before else { return Ok(None) };
        let linearised = &self.fitted.skin;
        let settings = self.fitted.one_step_settings()?;
        let prior = linearised.prior()?;
        let difference = progress.stage("reconstruction matrix", || {
            let mut difference =
                OneStepGaussNewton::new(&linearised.jacobian, prior.as_ref(), settings)?;
            difference.set_prior_of(before)?;
            Ok::<_, SkinError>(difference)
        })?;
        let ChosenBy { chosen, rule } = chosen.clone();
        let raster = linearised.raster(progress)?.clone();
        Ok(Some(Imaging { difference, chosen, rule, raster, kind: DifferenceKind::Plain }))
    }
}

/// White frames, and a note about them.
struct White {
    frames: Frames,
    note: Option<String>,
}

/// White differences relative to a reference of zero. Whitening mixes measurements, so a frame that lacks
/// some has no image: its differences are zero.
fn whitened(
    frames: &Frames,
    kind: DifferenceKind,
    side: &NuisanceParameters,
) -> Result<White, SkinError> {
    let (clean, count) = (frames.clean(), frames.values.nrows());
    if clean.is_empty() {
        return Err(SkinError::input(format!(
            "none of {count} frames is good in every used measurement, and \
             reconstruction.electrode_movement_m mixes measurements: remove it from the scene, or \
             the bad measurements from the protocol"
        )));
    }
    let differences = frames.differences(kind);
    let mut values = Array2::zeros(differences.raw_dim());
    for &frame in &clean {
        let mut difference = differences.row(frame).to_vec();
        side.whiten(&mut difference)?;
        values.row_mut(frame).assign(&ArrayView1::from(&difference));
    }
    let note = (clean.len() < count).then(|| {
        format!(
            "{} of {count} frames have bad values and no image: electrode_movement_m mixes measurements",
            count - clean.len()
        )
    });
    let good = Array2::from_elem(values.raw_dim(), true);
    let reference = vec![0.0; frames.reference.len()];
    let frames = Frames { values, good, reference, quiet: None, ..frames.clone() };
    Ok(White { frames, note })
}
