//! Frames to touches as they come: what `eit live`, `eit replay` and `eit demo` share.
//!
//! The first frames of an epoch are the reference; from then on each frame gives an image
//! ([`Movie`]) and its touches ([`TouchFinder`]), whatever the pace: nothing looks at a clock, so
//! that a recording gives the same images to the bit.

mod clock;
mod movie;
mod summary;

pub use movie::{Movie, State};
pub use summary::Summary;

use self::clock::Clock;
use crate::connect;
use crate::denoise::{self, Net};
use crate::error::SkinError;
use crate::frames::{self, Frames};
use crate::method::{self, Method};
use crate::pipeline::touches::TouchFinder;
use crate::pipeline::{self, Linearised, Setup};
use crate::plan::measured;
use crate::progress::Progress;
use crate::scene::{Noise, Scene};
use eit_hw::driver::{Event, FrameSource};
use eit_hw::{Frame, MeasuredFrames};
use eit_inverse::touch::Touch;
use ndarray::Array2;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Frames of the reference where nothing else is asked for.
pub const REFERENCE_FRAMES: usize = 40;

/// How often to check for shutdown.
const WAIT: Duration = Duration::from_millis(50);

/// What is built before the first frame comes.
pub struct Model {
    /// The scene.
    pub scene: Scene,
    /// Skin and protocol.
    pub setup: Setup,
    linearised: Linearised,
    method: Method,
    net: Option<Net>,
    quiet: usize,
}

/// What is made of an epoch's frames.
struct Epoch {
    finder: TouchFinder,
    movie: Movie,
    clock: Clock,
}

/// What one frame showed.
pub struct Sight<'a> {
    /// Frames since the start that gave an image.
    pub number: u64,
    /// The frame.
    pub frame: &'a Frame,
    /// Its touches.
    pub touches: &'a [Touch],
    /// Its time for the tracker.
    pub time_s: f64,
    /// Finder of the epoch: raster and level of a touch.
    pub finder: &'a TouchFinder,
    /// The image.
    pub movie: &'a Movie,
    /// From the last byte of the frame to its image and touches, for a live one.
    pub latency_s: Option<f64>,
}

/// Who sees what is found.
pub trait Watcher {
    /// What may go wrong with it.
    type Error: From<SkinError>;

