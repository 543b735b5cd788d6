//! Touches of a recording: one-step images above a noise floor, followed over time, against a
//! reference that follows drift.

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::movement::{self, TakenOut, Whitening};
use crate::noise::DataNoise;
use crate::one_step::DEFAULT_NOISE_FIGURE;
use crate::progress::Progress;
use crate::scene::{DifferenceKind, TouchSettings, TouchSign};
use crate::skin::check_images;
use eit_inverse::metrics::{Cells, ChangeSign};
use eit_inverse::touch::{NoiseFloor, Touch, TouchState, TouchStream, TouchStreamSettings};
use eit_inverse::{
    AdaptiveReference, HyperparameterChoice, NoiseTarget, NuisanceParameters, OneStepGaussNewton,
    OneStepSettings, Reconstructor, ReferenceSettings, Workspace,
};
use eit_mesh::Raster;
use ndarray::{ArrayView3, Axis};

/// Frames a second where nobody says.
const DEFAULT_RATE_HZ: f64 = 20.0;

/// A touch of a frame.
#[derive(Debug, Clone, Copy)]
pub struct TouchRow {
    /// Number of the frame, from 0.
    pub frame: usize,
    /// Its time, seconds.
    pub time_s: f64,
    /// The touch.
    pub touch: Touch,
}

/// Touches of all frames, and what they rest on.
#[derive(Debug, Clone)]
pub struct Touches {
    /// One row for each touch of each frame.
    pub rows: Vec<TouchRow>,
    /// Where a touch begins, in standard deviations of the image.
    pub threshold: f64,
    /// Independent cells of the image at that level.
    pub effective_cells: f64,
    /// False touches per hour that noise may make.
    pub false_alarms_per_hour: f64,
    /// Frames a second that this was counted with.
    pub rate_hz: f64,
    /// Where the noise came from.
    pub noise_source: String,
}

impl Touches {
    /// How many different ones.
    pub fn count(&self) -> usize {
        self.rows.iter().filter(|row| row.touch.state == TouchState::Begin).count()
    }

    /// Most at once.
    pub fn most(&self) -> usize {
        let frames = self.rows.chunk_by(|a, b| a.frame == b.frame);
        let alive = |rows: &[TouchRow]| {
            rows.iter().filter(|row| row.touch.state != TouchState::End).count()
        };
        frames.map(alive).max().unwrap_or(0)
    }

    /// Places seen from +z of each frame's valid touches, metres.
    pub fn marks(&self, frames: usize) -> Vec<Vec<[f64; 2]>> {
        let mut marks = vec![Vec::new(); frames];
        for TouchRow { frame, touch, .. } in self.rows.iter().filter(|row| row.touch.valid) {
            marks[*frame].push([touch.position_m[0], touch.position_m[1]]);
        }
        marks
    }
}

/// Finds touches in the images of a net where there are some, [frame, row, column]; otherwise in the
/// one-step images of frames, whatever method makes the pictures: their noise is known cell by cell,
/// and its floor is well above the noise of a net's images. `None` where the noise of the data is
/// unknown.
pub fn touches(
    fitted: &FittedFrames,
    denoised: Option<ArrayView3<'_, f64>>,
    progress: &mut Progress,
) -> Result<Option<Touches>, SkinError> {
    let frames = &fitted.frames;
    let rate_hz = frames.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
    let finder = TouchFinder::new(fitted, rate_hz, progress)?;
    let Some(mut finder) = finder else { return Ok(None) };
    check_images(frames.values.nrows(), &finder.raster)?;
    progress.stage("touches", || {
        let mut rows = Vec::new();
        let mut pixels = vec![0.0; finder.raster.masked_pixels().len()];
        for frame in 0..frames.values.nrows() {
            let time_s = frame as f64 / rate_hz;
            let values = frames.values.row(frame).to_vec();
            let good = frames.good.row(frame);
            finder
                .image(&values, |i| good[i], time_s)
                .map_err(|e| e.within(&format!("frame {frame}")))?;
            let denoised = match &denoised {
                Some(images) => {
                    let image = images.index_axis(Axis(0), frame);
                    finder.raster.pixels_from_image_into(image, &mut pixels)?;
                    Some(&*pixels)
                }
                None => None,
            };
            let found = finder.find(denoised, time_s)?;
            rows.extend(found.iter().map(|&touch| TouchRow { frame, time_s, touch }));
        }
        Ok(Some(Touches {
            rows,
            threshold: finder.stream.threshold(),
            effective_cells: finder.stream.effective_cells(),
            false_alarms_per_hour: finder.false_alarms_per_hour,
            rate_hz,
            noise_source: finder.noise_source,
        }))
    })
}

