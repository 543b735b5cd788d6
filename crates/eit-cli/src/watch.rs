//! Frames to touches as they come: what `eit live` and `eit replay` share.
//!
//! The first frames of an epoch are the reference; from then on each frame gives a one-step image
//! and its touches ([`TouchFinder`]), whatever the pace.

mod view;

pub(crate) use view::{Picture, Terminal};

use crate::connect;
use crate::error::CliError;
use crate::frames::{self, Frames};
use crate::pipeline::touches::TouchFinder;
use crate::pipeline::{self, Linearised, Setup};
use crate::progress::Progress;
use crate::scene::{Noise, Scene};
use eit_hw::driver::{Event, FrameSource};
use eit_hw::{Frame, MeasuredFrames};
use eit_inverse::touch::Touch;
use ndarray::Array2;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// So often it is looked whether to end.
const WAIT: Duration = Duration::from_millis(50);
/// Frames a second where neither the instrument nor a clock tells.
const DEFAULT_RATE_HZ: f64 = 20.0;
/// Latencies that the summary is made of: the last ones.
const LATENCIES: usize = 10_000;

/// What is built before the first frame comes.
pub(crate) struct Model {
    /// The scene.
    pub scene: Scene,
    /// Skin and protocol.
    pub setup: Setup,
    linearised: Linearised,
    quiet: usize,
}

/// What one frame showed.
pub(crate) struct Sight<'a> {
    /// Frames since the start that gave an image.
    pub number: u64,
    /// The frame.
    pub frame: &'a Frame,
    /// Its touches.
    pub touches: &'a [Touch],
    /// Its time for the tracker.
    pub time_s: f64,
    /// Finder of the epoch: raster and image.
    pub finder: &'a TouchFinder,
    /// From the last byte of the frame to its touches, for a live one.
    pub latency_s: Option<f64>,
}

/// What happened while watching.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    /// Frames with an image.
    pub frames: u64,
    /// References taken.
    pub references: u64,
    /// Touches that began.
    pub touches: u64,
    /// Most at once.
    pub most_at_once: usize,
    /// Latencies, seconds.
    latencies_s: Vec<f64>,
    /// From the first image to the last, seconds of this computer's clock.
    pub span_s: f64,
    /// What the source said.
    pub notices: Vec<String>,
}

impl Summary {
    /// Latency that so many of the frames did not exceed, 0 to 1.
    pub fn latency_s(&self, share: f64) -> Option<f64> {
        let mut sorted = self.latencies_s.clone();
        sorted.sort_by(f64::total_cmp);
        let index = (share * sorted.len() as f64) as usize;
        sorted.get(index.min(sorted.len().saturating_sub(1))).copied()
    }
}

/// Who sees what is found.
pub(crate) trait Watcher {
    /// An event as it came, before anything is made of it.
    fn event(&mut self, _event: &Event) -> Result<(), CliError> {
        Ok(())
    }

    /// Nothing came for a moment.
    fn idle(&mut self) -> Result<(), CliError> {
        Ok(())
    }

    /// Frames that are still wanted for the reference.
    fn waiting(&mut self, _left: usize) -> Result<(), CliError> {
        Ok(())
    }

    /// An image and its touches.
    fn sight(&mut self, sight: &Sight<'_>) -> Result<(), CliError>;

    /// Whether to go on; called at least every 50 ms.
    fn goes_on(&mut self, summary: &Summary) -> bool;
}

impl Model {
    /// Checks the scene and builds what needs no frame.
    pub fn new(scene: Scene, quiet: usize, progress: &mut Progress) -> Result<Self, CliError> {
        /// The noise is measured on them.
        const LEAST: usize = 8;
        if quiet < LEAST {
            return Err(CliError::input(format!("--quiet {quiet}: it must be {LEAST} or more")));
        }
        pipeline::touches::check(&scene)?;
        // frame numbers of a recording mean nothing here
        let scene = Scene { noise: Noise { quiet_frames: None, ..scene.noise.clone() }, ..scene };
        let setup = pipeline::setup(&scene, None, None, progress)?;
        let linearised = pipeline::linearise(&scene, &setup, progress)?;
        Ok(Self { scene, setup, linearised, quiet })
    }

