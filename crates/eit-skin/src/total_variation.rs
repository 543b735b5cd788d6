//! Total variation: its Jacobian on pixels, its weights, and the frames that need no solve. One file, because
//! the steps of a reconstruction depend on each other.

mod part;
mod stream;

pub use stream::{TvStep, TvStream};

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::method::Method;
use crate::noise::DataNoise;
use crate::progress::Progress;
use crate::scene::{Delta, DeltaRule, ReconstructionSettings};
use eit_inverse::{
    ChosenWeights, DifferenceFrames, Fidelity, Gradient, ImageSequence, InverseError,
    SequenceReport, StTv, StTvSettings, Stop, WeightStatus,
};
use eit_mesh::Raster;
use ndarray::Array2;
use part::Part;
use std::time::Duration;

/// Default relative gap: images no longer change visibly.
pub(crate) const DEFAULT_TARGET_GAP: f64 = 1e-2;

/// Fraction of the weights of the discrepancy principle that is used, because that principle is known to
/// oversmooth. Measured on simulated fingers (bells and pads, one and two, slow and fast, 32 pixels): a
/// quarter lowers the relative error by 8 to 20 % at 40 to 70 dB of noise and keeps every touch; structural
/// similarity falls at 40 dB only. With an eighth it falls up to 60 dB.
const SHARE: f64 = 0.25;

/// Length that relates weights in space and time, as a fraction of the raster's side: about the resolution of
/// 16 electrodes, regardless of the pixels. A patch of this length that changes from one frame to the next
/// costs as much as an edge along its side. Measured as above: four times the length leaves noise in slow
/// fingers, a quarter smears fast ones.
const TIME_LENGTH: f64 = 1.0 / 32.0;

/// Returns the ratio of the weight in space to that in time, metres.
pub fn time_length_m(raster: &Raster) -> f64 {
    TIME_LENGTH * raster.pixel_m() * raster.pixels() as f64
}

/// Sets up the solver of a method with the scene's bounds; its weights remain to be chosen.
///
/// # Errors
///
/// Those of [`StTv::new`].
pub fn solver(
    jacobian: &Array2<f64>,
    raster: &Raster,
    method: Method,
    keys: &ReconstructionSettings,
    noise_std: Option<Vec<f64>>,
    used: &[bool],
) -> Result<StTv, SkinError> {
    let gradient = Gradient::pixels(raster.mask(), raster.pixel_m())?;
    let settings = StTvSettings {
        lambda_time: if has_time(method, keys) { 1.0 } else { 0.0 },
        lower_s: keys.lower_s.unwrap_or(f64::NEG_INFINITY),
        upper_s: keys.upper_s.unwrap_or(f64::INFINITY),
        noise_std,
        used: Some(used.to_vec()),
        ..Default::default()
    };
    Ok(StTv::new(jacobian, &gradient, settings)?)
}

/// Whether the method has a time term.
fn has_time(method: Method, keys: &ReconstructionSettings) -> bool {
    method == Method::StTv && keys.lambda_time != Some(0.0)
}

/// Returns the stopping criteria of the scene.
pub fn stop(keys: &ReconstructionSettings) -> Stop {
    Stop {
        target_gap: keys.target_gap.unwrap_or(DEFAULT_TARGET_GAP),
        // a deadline beyond what a clock can count (584 thousand million years) is none
        deadline: keys.deadline_s.and_then(|limit_s| Duration::try_from_secs_f64(limit_s).ok()),
        ..Default::default()
    }
}

/// The weights in use and how they were chosen.
#[derive(Debug, Clone)]
pub struct Weights {
    /// Weight of edges in space, as the scene would state it: excluding the model error, which chosen weights
    /// count as noise.
    pub lambda_space: f64,
    /// Weight of changes in time, likewise.
    pub lambda_time: f64,
    /// Radius of the constrained form, in units of the noise if that is known.
    pub delta: Option<f64>,
    /// How they were chosen, in words.
    pub rule: String,
    /// The search for the weights, if there was one.
    pub chosen: Option<ChosenWeights>,
}

