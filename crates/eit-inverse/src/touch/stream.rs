//! Touches from a stream of images.

use super::contact::Touch;
use super::noise::NoiseFloor;
use super::segment::{Rules, Segmenter};
use super::settings::TouchStreamSettings;
use super::track::Tracker;
use crate::InverseError;
use crate::check::check_length;
use crate::metrics::Cells;

/// Finds and follows touches in a stream of images. [`push`](Self::push) does not allocate.
#[derive(Debug, Clone)]
pub struct TouchStream {
    settings: TouchStreamSettings,
    floor: NoiseFloor,
    level: f64,
    effective_cells: f64,
    segmenter: Segmenter,
    tracker: Tracker,
    frame: usize,
    before_s: Option<f64>,
    dropped: usize,
}

impl TouchStream {
    /// Builds a stream for images on `cells` (elements, or pixels: [`Cells::of_raster_on`]) with noise
    /// `floor`.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] if the floor belongs to other images; [`InverseError::OutOfRange`] for
    /// invalid settings.
    pub fn new(
        cells: Cells<3>,
        floor: NoiseFloor,
        settings: TouchStreamSettings,
    ) -> Result<Self, InverseError> {
        settings.validate()?;
        let count = cells.areas_m2().len();
        check_length("cells of the noise floor", floor.std().len(), count)?;
        let (level, effective_cells) = floor.threshold(&settings.alarms())?;
        let segmenter = Segmenter::new(cells, floor.sources(), settings.max_touches);
        let tracker = Tracker::new(count, settings.max_touches);
        let (frame, before_s, dropped) = (0, None, 0);
        Ok(Self {
            settings,
            floor,
            level,
            effective_cells,
            segmenter,
            tracker,
            frame,
            before_s,
            dropped,
        })
    }

    /// Returns the threshold of a touch in standard deviations of the image's noise.
    pub fn threshold(&self) -> f64 {
        self.level
    }

    /// Number of independent cells that would reach the threshold as often as the image does.
    pub fn effective_cells(&self) -> f64 {
        self.effective_cells
    }

    /// Number of blobs of the last image left out because there were more than
    /// [`max_touches`](TouchStreamSettings::max_touches).
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Returns the noise floor.
    pub fn floor(&self) -> &NoiseFloor {
        &self.floor
    }

    /// Takes one image `[cell]` of the conductivity change, siemens, at `time_s` and returns the touches in
    /// ascending order of id.
    ///
    /// A touch that ends is returned once more. An image of zeros costs only that test.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`], [`InverseError::NonFiniteImage`], [`InverseError::TimeOrder`]. The
    /// stream is then unchanged.
    pub fn push(&mut self, image: &[f64], time_s: f64) -> Result<&[Touch], InverseError> {
        self.segmenter.cells.check("image", image)?;
        if let Some(cell) = image.iter().position(|x| !x.is_finite()) {
            let (frame, value) = (self.frame, image[cell]);
            return Err(InverseError::NonFiniteImage { frame, cell, value });
        }
        if image.iter().all(|x| *x == 0.0) {
            return self.push_unchanged(time_s);
        }
        let dt = self.advance(time_s)?;
        let TouchStreamSettings { sign, relative_floor, prominence, .. } = self.settings;
        let rules = Rules { sign, level: self.level, relative_floor, prominence };
        self.dropped = self.segmenter.run(image, &self.floor, &rules);
        self.tracker.run(&self.segmenter, time_s, dt, &self.settings, self.effective_cells);
        Ok(&self.tracker.touches)
    }

    /// Takes an image that is known to be zero everywhere, as
    /// [`FrameStatus::Unchanged`](crate::FrameStatus::Unchanged) says.
    ///
    /// The result equals that of [`push`](Self::push) with zeros. Existing touches are missing from this
    /// image and end accordingly.
    ///
    /// # Errors
    /// [`InverseError::TimeOrder`]. The stream is then unchanged.
    pub fn push_unchanged(&mut self, time_s: f64) -> Result<&[Touch], InverseError> {
        let dt = self.advance(time_s)?;
        self.dropped = 0;
        self.segmenter.clear();
        self.tracker.run(&self.segmenter, time_s, dt, &self.settings, self.effective_cells);
        Ok(&self.tracker.touches)
    }

    /// Advances the clock and returns the time since the previous image.
    fn advance(&mut self, time_s: f64) -> Result<f64, InverseError> {
        let before_s = self.before_s.unwrap_or(f64::NEG_INFINITY);
        if !(time_s.is_finite() && time_s > before_s) {
            return Err(InverseError::TimeOrder { frame: self.frame, time_s, before_s });
        }
        let dt = self.before_s.map_or(0.0, |before_s| time_s - before_s);
        self.frame += 1;
        self.before_s = Some(time_s);
        Ok(dt)
    }

    /// Returns the touches of the last image.
    pub fn touches(&self) -> &[Touch] {
        &self.tracker.touches
    }
}