/// Finds touches frame by frame, recorded or live.
#[derive(Debug)]
pub struct TouchFinder {
    /// Pixels of the images.
    pub raster: Raster,
    /// Where the noise came from.
    pub noise_source: String,
    used: Vec<bool>,
    reconstructor: Reconstructor,
    workspace: Workspace,
    whitening: Option<Whitening>,
    stream: TouchStream,
    drift: Drift,
    pixels: Vec<f64>,
    bad: Vec<usize>,
    touched: bool,
    false_alarms_per_hour: f64,
}

impl TouchFinder {
    /// For frames like these, at this rate; `None` where their noise is unknown.
    ///
    /// # Errors
    ///
    /// Settings that no finder can be made with.
    pub fn new(
        fitted: &FittedFrames,
        rate_hz: f64,
        progress: &mut Progress,
    ) -> Result<Option<Self>, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let kind = skin.difference_kind();
        let Some(noise) = fitted.noise()? else { return Ok(None) };
        let Detector { difference, side } = Detector::new(fitted, &noise, progress)?;
        let raster = skin.raster(progress)?.clone();
        let keys = &skin.skin.settings.touch;
        let settings = stream_settings(keys, rate_hz);
        let reconstructor = difference.on_raster(raster.pixel_from_element())?;
        let std = if side.is_some() { vec![1.0; noise.std.len()] } else { noise.std.clone() };
        let floor = NoiseFloor::of_reconstruction(&reconstructor, &std)?;
        let cells = Cells::of_raster_on(&raster, skin.skin.mesh.surface())?;
        let false_alarms_per_hour = settings.false_alarms_per_hour;
        Ok(Some(Self {
            noise_source: noise.source.clone(),
            used: frames.used.clone(),
            whitening: side.map(|side| Whitening::new(side, kind, &frames.used)),
            workspace: reconstructor.workspace(),
            stream: TouchStream::new(cells, floor, settings)?,
            drift: Drift::new(fitted, &noise)?,
            pixels: vec![0.0; raster.masked_pixels().len()],
            bad: Vec::new(),
            touched: false,
            false_alarms_per_hour,
            reconstructor,
            raster,
        }))
    }

    /// Takes a frame: its reference and one-step image. [`find`](Self::find) is next.
    pub fn image(
        &mut self,
        values: &[f64],
        is_good: impl Fn(usize) -> bool,
        time_s: f64,
    ) -> Result<(), SkinError> {
        self.bad.clear();
        self.bad.extend((0..self.used.len()).filter(|&i| self.used[i] && !is_good(i)));
        if self.bad.is_empty() {
            self.drift.follow(values, time_s, self.touched)?;
        }
        let (memory, reference) = (&mut self.workspace, &self.drift.reference);
        let pixels = &mut self.pixels;
        match &mut self.whitening {
            None => {
                let bad = &self.bad;
                self.reconstructor
                    .reconstruct_masked_into(values, reference, bad, memory, pixels)?;
            }
            Some(whitening) if self.bad.is_empty() => {
                let white = whitening.of(values, reference)?;
                self.reconstructor.reconstruct_difference_into(white, memory, pixels)?;
            }
            // measurements are mixed: a frame without some of them shows nothing
            Some(_) => pixels.fill(0.0),
        }
        Ok(())
    }

    /// The touches of the frame at hand, in its one-step image or in another of its images.
    pub fn find(&mut self, other: Option<&[f64]>, time_s: f64) -> Result<&[Touch], SkinError> {
        let found = self.stream.push(other.unwrap_or(&self.pixels), time_s)?;
        self.touched = found.iter().any(|touch| touch.state != TouchState::End);
        Ok(found)
    }

    /// Change of conductivity at which a touch begins, the largest of all pixels, siemens.
    pub fn level_s(&self) -> f64 {
        let largest = self.stream.floor().std().iter().copied().fold(0.0, f64::max);
        self.stream.threshold() * largest
    }

    /// What is subtracted from the frame at hand, `[measurement]`.
    pub fn reference(&self) -> &[f64] {
        &self.drift.reference
    }

    /// Measurements that count.
    pub fn used(&self) -> &[bool] {
        &self.used
    }

    /// The one-step image of the last frame, a value for each pixel of the skin.
    pub fn pixels(&self) -> &[f64] {
        &self.pixels
    }
}

impl TouchSettings {
    /// Rejects settings that no touch can be found with, before any work.
    ///
    /// # Errors
    ///
    /// The value and its key.
    pub fn validate(&self) -> Result<(), SkinError> {
        let refuse = |e| SkinError::input(format!("touch: {e}"));
        stream_settings(self, DEFAULT_RATE_HZ).validate().map_err(refuse)?;
        reference_settings(self).map_or(Ok(()), |settings| settings.validate().map_err(refuse))
    }
}