impl Weights {
    /// Converts the weights, and the search for them, to data in another unit of noise: `factor` times the
    /// weights for the old unit.
    fn rescale(&mut self, factor: f64) {
        let in_search = self.chosen.iter_mut().flat_map(|chosen| {
            let curve = chosen.curve.iter_mut().map(|point| &mut point.lambda_space);
            let found = [&mut chosen.lambda_space, &mut chosen.lambda_time];
            curve.chain(found).chain(&mut chosen.corner)
        });
        let own = [&mut self.lambda_space, &mut self.lambda_time];
        in_search.chain(own).for_each(|weight| *weight *= factor);
    }
}

/// A sequence reconstructed by total variation.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct TvMovie {
    /// Images in siemens, [frame, masked pixel].
    pub pixels: Array2<f64>,
    /// Report of the solve; `None` if every frame is quiet.
    pub report: Option<SequenceReport>,
    /// Residual of each frame, in units of the noise; `None` for a quiet frame.
    pub residual: Vec<Option<f64>>,
    /// Weights; `None` if every frame is quiet.
    pub weights: Option<Weights>,
    /// Noise by which the data are weighted; `None` if all have equal noise of unknown size.
    pub noise: Option<DataNoise>,
    /// Whether each frame differs from the reference by noise only.
    pub quiet: Vec<bool>,
    /// Number of the quiet frames that hold no usable value.
    pub blank: usize,
    /// Whether the other frames differ from each other by noise only, so that one image represents them all.
    pub still: bool,
    /// Number of independent directions of the data.
    pub rank: usize,
    /// Number of measurements used.
    pub used: usize,
}

impl FittedFrames {
    /// Reconstructs a sequence by total variation: quiet frames are skipped, a static scene is solved as one
    /// frame, and weights are those of the settings or chosen from the noise.
    ///
    /// # Errors
    ///
    /// A data constraint without known noise, or one that no image satisfies.
    pub fn total_variation(
        &self,
        method: Method,
        progress: &mut Progress,
    ) -> Result<TvMovie, SkinError> {
        let Self { skin, frames, .. } = self;
        let keys = &skin.skin.settings.reconstruction;
        let raster = &skin.raster(progress)?.clone();
        let known = self.noise()?;
        if known.is_none() && matches!(keys.delta, Some(Delta::Rule(_))) {
            return Err(SkinError::UnknownNoise { who: "delta = \"noise\"" });
        }
        let jacobian = skin.pixel_jacobian(raster, &frames.used)?;
        let set_up = SetUp { keys, raster, jacobian, used: &frames.used };
        let (values, good) = (self.differences(), self.good());
        let quiet = match &known {
            Some(noise) => progress.stage("quiet frames", || {
                let all = DifferenceFrames { values: values.view(), good: Some(good.view()) };
                Ok::<_, SkinError>(set_up.solver(method, Some(noise))?.quiet_frames(&all)?)
            })?,
            None => vec![false; values.nrows()],
        };
        let mut part = Part::new(&values, &good, &quiet);
        let is_blank = |&f: &usize| quiet[f] && !good.row(f).iter().any(|g| *g);
        let mut movie = TvMovie {
            pixels: Array2::zeros((values.nrows(), raster.masked_pixels().len())),
            report: None,
            residual: vec![None; values.nrows()],
            weights: None,
            rank: 0,
            used: frames.used.iter().filter(|used| **used).count(),
            blank: (0..quiet.len()).filter(is_blank).count(),
            still: known.as_ref().is_some_and(|noise| part.is_still(noise)),
            noise: known,
            quiet,
        };
        if part.frames.is_empty() {
            return Ok(movie);
        }
        if movie.still {
            movie.noise = movie.noise.map(|noise| noise.of_mean(part.frames.len()));
            part.take_mean();
        }
        movie.noise = weighting(movie.noise, keys, &part);
        set_up.solve(method, &part, &mut movie, progress)?;
        Ok(movie)
    }