    /// Watches until the watcher has enough or the source is over.
    pub fn watch(
        &self,
        source: &mut dyn FrameSource,
        is_live: bool,
        watcher: &mut dyn Watcher,
    ) -> Result<Summary, CliError> {
        let mut summary = Summary::default();
        let factor = frames::live_factor(&self.scene, &self.setup.protocol, source.setup().unit);
        let (mut finder, mut quiet) = (None, Vec::new());
        let mut first_sight = None;
        while watcher.goes_on(&summary) && !source.is_over() {
            let Some(event) = source.next_event(WAIT)? else {
                watcher.idle()?;
                continue;
            };
            watcher.event(&event)?;
            if matches!(event, Event::Reconnected { .. }) {
                // contacts and gains may have changed: an old reference does not hold
                (finder, quiet) = (None, Vec::new());
            }
            if let Some(words) = connect::words(&event) {
                summary.notices.push(words);
            }
            let Event::Frame(frame) = event else { continue };
            let Some((found, clock)) = &mut finder else {
                quiet.push(frame);
                watcher.waiting(self.quiet - quiet.len())?;
                if quiet.len() == self.quiet {
                    finder = Some(self.finder(source, &std::mem::take(&mut quiet))?);
                    summary.references += 1;
                }
                continue;
            };
            let time_s = clock.next_s(&frame);
            let values: Vec<f64> = frame.values.iter().map(|value| factor * value).collect();
            let touches = found.push(&values, |i| frame.quality[i].is_good(), time_s)?.to_vec();
            let latency_s = frame.host_time_s.filter(|_| is_live).map(|came| now_s() - came);
            summary.take(&touches, latency_s);
            let (number, touches, finder) = (summary.frames - 1, &touches[..], &*found);
            let frame_ref = &frame;
            watcher.sight(&Sight {
                number,
                frame: frame_ref,
                touches,
                time_s,
                finder,
                latency_s,
            })?;
            let first = *first_sight.get_or_insert_with(std::time::Instant::now);
            summary.span_s = first.elapsed().as_secs_f64();
            source.recycle(frame);
        }
        Ok(summary)
    }

    /// The finder of an epoch whose first frames are these.
    fn finder(
        &self,
        source: &dyn FrameSource,
        quiet: &[Frame],
    ) -> Result<(TouchFinder, Clock), CliError> {
        let clock = Clock::new(source.setup().frame_rate_hz, quiet);
        let measured = measured(quiet, source.setup().unit);
        let mut frames: Frames = frames::of_quiet(&self.scene, &self.setup.protocol, measured)?;
        let kind = self.scene.difference_kind(&self.setup.protocol);
        let voltages = self.linearised.voltages.to_vec();
        let fit = frames.fit_model(&voltages, kind, self.scene.skin.conductivity_s)?;
        let mut progress = Progress::silent();
        let models = (&self.setup, &self.linearised);
        let given = (&frames, fit.gain);
        let rate_hz = clock.rate_hz;
        TouchFinder::new(&self.scene, models, given, rate_hz, &mut progress)?
            .map(|finder| (finder, clock))
            .ok_or_else(|| {
                CliError::input(
                    "the reference frames show no noise to tell touches from: set [noise] \
                     additive_v",
                )
            })
    }
}

/// The time of frames: that of the instrument, else of their arrival, else their number over their
/// rate.
#[derive(Clone, Copy, Debug)]
struct Clock {
    rate_hz: f64,
    first_host_s: Option<f64>,
    /// The last time that was given.
    last_s: f64,
}

impl Clock {
    fn new(stated_hz: Option<f64>, quiet: &[Frame]) -> Self {
        let first_host_s = quiet.first().and_then(|frame| frame.host_time_s);
        let mut clock = Self {
            rate_hz: stated_hz.unwrap_or(DEFAULT_RATE_HZ),
            first_host_s,
            last_s: f64::NEG_INFINITY,
        };
        if let (None, [first, .., last]) = (stated_hz, quiet) {
            let span_s = clock.time_s(last) - clock.time_s(first);
            let steps = last.sequence.saturating_sub(first.sequence) as f64;
            if span_s > 0.0 {
                clock.rate_hz = steps / span_s;
            }
        }
        clock
    }

    /// The time of the next frame: a tracker wants it to rise, also where a clock stands still or
    /// goes back.
    fn next_s(&mut self, frame: &Frame) -> f64 {
        let time_s = self.time_s(frame);
        let is_later = time_s > self.last_s;
        self.last_s = if is_later { time_s } else { self.last_s + 1.0 / self.rate_hz };
        self.last_s
    }

    fn time_s(&self, frame: &Frame) -> f64 {
        let host_s = || Some(frame.host_time_s? - self.first_host_s?);
        let by_number = || frame.sequence as f64 / self.rate_hz;
        frame.device_time_s.or_else(host_s).unwrap_or_else(by_number)
    }
}

impl Summary {
    fn take(&mut self, touches: &[Touch], latency_s: Option<f64>) {
        use eit_inverse::touch::TouchState;
        self.frames += 1;
        let of = |state| touches.iter().filter(|touch| touch.state == state).count();
        self.touches += of(TouchState::Begin) as u64;
        self.most_at_once = self.most_at_once.max(touches.len() - of(TouchState::End));
        if let Some(latency_s) = latency_s {
            if self.latencies_s.len() == LATENCIES {
                let slot = (self.frames % LATENCIES as u64) as usize;
                self.latencies_s[slot] = latency_s;
            } else {
                self.latencies_s.push(latency_s);
            }
        }
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