    /// An event as it came, before anything is made of it.
    fn event(&mut self, _event: &Event) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Nothing came for a moment.
    fn idle(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Frames that are still wanted for the reference.
    fn waiting(&mut self, _left: usize) -> Result<(), Self::Error> {
        Ok(())
    }

    /// An image and its touches.
    fn sight(&mut self, sight: &Sight<'_>) -> Result<(), Self::Error>;

    /// Whether to go on; called at least every 50 ms.
    fn goes_on(&mut self, summary: &Summary) -> bool;
}

impl Model {
    /// Checks the scene and builds what needs no frame.
    pub fn new(scene: Scene, quiet: usize, progress: &mut Progress) -> Result<Self, SkinError> {
        /// The noise is measured on them.
        const LEAST: usize = 8;
        if quiet < LEAST {
            return Err(SkinError::input(format!("--quiet {quiet}: it must be {LEAST} or more")));
        }
        pipeline::touches::check(&scene)?;
        // bad names and weights are refused before anything is made
        method::choose(&scene, None, None)?;
        denoise::of_scene(&scene)?;
        let setup = pipeline::setup(&scene, None, None, progress)?;
        let linearised = pipeline::linearise(&scene, &setup, progress)?;
        let voltages = linearised.voltages.to_vec();
        let scene = measured::in_time(scene, &setup, (None, true), &voltages)?;
        // those of other methods want the whole sequence, or cost more than a frame's time
        let method = match method::choose(&scene, None, None)?.method {
            method if method.is_tv() => method,
            _ => Method::GaussNewton,
        };
        let net = denoise::of_scene(&scene)?;
        // frame numbers of a recording mean nothing here
        let scene = Scene { noise: Noise { quiet_frames: None, ..scene.noise.clone() }, ..scene };
        Ok(Self { scene, setup, linearised, method, net, quiet })
    }

    /// Watches until the watcher has enough or the source is over.
    pub fn watch<W: Watcher>(
        &self,
        source: &mut dyn FrameSource,
        is_live: bool,
        watcher: &mut W,
    ) -> Result<Summary, W::Error> {
        let mut summary = Summary::default();
        let factor = frames::live_factor(&self.scene, &self.setup.protocol, source.setup().unit);
        let (mut epoch, mut quiet) = (None, Vec::new());
        let mut first_sight = None;
        while watcher.goes_on(&summary) && !source.is_over() {
            let Some(event) = source.next_event(WAIT).map_err(SkinError::from)? else {
                watcher.idle()?;
                continue;
            };
            watcher.event(&event)?;
            if matches!(event, Event::Reconnected { .. }) {
                // contacts and gains may have changed: an old reference does not hold
                (epoch, quiet) = (None, Vec::new());
            }
            if let Some(words) = connect::words(&event) {
                summary.say(words);
            }
            let Event::Frame(frame) = event else { continue };
            let Some(Epoch { finder, movie, clock }) = &mut epoch else {
                quiet.push(frame);
                watcher.waiting(self.quiet - quiet.len())?;
                if quiet.len() == self.quiet {
                    epoch = Some(self.epoch(source, &std::mem::take(&mut quiet))?);
                    summary.references += 1;
                    summary.images = epoch
                        .as_ref()
                        .map_or_else(String::new, |epoch: &Epoch| epoch.movie.words().to_owned());
                }
                continue;
            };
            let time_s = clock.next_s(&frame);
            let values: Vec<f64> = frame.values.iter().map(|value| factor * value).collect();
            let is_good = |i: usize| frame.quality[i].is_good();
            finder.image(&values, is_good, time_s)?;
            let (used, given) = (finder.used(), (&values[..], finder.reference()));
            movie.push(given, |i| used[i] && is_good(i), finder.pixels())?;
            let touches = finder.find(movie.denoised(), time_s)?.to_vec();
            let latency_s = frame.host_time_s.filter(|_| is_live).map(|came| now_s() - came);
            summary.take(&touches, movie.state(), latency_s);
            watcher.sight(&Sight {
                number: summary.frames - 1,
                frame: &frame,
                touches: &touches,
                time_s,
                finder,
                movie,
                latency_s,
            })?;
            let first = *first_sight.get_or_insert_with(std::time::Instant::now);
            summary.span_s = first.elapsed().as_secs_f64();
            source.recycle(frame);
        }
        Ok(summary)
    }

    /// An epoch whose first frames are these.
    fn epoch(&self, source: &dyn FrameSource, quiet: &[Frame]) -> Result<Epoch, SkinError> {
        let clock = Clock::new(source.setup().frame_rate_hz, quiet);
        let measured = measured(quiet, source.setup().unit);
        let mut frames: Frames = frames::of_quiet(&self.scene, &self.setup.protocol, measured)?;
        let kind = self.scene.difference_kind(&self.setup.protocol);
        let voltages = self.linearised.voltages.to_vec();
        let fit = frames.fit_model(&voltages, kind, self.scene.skin.conductivity_s)?;
        let mut progress = Progress::silent();
        let models = (&self.setup, &self.linearised);
        let given = (&frames, fit.gain);
        let finder = TouchFinder::new(&self.scene, models, given, clock.rate_hz, &mut progress)?
            .ok_or_else(|| {
                SkinError::input(
                    "the reference frames show no noise to tell touches from: set [noise] \
                     additive_v",
                )
            })?;
        let how = (&self.scene, self.method, self.net.as_ref());
        let movie = Movie::new(how, (models.0, models.1, &finder.raster), given)?;
        Ok(Epoch { finder, movie, clock })
    }
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// Frames as those of a recording.
fn measured(frames: &[Frame], unit: eit_hw::Unit) -> MeasuredFrames {
    let shape = (frames.len(), frames.first().map_or(0, |frame| frame.values.len()));
    MeasuredFrames {
        values: Array2::from_shape_fn(shape, |(row, column)| frames[row].values[column]),
        quality: Array2::from_shape_fn(shape, |(row, column)| frames[row].quality[column]),
        unit,
        device_time_s: None,
        frequency_hz: None,
        current_a: None,
        phase_rad: None,
    }
}
