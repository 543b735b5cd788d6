//! From frames to touches in real time: one loop for an instrument, a replay and the demo.
//!
//! The first frames of an epoch are the reference. After that, each frame yields its touches
//! ([`TouchFinder`](crate::touches::TouchFinder)) and, if wanted, an image ([`LiveImages`]). Touches do not
//! depend on timing or any clock: a recording reproduces them bit for bit. So do images, except that those of
//! live frames are skipped while further frames wait ([`LiveObserver::wants_every_image`]).

mod clock;
mod epoch;
mod fields;
mod images;
mod listed;
mod one_step;
mod reference;
mod sensor;
mod stream;
mod summary;

pub use fields::{SkinState, TouchFields, TouchFrame};
pub use images::{ImageState, LiveImages};
pub use sensor::{Next, Sensor};
pub use stream::{LiveStream, Step};
pub use summary::{ImageSummary, Summary};

use crate::denoise::Net;
use crate::error::SkinError;
use crate::limits::check_pixel_jacobian;
use crate::linearised::LinearisedSkin;
use crate::method::{self, Method};
use crate::progress::Progress;
use crate::scene::{LEAST_REFERENCE_FRAMES, NoiseSettings, Scene};
use crate::skin::Skin;
use crate::text::event_text;
use clock::Arrival;
use eit_hw::Frame;
use eit_hw::driver::{Event, FrameSource};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Default number of reference frames.
pub const REFERENCE_FRAMES: usize = 40;
/// How often to check for shutdown.
const WAIT: Duration = Duration::from_millis(50);

/// A consumer that is always behind still gets an image this often.
const LONGEST_SKIP: Duration = Duration::from_millis(250);

/// What is built before the first frame arrives.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct LiveModel {
    /// The skin with its Jacobian; shared, because it can be large.
    pub linearised: Arc<LinearisedSkin>,
    pub(crate) method: Method,
    pub(crate) net: Option<Net>,
    /// Number of frames at the start of each epoch that form its reference.
    pub reference_frames: usize,
}

/// Receives results as frames arrive.
pub trait LiveObserver {
    /// Error with which the observer stops the run.
    type Error: From<SkinError>;