    /// Returns whether no frame differs from the others beyond noise; false if the noise is unknown.
    /// [`FittedFrames::total_variation`] checks again, without quiet frames.
    ///
    /// # Errors
    ///
    /// The errors of the noise.
    pub fn is_still(&self) -> Result<bool, SkinError> {
        let Some(noise) = self.noise()? else { return Ok(false) };
        let none_quiet = vec![false; self.frames.values.nrows()];
        Ok(Part::new(&self.differences(), &self.good(), &none_quiet).is_still(&noise))
    }
}

/// What solvers for parts of a recording have in common.
struct SetUp<'a> {
    keys: &'a ReconstructionSettings,
    raster: &'a Raster,
    jacobian: Array2<f64>,
    used: &'a [bool],
}

impl SetUp<'_> {
    fn solver(&self, method: Method, noise: Option<&DataNoise>) -> Result<StTv, SkinError> {
        let noise_std = noise.map(|noise| noise.std.clone());
        solver(&self.jacobian, self.raster, method, self.keys, noise_std, self.used)
    }

    /// Chooses the weights for frames of a movie, whose noise is known, and makes their images.
    fn solve(
        &self,
        method: Method,
        part: &Part,
        movie: &mut TvMovie,
        progress: &mut Progress,
    ) -> Result<(), SkinError> {
        // a single image has no time term, and its report says so
        let method = if part.values.nrows() == 1 { Method::Tv } else { method };
        let noise = movie.noise.as_ref();
        let mut solver =
            progress.stage("set-up of total variation", || self.solver(method, noise))?;
        movie.rank = solver.rank();
        let frames = DifferenceFrames { values: part.values.view(), good: Some(part.good.view()) };
        // numbers in the scene refer to the noise alone
        let factor = noise.map_or(1.0, DataNoise::per_known);
        let of_recording = |error| part.of_recording(in_known_noise(error, factor));
        let (keys, used) = (self.keys, movie.used);
        let mut weights =
            progress.stage("weights", || weights(&mut solver, keys, &frames, self.raster, used))?;
        let found = progress
            .stage("total variation", || solver.solve(&frames, &stop(keys)))
            .map_err(of_recording)?;
        if weights.chosen.is_some() {
            weights.rescale(factor * factor);
        }
        weights.delta = weights.delta.map(|delta| factor * delta);
        movie.weights = Some(weights);
        movie.take(found, &part.frames);
        Ok(())
    }
}

/// Converts constraints in an error from noise with the model error to that of numbers in the scene, `factor` times
/// smaller.
fn in_known_noise(error: InverseError, factor: f64) -> InverseError {
    match error {
        InverseError::DeltaTooSmall { frame, delta, least } => {
            InverseError::DeltaTooSmall { frame, delta: factor * delta, least: factor * least }
        }
        InverseError::DeltaTooSmallWithinBounds { frame, delta, least, lower_s, upper_s } => {
            let (delta, least) = (factor * delta, factor * least);
            InverseError::DeltaTooSmallWithinBounds { frame, delta, least, lower_s, upper_s }
        }
        other => other,
    }
}

/// Returns the noise to weight by, including the model error if the weights are derived from it. Weights
/// given as numbers refer to the noise alone, or to none, and an estimate must not change their meaning.
fn weighting(
    known: Option<DataNoise>,
    keys: &ReconstructionSettings,
    part: &Part,
) -> Option<DataNoise> {
    if keys.lambda_space.is_some() || matches!(keys.delta, Some(Delta::Value(_))) {
        return known;
    }
    Some(match known {
        Some(noise) => noise.with_model_error(&part.values, &part.good),
        None => DataNoise::unknown(&part.values, &part.good),
    })
}