/// The reference that drifts with the skin, over the used measurements.
#[derive(Debug)]
struct Drift {
    /// `None`: it stands still.
    adaptive: Option<AdaptiveReference>,
    used: Vec<usize>,
    /// Values of the used measurements.
    values: Vec<f64>,
    /// What to subtract now, `[measurement]`.
    reference: Vec<f64>,
}

impl Drift {
    fn new(fitted: &FittedFrames, noise: &DataNoise) -> Result<Self, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let kind = skin.difference_kind();
        let used: Vec<usize> = (0..frames.used.len()).filter(|&i| frames.used[i]).collect();
        let values: Vec<f64> = used.iter().map(|&i| frames.reference[i]).collect();
        let unit = |&i: &usize| match kind {
            DifferenceKind::Plain => noise.std[i],
            DifferenceKind::Normalised => noise.std[i] * frames.reference[i].abs(),
        };
        let std: Vec<f64> = used.iter().map(unit).collect();
        let adaptive = reference_settings(&skin.skin.settings.touch)
            .map(|settings| AdaptiveReference::with_noise(&values, &std, settings))
            .transpose()?;
        Ok(Self { adaptive, used, values, reference: frames.reference.clone() })
    }

    /// Takes a frame whose used values are all good.
    fn follow(&mut self, frame: &[f64], time_s: f64, touched: bool) -> Result<(), SkinError> {
        let Some(adaptive) = &mut self.adaptive else { return Ok(()) };
        self.values.iter_mut().zip(&self.used).for_each(|(value, &i)| *value = frame[i]);
        adaptive.push(&self.values, time_s, touched)?;
        for (&i, value) in self.used.iter().zip(adaptive.reference()) {
            self.reference[i] = *value;
        }
        Ok(())
    }
}

/// `None` where `touch.drift_time_s` is 0: the reference stands still.
fn reference_settings(keys: &TouchSettings) -> Option<ReferenceSettings> {
    let default = ReferenceSettings::default();
    let time_constant_s = keys.drift_time_s.unwrap_or(default.time_constant_s);
    (time_constant_s != 0.0).then_some(ReferenceSettings { time_constant_s, ..default })
}

/// One-step reconstruction weighted by the noise, at noise figure 1: an image as noisy as its data.
/// Where electrodes move, that is taken out first, and the prior stays.
struct Detector {
    difference: OneStepGaussNewton,
    /// Takes the movement of electrodes out of differences.
    side: Option<NuisanceParameters>,
}

impl Detector {
    fn new(
        fitted: &FittedFrames,
        noise: &DataNoise,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let mut settings = fitted.one_step_settings()?;
        settings.noise_std = Some(noise.std.clone());
        let prior = skin.prior()?;
        progress.stage("detector of touches", || {
            let mut difference = OneStepGaussNewton::new(&skin.jacobian, prior.as_ref(), settings)?;
            let target = NoiseTarget::central(skin.skin.mesh.surface(), &skin.jacobian)?;
            let figure = DEFAULT_NOISE_FIGURE;
            let choice = HyperparameterChoice::NoiseFigure { figure, target: &target };
            difference.choose_hyperparameter(&choice)?;
            let taken = movement::take_out(skin, noise, &frames.used, Some(&difference))?;
            let Some(TakenOut { side, linearised, .. }) = taken else {
                return Ok(Self { difference, side: None });
            };
            let used = Some(frames.used.clone());
            let settings = OneStepSettings { used, ..Default::default() };
            let mut left = OneStepGaussNewton::new(&linearised.jacobian, prior.as_ref(), settings)?;
            left.set_prior_of(&difference)?;
            Ok::<_, SkinError>(Self { difference: left, side: Some(side) })
        })
    }
}

fn stream_settings(keys: &TouchSettings, frame_rate_hz: f64) -> TouchStreamSettings {
    let default = TouchStreamSettings::default();
    TouchStreamSettings {
        sign: match keys.sign {
            TouchSign::Increase => ChangeSign::Increase,
            TouchSign::Decrease => ChangeSign::Decrease,
        },
        false_alarms_per_hour: keys.false_alarms_per_hour.unwrap_or(default.false_alarms_per_hour),
        frame_rate_hz,
        max_touches: keys.max_touches.unwrap_or(default.max_touches),
        birth_hits: keys.birth_hits.unwrap_or(default.birth_hits),
        birth_frames: keys.birth_frames.unwrap_or(default.birth_frames),
        forgiven_frames: keys.forgiven_frames.unwrap_or(default.forgiven_frames),
        relative_floor: keys.relative_floor.unwrap_or(default.relative_floor),
        prominence: keys.prominence.unwrap_or(default.prominence),
        ..default
    }
}
