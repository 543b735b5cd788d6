//! Movement of electrodes, taken out of data and Jacobian before a method sees them.
//!
//! `reconstruction.electrode_movement_m` says how far electrodes go with the fabric. Displacements of
//! each along the rim and outward are then [`NuisanceParameters`]; what is left
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

mod displacement;
mod whitening;

pub use displacement::jacobian;
pub use whitening::Whitening;

use super::expected::{self, Places};
use super::imaging::{Imaging, choose, prior, settings};
use super::noise::{self, DataNoise};
use super::{Linearised, Setup, difference_data, raster};
use crate::error::SkinError;
use crate::frames::Frames;
use crate::method::Method;
use crate::progress::Progress;
use crate::scene::{DifferenceKind, Scene};
use eit_inverse::{ChosenHyperparameter, NuisanceParameters, OneStepGaussNewton};
use ndarray::{Array2, ArrayView1};

/// Model without what electrodes that move explain, and what takes it out of differences.
pub struct TakenOut {
    /// What displacements are weighed against, in units of the noise.
    pub error: f64,
    /// Differences to white noise of standard deviation 1.
    pub side: NuisanceParameters,
    /// The Jacobian of those; voltages as they were.
    pub linearised: Linearised,
}

/// What a method is given in place of scene, model and frames.
pub struct Freed {
    /// Of data that are differences already.
    pub scene: Scene,
    pub linearised: Linearised,
    /// White differences against a reference of zero.
    pub frames: Frames,
    /// Takes movement out of further differences.
    pub side: NuisanceParameters,
    /// For the report.
    pub line: String,
    /// Frames that have no image.
    pub note: Option<String>,
    /// Where the prior is Gaussian: the reconstruction of the data as they came, how its
    /// hyperparameter was chosen, and the rule in words.
    before: Option<(OneStepGaussNewton, ChosenHyperparameter, String)>,
}

/// How far electrodes move, for people.
pub fn words(movement_m: f64) -> String {
    format!("electrodes may move by {:.2} mm", 1e3 * movement_m)
}

/// Takes movement out of a model for differences of this noise; `None` where electrodes do not move.
/// `before` is the reconstruction of the data as they came, where its prior is Gaussian.
pub fn take_out(
    scene: &Scene,
    (setup, linearised): (&Setup, &Linearised),
    (noise, used): (&DataNoise, &[bool]),
    before: Option<&OneStepGaussNewton>,
) -> Result<Option<TakenOut>, SkinError> {
    let (Some(movement_m), Some(movement)) =
        (scene.reconstruction.electrode_movement_m, &linearised.movement)
    else {
        return Ok(None);
    };
    let kind = scene.difference_kind(&setup.protocol);
    let of_differences = |rows: &Array2<f64>| {
        let mut rows = rows.clone();
        for ((mut row, used), voltage) in
            rows.rows_mut().into_iter().zip(used).zip(&linearised.voltages)
        {
            match kind {
                // never looked at, and its voltage may be zero
                _ if !used => row.fill(0.0),
                DifferenceKind::Normalised => row /= *voltage,
                DifferenceKind::Plain => {}
            }
        }
        rows
    };
    let jacobian = of_differences(&linearised.jacobian);
    let error = before.map_or(1.0, |before| {
        let signal = expected_signal(scene, setup, &jacobian, (noise, used));
        (before.report().hyperparameter * signal).max(1.0)
    });
    // weights are those of the noise, so that deviations count in its units
    let std = vec![movement_m / error; movement.ncols()];
    let side = NuisanceParameters::new(&of_differences(movement), &std, &noise.std, Some(used))?;
    let linearised = Linearised {
        voltages: linearised.voltages.clone(),
        jacobian: side.whiten_jacobian(&jacobian)?,
        movement: None,
        report: linearised.report,
        warning: linearised.warning.clone(),
    };
    Ok(Some(TakenOut { error, side, linearised }))
}

/// Root mean square of the differences of a touch that is to be expected, in units of the noise. No
/// recording is looked at, so that a frame has one image, whatever comes before or after it.
fn expected_signal(
    scene: &Scene,
    setup: &Setup,
    jacobian: &Array2<f64>,
    (noise, used): (&DataNoise, &[bool]),
) -> f64 {
    let surface = setup.mesh.surface();
    let [low, high] = surface.bounds_m();
    let places = Places {
        at_m: surface.centroids().iter().map(|c| [c[0], c[1]]).collect(),
        side_m: (high[0] - low[0]).max(high[1] - low[1]),
    };
    let touch = expected::touch(jacobian, &places, noise, scene.skin.conductivity_s);
    let good = Array2::from_shape_fn(touch.dim(), |(_, i)| used[i]);
    noise.of_signal(&touch, &good)
}