    /// Called with each event as it arrives, before it is processed.
    ///
    /// # Errors
    ///
    /// Any error ends the loop.
    fn event(&mut self, _event: &Event) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called when no event arrived for a moment.
    ///
    /// # Errors
    ///
    /// Any error ends the loop.
    fn idle(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called while the reference is taken, with the number of frames that are still needed: at least 1 until touches can be found.
    ///
    /// # Errors
    ///
    /// Any error ends the loop.
    fn waiting(&mut self, _left: usize) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called when a reference has been taken, with its frames, what they say about the scene ([`LiveStream::notes`]), and the number
    /// of the last frame that is not searched for touches.
    ///
    /// # Errors
    ///
    /// Any error ends the loop.
    fn reference(
        &mut self,
        _taken: &[Frame],
        _notes: &[String],
        _until: Option<u64>,
    ) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called with a frame's touches before its image is made, so that acting on touches need not wait for
    /// it.
    ///
    /// # Errors
    ///
    /// Any error ends the loop.
    fn touches(&mut self, _frame: &TouchFrame<'_>) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called with the list that ends all touches ([`SkinState::NoData`]), before the event that is the reason, and at the end.
    ///
    /// # Errors
    ///
    /// Any error ends the loop.
    fn ended(&mut self, _last: &TouchFrame<'_>) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called with a frame's touches, and its image if images are made.
    ///
    /// # Errors
    ///
    /// Any error ends the loop.
    fn frame(&mut self, frame: &TouchFrame<'_>) -> Result<(), Self::Error>;

    /// Returns whether images may be wanted; called once before the first frame. Touches do not need images,
    /// and arrive sooner if none are made.
    fn wants_images(&self) -> bool {
        true
    }

    /// Returns whether the image of the current frame is wanted; called for each frame if images may be
    /// wanted.
    fn wants_image(&self) -> bool {
        true
    }

    /// Whether every image is needed, even if touches then come late. By default the image of a live frame
    /// is skipped while further frames wait, except for one every quarter of a second.
    fn wants_every_image(&self) -> bool {
        false
    }

    /// Returns whether to continue; called at least every 50 ms.
    fn goes_on(&mut self, summary: &Summary) -> bool;
}

impl LiveModel {
    /// Checks a scene and builds everything that needs no frame.
    ///
    /// # Errors
    ///
    /// Invalid settings, before any work; a skin that cannot be built.
    pub fn from_scene(
        scene: &Scene,
        reference_frames: usize,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        check_reference_frames(reference_frames)?;
        scene.check_stages()?;
        let skin = Skin::set_up(scene, &Default::default(), progress)?;
        Self::new(&skin, reference_frames, progress)
    }

    /// Builds everything that needs no frame.
    ///
    /// # Errors
    ///
    /// Invalid settings, or a skin that cannot be linearised.
    pub fn new(
        skin: &Skin,
        reference_frames: usize,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        check_reference_frames(reference_frames)?;
        skin.settings.touch.validate().map_err(|e| e.within(&skin.place))?;
        let mut linearised = skin.linearise(progress)?.in_frame_time(None, true)?;
        // other methods need the whole sequence, or take longer than a frame
        let method = match method::choose(&linearised.skin.settings, None, None)?.method {
            method if method.is_tv() => method,
            _ => Method::GaussNewton,
        };
        let net = linearised.skin.net()?;
        // quiet frames and the first frame are counted in a recording
        let settings = &mut linearised.skin.settings;
        settings.noise = NoiseSettings { quiet_frames: None, ..settings.noise.clone() };
        settings.recording.first_frame = None;
        Ok(Self { linearised: Arc::new(linearised), method, net, reference_frames })
    }

    /// Returns the skin that the model was built for.
    pub fn skin(&self) -> &Skin {
        &self.linearised.skin
    }

    /// Rejects images that do not fit in memory, or that total variation cannot make live. Called before
    /// the first image is prepared.
    ///
    /// # Errors
    ///
    /// [`SkinError::TooLarge`]; [`SkinError::TooManyPixels`], with the largest number of pixels that can be
    /// made.
    pub(crate) fn check_images(&self) -> Result<(), SkinError> {
        let skin = self.skin();
        let (measurements, pixels) = (skin.protocol.measurements(), skin.pixels());
        if self.method.is_tv() {
            let most =
                (MOST_TV_VALUES / measurements.max(1) as f64).sqrt().floor().max(1.0) as usize;
            if pixels > most {
                return Err(SkinError::TooManyPixels { measurements, pixels, most });
            }
        }
        check_pixel_jacobian(measurements, pixels)
    }

    /// Processes a source until the observer stops it or the source ends.
    ///
    /// # Errors
    ///
    /// Errors of the source, the images and the observer.
    pub fn watch<O: LiveObserver>(
        self: &Arc<Self>,
        source: &mut dyn FrameSource,
        is_live: bool,
        observer: &mut O,
    ) -> Result<Summary, O::Error> {
        let mut stream = LiveStream::new(Arc::clone(self), source.setup());
        if observer.wants_images() {
            self.check_images()?;
        } else {
            stream = stream.without_images();
        }
        let outcome = self.follow(&mut stream, source, is_live, observer);
        if let Some(last) = stream.end() {
            observer.ended(&last)?;
        }
        outcome
    }

    fn follow<O: LiveObserver>(
        &self,
        stream: &mut LiveStream,
        source: &mut dyn FrameSource,
        is_live: bool,
        observer: &mut O,
    ) -> Result<Summary, O::Error> {
        let mut summary = Summary::default();
        // when the previous frame was shown and when it arrived, unless the source was interrupted since
        let mut before: Option<Arrival> = None;
        let mut last_image = Instant::now();
        while observer.goes_on(&summary) {
            let step = stream.step(source, is_live, WAIT, |event, ended| {
                ended.map_or(Ok(()), |ended| observer.ended(&ended))?;
                observer.event(event)?;
                before = before.filter(|_| !is_interruption(event));
                // skipped frames are counted by the source
                let is_said = !matches!(event, Event::Skipped { .. });
                event_text(event)
                    .filter(|_| is_said)
                    .into_iter()
                    .for_each(|words| summary.say(words));
                Ok::<_, O::Error>(())
            })?;
            match step {
                Step::Over => break,
                Step::Idle => observer.idle()?,
                Step::Event => {}
                Step::Waiting { left } => wait(stream, left, &mut summary, observer)?,
                Step::Touches => {
                    stream.shown().map_or(Ok(()), |shown| observer.touches(&shown))?;
                    if observer.wants_image() {
                        let is_behind =
                            is_live && source.frames_waiting() > 0 && !observer.wants_every_image();
                        if is_behind && last_image.elapsed() < LONGEST_SKIP {
                            summary.images.skipped += 1;
                        } else {
                            stream.make_image()?;
                            last_image = Instant::now();
                        }
                    }
                    let Some(shown) = stream.shown() else { continue };
                    summary.take_frame(&shown);
                    observer.frame(&shown)?;
                    let now = Arrival::of(shown.host_time_s.filter(|_| is_live));
                    summary.take_interval(before.replace(now), now);
                }
            }
        }
        Ok(summary)
    }
}

/// Reports that the reference waits for `left` frames, and why; at 0 it has been taken.
fn wait<O: LiveObserver>(
    stream: &LiveStream,
    left: usize,
    summary: &mut Summary,
    observer: &mut O,
) -> Result<(), O::Error> {
    observer.waiting(left)?;
    let was_restless = summary.unrest.is_some();
    summary.unrest = stream.unrest();
    if let (Some(change), false) = (summary.unrest, was_restless) {
        observer.event(&Event::Notice(unrest_text(change)))?;
    }
    if left == 0 {
        summary.references += 1;
        summary.images.how = stream.image_text().to_owned();
        stream.notes().iter().for_each(|note| summary.say(note.clone()));
        observer.reference(stream.reference_frames(), stream.notes(), stream.until())?;
    }
    Ok(())
}

/// Whether no frames come for a while, or those of another connection.
fn is_interruption(event: &Event) -> bool {
    matches!(event, Event::Silent { .. } | Event::Disconnected { .. } | Event::Reconnected { .. })
}

/// Describes why the reference waits, from the relative change of the voltages.
pub fn unrest_text(change: f64) -> String {
    format!(
        "frames change by {:.1} % of the voltages, as if the skin were touched or let go: the reference waits until they \
         rest",
        100.0 * change
    )
}

/// Maximum number of measurements times pixels for live images by total variation, each of whose iterations
/// passes twice over as many values: 134 MB, some tens of milliseconds. 208 measurements: 284 x 284 pixels.
const MOST_TV_VALUES: f64 = (1 << 24) as f64;

/// Largest number of reference frames: an hour at 28 frames a second, some hundred megabytes.
const MOST_REFERENCE_FRAMES: usize = 100_000;

/// Returns how many frames the reference of a replay has, where the recording does not name them: as many as the one
/// that it names first, else as the scene says, else [`REFERENCE_FRAMES`].
#[cfg(feature = "recording")]
pub fn replayed_reference_frames(
    replay: &mut eit_hw::driver::Replay,
    settings: &crate::scene::RecordingSettings,
) -> usize {
    let of_scene = || settings.reference.as_ref()?.first_frames();
    let recorded = replay.reference_frames().filter(|&count| is_reference(count));
    recorded.or_else(of_scene).unwrap_or(REFERENCE_FRAMES)
}

fn is_reference(count: usize) -> bool {
    (LEAST_REFERENCE_FRAMES..=MOST_REFERENCE_FRAMES).contains(&count)
}

fn check_reference_frames(count: usize) -> Result<(), SkinError> {
    if is_reference(count) {
        return Ok(());
    }
    Err(SkinError::input(format!(
        "{count} reference frames: there must be {LEAST_REFERENCE_FRAMES} to {MOST_REFERENCE_FRAMES}"
    )))
}
