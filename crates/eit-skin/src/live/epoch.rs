//! What processes the frames between two references, and how it is set up.

use super::clock::Clock;
use super::{LiveImages, LiveModel, SkinState};
use crate::error::SkinError;
use crate::frames::of_frames;
use crate::progress::Progress;
use crate::touches::{TouchFinder, assumed_rate_text};
use eit_hw::{Frame, Unit};
use eit_inverse::touch::Touch;
use std::sync::Arc;
use std::thread::ScopedJoinHandle;

/// An image older than this says little about the next one, seconds.
const LONGEST_LINK_S: f64 = 0.5;

/// What all epochs of a stream have in common.
#[derive(Debug, Clone)]
pub(super) struct EpochSettings {
    pub model: Arc<LiveModel>,
    pub unit: Unit,
    pub frame_rate_hz: Option<f64>,
    pub with_images: bool,
}

/// Objects that process the frames of an epoch.
#[derive(Debug)]
pub(super) struct Epoch {
    /// Frames of its reference, ...
    pub reference: Vec<Frame>,
    /// ... and what they say about the scene.
    pub notes: Vec<String>,
    pub finder: TouchFinder,
    pub images: Option<LiveImages>,
    /// Whether the image of the last frame has been made.
    pub has_image: bool,
    /// Time of the last image, seconds.
    image_time_s: Option<f64>,
    pub clock: Clock,
}

impl EpochSettings {
    /// Sets up an epoch with these reference frames and notes about them; it continues the clock of the one before.
    pub(super) fn set_up(
        &self,
        before: Option<Clock>,
        reference: Vec<Frame>,
        mut notes: Vec<String>,
    ) -> Result<Epoch, SkinError> {
        let Self { model, unit, frame_rate_hz, with_images } = self;
        let clock = match before {
            Some(before) => before.next_epoch(*frame_rate_hz, &reference),
            None => Clock::new(*frame_rate_hz, &reference),
        };
        let frames = model.skin().frames_of_quiet(of_frames(&reference, *unit))?;
        let fitted = model.linearised.fit(frames)?;
        let (finder, images) = std::thread::scope(|scope| {
            let images = with_images.then(|| scope.spawn(|| LiveImages::new(model, &fitted)));
            let finder = TouchFinder::new(&fitted, clock.rate_hz, &mut Progress::silent());
            let join = |images: ScopedJoinHandle<'_, _>| {
                images.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            (finder, images.map(join).transpose())
        });
        let finder = finder?.ok_or_else(|| {
            SkinError::input(
                "the reference frames show no noise, from which touches are distinguished: set \
                 [noise] additive_v",
            )
        })?;
        notes.extend(fitted.frames.notes);
        notes.extend(finder.choices.warnings());
        // later epochs have the rate of the first
        if clock.is_assumed && before.is_none() {
            notes.push(assumed_rate_text());
        }
        // reference frames have no touches, so there is no image to make
        let (images, has_image, image_time_s) = (images?, true, None);
        Ok(Epoch { reference, notes, finder, images, has_image, image_time_s, clock })
    }
}

impl Epoch {
    /// Makes the image of the last frame, unless it has been made or images are disabled; returns whether it did.
    pub(super) fn make_image(
        &mut self,
        values: &[f64],
        touches: &[Touch],
        time_s: f64,
    ) -> Result<bool, SkinError> {
        let Self { finder, images: Some(images), has_image: false, .. } = self else {
            return Ok(false);
        };
        let is_old = self.image_time_s.is_none_or(|before_s| time_s - before_s > LONGEST_LINK_S);
        if is_old {
            images.restart();
        }
        self.image_time_s = Some(time_s);
        let is_good = |i: usize| !finder.is_missing(i);
        let is_explained = finder.step().is_none_or(|step| step.is_explained);
        images.push(values, finder.reference(), is_good, touches, is_explained)?;
        self.has_image = true;
        Ok(true)
    }

    /// What is known of the skin after the last frame.
    pub(super) fn state(&self) -> SkinState {
        match (self.finder.is_frozen(), self.finder.is_explained()) {
            (true, _) => SkinState::Frozen,
            (false, true) => SkinState::Sound,
            (false, false) => SkinState::NotExplained,
        }
    }

    /// Whether every used measurement of the last frame counted.
    pub(super) fn is_whole(&self) -> bool {
        let finder = &self.finder;
        let mut used = finder.used().iter().enumerate();
        finder.faults().is_empty() && used.all(|(i, used)| !used || !finder.is_missing(i))
    }
}
