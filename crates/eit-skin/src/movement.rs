//! Movement of electrodes, taken out of data and Jacobian before a method sees them.
//!
//! `reconstruction.electrode_movement_m` says how far electrodes go with the fabric. Displacements of
//! each along the rim and outward are then unknowns beside the image ([`NuisanceParameters`]); what is left
//! of data and Jacobian serves every linear method as it is.
//!
//! Where the prior is Gaussian, two things keep the balance between image and displacements. The
//! hyperparameter is that of the data as they came, and its prior is taken over: the noise figure of
//! what is left would ask for an image as noisy as data that have lost a part of their signal, and so
//! for less of a prior. And displacements are weighed against the error that this prior stands for:
//! lambda is the ratio of noise to expected signal, 0.08 at noise figure 1 on the paper's skin, which is
//! far more than the noise of an instrument. Weighed against the latter beside such a prior,
//! displacements are cheaper than any image, and explain the touch. Total variation, whose weights come
//! from the noise, needs neither.

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

/// Model without what electrodes that move explain, and what takes it out of differences.
pub(crate) struct TakenOut {
    /// What displacements are weighed against, in units of the noise.
    pub error: f64,
    /// DifferenceFrames to white noise of standard deviation 1.
    pub side: NuisanceParameters,
    /// The Jacobian of those; voltages as they were.
    pub linearised: LinearisedSkin,
}

/// Frames without what electrodes that move explain: what a method is given in place of those that
/// came.
#[derive(Debug)]
pub struct WithoutMovement {
    /// White differences against a reference of zero, and their model.
    pub fitted: FittedFrames,
    /// Takes movement out of further differences.
    pub side: NuisanceParameters,
    /// For the report.
    pub line: String,
    /// Frames that have no image.
    pub note: Option<String>,
    /// Where the prior is Gaussian: the reconstruction of the data as they came.
    before: Option<Before>,
}

/// The one-step reconstruction of the data as they came, and how its hyperparameter was chosen.
#[derive(Debug)]
struct Before {
    difference: OneStepGaussNewton,
    chosen: ChosenBy,
}

/// How far electrodes move, for people.
pub(crate) fn words(movement_m: f64) -> String {
    format!("electrodes may move by {:.2} mm", 1e3 * movement_m)
}

/// Takes movement out of a model for differences of this noise; `None` where electrodes do not move.
/// `before` is the reconstruction of the data as they came, where its prior is Gaussian.
pub(crate) fn take_out(
    linearised: &LinearisedSkin,
    noise: &DataNoise,
    used: &[bool],
    before: Option<&OneStepGaussNewton>,
) -> Result<Option<TakenOut>, SkinError> {
    let movement_m = linearised.skin.settings.reconstruction.electrode_movement_m;
    let (Some(movement_m), Some(movement)) = (movement_m, &linearised.movement) else {
        return Ok(None);
    };
    let jacobian = linearised.rows_of_differences(linearised.jacobian.clone(), used)?;
    let error = before.map_or(1.0, |before| {
        let signal = expected_signal(linearised, &jacobian, noise, used);
        (before.report().hyperparameter * signal).max(1.0)
    });
    // weights are those of the noise, so that deviations count in its units
    let std = vec![movement_m / error; movement.ncols()];
    let movement = linearised.rows_of_differences(movement.clone(), used)?;
    let side = NuisanceParameters::new(&movement, &std, &noise.std, Some(used))?;
    let linearised = linearised.whitened(side.whiten_jacobian(&jacobian)?);
    Ok(Some(TakenOut { error, side, linearised }))
}

/// Root mean square of the differences of a synthetic touch, in units of the noise. No recording is
/// looked at, so that a frame has one image, whatever comes before or after it.
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
    /// Frames and model without what electrodes that move explain; `None` where the settings say
    /// nothing of movement.
    ///
    /// # Errors
    ///
    /// A method that does not take differences, or noise that is not known.
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
                 movement is taken out of differences, before a linear method; take another method, \
                 or the key out",
            ));
        }
        let Some(noise) = self.noise()? else {
            return Err(SkinError::UnknownNoise { who: "reconstruction.electrode_movement_m" });
        };
        let (noise, before) = match method.is_tv() {
            true => (noise, None),
            false => {
                // measurements are equal where no noise is stated
                let stated = settings.noise.additive_v.is_some();
                let noise = if stated { noise } else { noise.alike(&self.frames.used) };
                let before = self.before(&noise, progress)?;
                (noise, Some(before))
            }
        };
        progress.stage("electrode movement", || {
            let first = before.as_ref().map(|before| &before.difference);
            let taken = take_out(&self.skin, &noise, &self.frames.used, first)?;
            let Some(TakenOut { error, side, linearised }) = taken else { return Ok(None) };
            let given = side.kept_variance().iter().map(|kept| 1.0 - kept).sum::<f64>();
            let mut line =
                format!("{}: {given:.1} directions of the data go to that", words(movement_m));
            if error > 1.0 {
                line += &format!(", weighed against {error:.0} times the noise");
            }
            let White { frames, note } =
                whitened(&self.frames, self.skin.difference_kind(), &side)?;
            let fitted = FittedFrames { skin: Arc::new(linearised), frames, fit: self.fit };
            Ok(Some(WithoutMovement { fitted, side, line, note, before }))
        })
    }

    /// The one-step reconstruction of the data as they came, with its hyperparameter.
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
    /// One-step images of what is left, with the prior of the data as they came; `None` for total
    /// variation.
    ///
    /// # Errors
    ///
    /// Those of the reconstruction.
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

/// White frames, and what is to be said of them.
struct White {
    frames: Frames,
    note: Option<String>,
}

/// White differences against a reference of zero. Measurements are mixed, so that a frame without some
/// of them has no image: its differences are zero.
fn whitened(
    frames: &Frames,
    kind: DifferenceKind,
    side: &NuisanceParameters,
) -> Result<White, SkinError> {
    let (clean, count) = (frames.clean(), frames.values.nrows());
    if clean.is_empty() {
        return Err(SkinError::input(format!(
            "none of {count} frames is good in every used measurement, and \
             reconstruction.electrode_movement_m mixes measurements: take it out of the scene, or \
             the bad ones out of the protocol"
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