/// Scene, model and frames without what electrodes that move explain; `None` where the scene says
/// nothing of movement. `gain` is the factor from the model's voltages to the reference's.
pub fn free(
    scene: &Scene,
    method: Method,
    (setup, linearised): (&Setup, &Linearised),
    (frames, gain): (&Frames, f64),
    progress: &mut Progress,
) -> Result<Option<Freed>, SkinError> {
    let Some(movement_m) = scene.reconstruction.electrode_movement_m else { return Ok(None) };
    if method == Method::GaussNewtonAbsolute {
        return Err(SkinError::input(
            "gauss-newton-absolute and reconstruction.electrode_movement_m exclude each other: movement \
             is taken out of differences, before a linear method; take another method, or the key out",
        ));
    }
    let kind = scene.difference_kind(&setup.protocol);
    let data = difference_data(kind, linearised);
    let Some(noise) = noise::known(scene, frames, (&data, gain))? else {
        return Err(SkinError::input(
            "reconstruction.electrode_movement_m needs the noise: state [noise] additive_v or \
             quiet_frames",
        ));
    };
    let models = (setup, linearised);
    let (noise, before) = match method.is_tv() {
        true => (noise, None),
        false => {
            // measurements are equal where no noise is stated
            let stated = scene.noise.additive_v.is_some();
            let noise = if stated { noise } else { noise.alike(&frames.used) };
            let before = before(scene, models, (frames, &noise), progress)?;
            (noise, Some(before))
        }
    };
    progress.stage("electrode movement", || {
        let of_noise = (&noise, &frames.used[..]);
        let taken = take_out(scene, models, of_noise, before.as_ref().map(|before| &before.0))?;
        let Some(TakenOut { error, side, linearised }) = taken else { return Ok(None) };
        let given = side.kept_variance().iter().map(|kept| 1.0 - kept).sum::<f64>();
        let mut line =
            format!("{}: {given:.1} directions of the data go to that", words(movement_m));
        if error > 1.0 {
            line += &format!(", weighed against {error:.0} times the noise");
        }
        let (frames, note) = whitened(frames, kind, &side)?;
        let scene = of_white(scene);
        Ok(Some(Freed { scene, linearised, frames, side, line, note, before }))
    })
}

/// The one-step reconstruction of the data as they came, with its hyperparameter.
fn before(
    scene: &Scene,
    (setup, linearised): (&Setup, &Linearised),
    (frames, noise): (&Frames, &DataNoise),
    progress: &mut Progress,
) -> Result<(OneStepGaussNewton, ChosenHyperparameter, String), SkinError> {
    let mut settings = settings(scene, setup, linearised, &frames.used)?;
    settings.noise_std = Some(noise.std.clone());
    let prior = prior(scene, setup)?;
    progress.stage("hyperparameter", || {
        let mut before = OneStepGaussNewton::new(&linearised.jacobian, prior.as_ref(), settings)?;
        let (chosen, rule) = choose(scene, setup, linearised, frames, &mut before)?;
        Ok((before, chosen, format!("{rule} of the data with movement")))
    })
}

impl Freed {
    /// One-step images of what is left, with the prior of the data as they came; `None` for total
    /// variation.
    pub fn imaging(
        &self,
        setup: &Setup,
        progress: &mut Progress,
    ) -> Result<Option<Imaging>, SkinError> {
        let Some((before, chosen, rule)) = &self.before else { return Ok(None) };
        let scene = &self.scene;
        let settings = settings(scene, setup, &self.linearised, &self.frames.used)?;
        let prior = prior(scene, setup)?;
        let difference = progress.stage("reconstruction matrix", || {
            let jacobian = &self.linearised.jacobian;
            let mut difference = OneStepGaussNewton::new(jacobian, prior.as_ref(), settings)?;
            difference.set_prior_of(before)?;
            Ok::<_, SkinError>(difference)
        })?;
        let (chosen, rule) = (chosen.clone(), rule.clone());
        let raster = raster(scene, setup, progress)?;
        Ok(Some(Imaging { difference, chosen, rule, raster, kind: DifferenceKind::Plain }))
    }
}

/// The scene of white differences.
fn of_white(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.reconstruction.difference = Some(DifferenceKind::Plain);
    scene.reconstruction.electrode_movement_m = None;
    scene.noise.additive_v = None;
    scene.noise.white = true;
    scene
}

/// White differences against a reference of zero. Measurements are mixed, so that a frame without some
/// of them has no image: its differences are zero.
fn whitened(
    frames: &Frames,
    kind: DifferenceKind,
    side: &NuisanceParameters,
) -> Result<(Frames, Option<String>), SkinError> {
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
    Ok((Frames { values, good, reference, quiet: None, ..frames.clone() }, note))
}
