//! Frames to touches as they come: one loop for an instrument, a replay and the demo.
//!
//! The first frames of an epoch are the reference; from then on each frame gives its touches
//! ([`TouchFinder`](crate::touches::TouchFinder)) and, for who wants to look, an image ([`LiveImages`]).
//! Touches do not depend on the pace: a recording gives the same to the bit. So do images, except that those
//! of live frames are skipped while frames wait ([`LiveObserver::wants_every_image`]).

mod clock;
mod images;
mod one_step;
mod sensor;
mod stream;
mod summary;

pub use images::{ImageState, LiveImages};
pub use sensor::{Sensor, TouchFrame};
pub use stream::{LiveFrame, LiveStream, Pushed};
pub use summary::Summary;

use crate::denoise::Net;
use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use crate::method::{self, Method};
use crate::progress::Progress;
use crate::scene::{NoiseSettings, Scene};
use crate::skin::Skin;
use crate::words::event_words;
use eit_hw::driver::{Event, FrameSource};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Frames of the reference where nothing else is asked for.
pub const REFERENCE_FRAMES: usize = 40;
/// Fewer do not show the noise.
const LEAST_REFERENCE_FRAMES: usize = 8;
/// How often to check for shutdown.
const WAIT: Duration = Duration::from_millis(50);

/// A consumer that is always behind still gets an image this often.
const LONGEST_SKIP: Duration = Duration::from_millis(250);

/// What is built before the first frame comes.
#[derive(Debug)]
pub struct LiveModel {
    /// The skin, linearised.
    pub linearised: Arc<LinearisedSkin>,
    pub(crate) method: Method,
    pub(crate) net: Option<Net>,
    /// Frames at the start of each epoch that are its reference.
    pub reference_frames: usize,
}

/// Sees what is found while frames come.
pub trait LiveObserver {
    /// What may go wrong with it.
    type Error: From<SkinError>;

    /// An event as it came, before anything is made of it.
    ///
    /// # Errors
    ///
    /// One ends the loop.
    fn event(&mut self, _event: &Event) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Nothing came for a moment.
    ///
    /// # Errors
    ///
    /// One ends the loop.
    fn idle(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Frames that are still wanted for the reference.
    ///
    /// # Errors
    ///
    /// One ends the loop.
    fn waiting(&mut self, _left: usize) -> Result<(), Self::Error> {
        Ok(())
    }

    /// A frame's touches, before its image is made: who acts on touches need not wait for it.
    ///
    /// # Errors
    ///
    /// One ends the loop.
    fn touches(&mut self, _frame: &LiveFrame<'_>) -> Result<(), Self::Error> {
        Ok(())
    }

    /// A frame's touches, and its image where images are made.
    ///
    /// # Errors
    ///
    /// One ends the loop.
    fn frame(&mut self, frame: &LiveFrame<'_>) -> Result<(), Self::Error>;

    /// Whether anybody may look at images, asked once before the first frame: touches do without, and come
    /// sooner where none is made.
    fn wants_images(&self) -> bool {
        true
    }

    /// Whether anybody looks at the image of the frame at hand, asked for each frame where somebody may.
    fn wants_image(&self) -> bool {
        true
    }

    /// Whether every image is needed, even if touches then come late. By default the image of a live frame
    /// is skipped while further frames wait, except for one every quarter of a second.
    fn wants_every_image(&self) -> bool {
        false
    }

    /// Whether to go on; called at least every 50 ms.
    fn goes_on(&mut self, summary: &Summary) -> bool;
}

impl LiveModel {
    /// Checks a scene and builds what needs no frame.
    ///
    /// # Errors
    ///
    /// Bad settings, before any work; a skin that cannot be built.
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

    /// Builds what needs no frame.
    ///
    /// # Errors
    ///
    /// Bad settings, or a skin that cannot be linearised.
    pub fn new(
        skin: &Skin,
        reference_frames: usize,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        check_reference_frames(reference_frames)?;
        skin.settings.touch.validate().map_err(|e| e.within(&skin.place))?;
        let mut linearised = skin.linearise(progress)?.in_frame_time(None, true)?;
        // those of other methods want the whole sequence, or cost more than a frame's time
        let method = match method::choose(&linearised.skin.settings, None, None)?.method {
            method if method.is_tv() => method,
            _ => Method::GaussNewton,
        };
        let net = linearised.skin.net()?;
        // frame numbers of a recording mean nothing here
        let noise = &mut linearised.skin.settings.noise;
        *noise = NoiseSettings { quiet_frames: None, ..noise.clone() };
        Ok(Self { linearised: Arc::new(linearised), method, net, reference_frames })
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        &self.linearised.skin
    }

    /// Watches a source until the observer has enough or the source is over.
    ///
    /// # Errors
    ///
    /// Those of the source, the images and the observer.
    pub fn watch<O: LiveObserver>(
        self: &Arc<Self>,
        source: &mut dyn FrameSource,
        is_live: bool,
        observer: &mut O,
    ) -> Result<Summary, O::Error> {
        let mut summary = Summary::default();
        let mut stream = LiveStream::new(Arc::clone(self), source.setup());
        if !observer.wants_images() {
            stream = stream.without_images();
        }
        let mut first_frame = None;
        let mut last_image = Instant::now();
        while observer.goes_on(&summary) && !source.is_over() {
            let Some(event) = source.next_event(WAIT).map_err(SkinError::from)? else {
                observer.idle()?;
                continue;
            };
            observer.event(&event)?;
            if matches!(event, Event::Reconnected { .. }) {
                // contacts and gains may have changed: an old reference does not hold
                stream.restart();
            }
            if let Some(words) = event_words(&event) {
                summary.say(words);
            }
            let Event::Frame(frame) = event else { continue };
            match stream.push_touches(&frame, is_live)? {
                Pushed::Waiting { left } => {
                    observer.waiting(left)?;
                    if left == 0 {
                        summary.references += 1;
                        summary.images = stream.image_words().to_owned();
                    }
                }
                Pushed::Shown(shown) => {
                    observer.touches(&shown)?;
                    if observer.wants_image() {
                        let is_behind =
                            is_live && source.frames_waiting() > 0 && !observer.wants_every_image();
                        if is_behind && last_image.elapsed() < LONGEST_SKIP {
                            summary.skipped_images += 1;
                        } else {
                            stream.make_image(&frame)?;
                            last_image = Instant::now();
                        }
                    }
                    if let Some(shown) = stream.shown(&frame) {
                        summary.take_frame(&shown);
                        observer.frame(&shown)?;
                    }
                    let first = *first_frame.get_or_insert_with(Instant::now);
                    summary.span_s = first.elapsed().as_secs_f64();
                }
            }
            source.recycle(frame);
        }
        Ok(summary)
    }
}

fn check_reference_frames(count: usize) -> Result<(), SkinError> {
    if count >= LEAST_REFERENCE_FRAMES {
        return Ok(());
    }
    Err(SkinError::input(format!(
        "--reference-frames {count}: it must be {LEAST_REFERENCE_FRAMES} or more"
    )))
}