/// Sets the scene's weights, or chooses them by the noise; `used` is the number of measurements.
///
/// # Errors
///
/// Those of [`chosen_weights`].
pub fn weights(
    solver: &mut StTv,
    keys: &ReconstructionSettings,
    frames: &DifferenceFrames<'_>,
    raster: &Raster,
    used: usize,
) -> Result<Weights, SkinError> {
    let delta = keys.delta.map(|delta| match delta {
        Delta::Value(value) => value,
        Delta::Rule(DeltaRule::Noise | DeltaRule::Paper) => (used as f64).sqrt(),
    });
    let length_m = match keys.delta {
        // sums over pixels: lambda_space pixel |dx| and lambda_time pixel^2 |dx|
        Some(Delta::Rule(DeltaRule::Paper)) => raster.pixel_m(),
        _ => time_length_m(raster),
    };
    if delta.is_none() && keys.lambda_space.is_none() {
        return chosen_weights(solver, frames, length_m);
    }
    // with the constraint delta, only their ratio matters
    let lambda_space = keys.lambda_space.unwrap_or(1.0);
    let lambda_time = match keys.lambda_time {
        _ if solver.settings().lambda_time == 0.0 => 0.0,
        Some(weight) => weight,
        None => lambda_space / length_m,
    };
    let fidelity = delta.map_or(Fidelity::Penalised, |delta| Fidelity::Constrained { delta });
    solver.set_weights(lambda_space, lambda_time, fidelity)?;
    let rule = match keys.delta {
        Some(Delta::Rule(DeltaRule::Noise)) => "delta by the noise",
        Some(Delta::Rule(DeltaRule::Paper)) => "equation (7) of the paper, delta by the noise",
        _ => "fixed by the scene",
    };
    Ok(Weights { lambda_space, lambda_time, delta, rule: rule.to_owned(), chosen: None })
}

/// Chooses the weights by the discrepancy principle, with the model error as noise if that is
/// larger.
///
/// If no weight reduces the residual to the noise, what remains at the smallest weights is the
/// model error (linearisation, contact impedances, shape). Smaller weights only fit that error, and
/// images become erratic. It is taken as noise instead: the search started at the weight that suits
/// noise of one standard deviation, so the error requires a proportional multiple of it.
///
/// # Errors
///
/// Those of [`StTv::choose_weights`].
pub fn chosen_weights(
    solver: &mut StTv,
    frames: &DifferenceFrames<'_>,
    length_m: f64,
) -> Result<Weights, SkinError> {
    let chosen = solver.choose_weights(frames, length_m)?;
    let (factor, rule) = match (chosen.status, chosen.curve.last()) {
        (WeightStatus::AtLowerEdge, Some(start)) => (
            chosen.residual * start.lambda_space / chosen.lambda_space,
            format!("model error, {:.1} times the noise", chosen.residual),
        ),
        (WeightStatus::Flattened, _) => {
            (1.0, format!("corner of the L-curve, {:.1} times the noise", chosen.residual))
        }
        _ => (1.0, "discrepancy principle".to_owned()),
    };
    let lambda_space = SHARE * factor * chosen.lambda_space;
    let lambda_time = SHARE * factor * chosen.lambda_time;
    solver.set_weights(lambda_space, lambda_time, Fidelity::Penalised)?;
    Ok(Weights { lambda_space, lambda_time, delta: None, rule, chosen: Some(chosen) })
}

impl TvMovie {
    /// Returns the number of quiet frames.
    pub fn quiet_count(&self) -> usize {
        self.quiet.iter().filter(|quiet| **quiet).count()
    }

    /// Assigns the images of a solve to its frames; one image may serve several.
    fn take(&mut self, found: ImageSequence, frames: &[usize]) {
        let last = found.images.nrows().saturating_sub(1);
        for (k, &frame) in frames.iter().enumerate() {
            self.pixels.row_mut(frame).assign(&found.images.row(k.min(last)));
            self.residual[frame] = found.report.residual.get(k.min(last)).copied();
        }
        self.report = Some(found.report);
    }
}
