//! Images in, touches out.

use super::contact::Touch;
use super::noise::{FalseAlarms, NoiseFloor};
use super::segment::{Rules, Segmenter};
use super::track::Tracker;
use crate::InverseError;
use crate::check::{check_length, check_positive};
use crate::metrics::{Cells, ChangeSign};

/// Settings of [`TouchStream`].
#[derive(Debug, Clone, PartialEq)]
pub struct TouchStreamSettings {
    /// Which changes are touches. Default: increase.
    pub sign: ChangeSign,
    /// False touches per hour that noise alone may make. Default 1.
    pub false_alarms_per_hour: f64,
    /// Images per second, hertz: turns that rate into one per image. Default 20.
    pub frame_rate_hz: f64,
    /// Touches at once, 1 to 64; the strongest are kept. Default 10.
    pub max_touches: usize,
    /// Images that must show a touch before it is reported. Default 2 ...
    pub birth_hits: usize,
    /// ... of this many, from the first that shows it; at most 32. Default 3.
    pub birth_frames: usize,
    /// Images in a row that need not show a touch before it ends. Default 3.
    pub forgiven_frames: usize,
    /// Least peak of a touch relative to the strongest of its image: what is lower may be an
    /// artefact of that one, which no noise floor knows. From 0 to 1; default 0.25.
    pub relative_floor: f64,
    /// Two tops are two touches where the lower one stands above the saddle by this part of its
    /// height (and by the noise floor). From 0 to 1; default 0.15.
    pub prominence: f64,
    /// Acceleration of touches, root mean square, m/s^2. Default 2: a finger that sets off to slide.
    pub acceleration_m_s2: f64,
    /// Velocity of touches that appear, root mean square in each coordinate, m/s. Default 0.3.
    pub velocity_std_m_s: f64,
    /// What a position errs by beyond the noise, from image to image, metres: pixels, artefacts.
    /// Default 0.5 mm.
    pub method_std_m: f64,
    /// Squared distance, in units of the joint covariance of prediction and measurement, beyond
    /// which a blob is not the touch. Default 16: one in 3000 of true pairs on a flat skin.
    pub gate: f64,
    /// Largest standard deviation of a valid position in any coordinate, metres. Default 10 mm.
    pub max_position_std_m: f64,
}

impl Default for TouchStreamSettings {
    fn default() -> Self {
        Self {
            sign: ChangeSign::Increase,
            false_alarms_per_hour: 1.0,
            frame_rate_hz: 20.0,
            max_touches: 10,
            birth_hits: 2,
            birth_frames: 3,
            forgiven_frames: 3,
            relative_floor: 0.25,
            prominence: 0.15,
            acceleration_m_s2: 2.0,
            velocity_std_m_s: 0.3,
            method_std_m: 0.5e-3,
            gate: 16.0,
            max_position_std_m: 10e-3,
        }
    }
}

impl TouchStreamSettings {
    /// Checks every number.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), InverseError> {
        self.alarms().validate()?;
        if !(1..=64).contains(&self.max_touches) {
            let (quantity, value) = ("max_touches", self.max_touches as f64);
            return Err(InverseError::OutOfRange { quantity, value, must: "from 1 to 64" });
        }
        for (quantity, value) in
            [("relative_floor", self.relative_floor), ("prominence", self.prominence)]
        {
            if !(0.0..=1.0).contains(&value) {
                return Err(InverseError::OutOfRange { quantity, value, must: "from 0 to 1" });
            }
        }
        check_positive("acceleration_m_s2", self.acceleration_m_s2)?;
        check_positive("velocity_std_m_s", self.velocity_std_m_s)?;
        check_positive("method_std_m", self.method_std_m)?;
        check_positive("gate", self.gate)?;
        check_positive("max_position_std_m", self.max_position_std_m)
    }

    fn alarms(&self) -> FalseAlarms {
        FalseAlarms {
            per_hour: self.false_alarms_per_hour,
            frame_rate_hz: self.frame_rate_hz,
            hits: self.birth_hits,
            of: self.birth_frames,
        }
    }
}

/// Finds and follows touches in a stream of images. [`push`](Self::push) allocates nothing.
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
    /// For images on `cells` (elements, or pixels: [`Cells::of_raster_on`]) whose noise is `floor`.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] for a floor of other images; [`InverseError::OutOfRange`] for
    /// settings.
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

    /// Where a touch begins, in standard deviations of the image's noise.
    pub fn threshold(&self) -> f64 {
        self.level
    }

    /// Independent cells that would reach the threshold as often as the image does.
    pub fn effective_cells(&self) -> f64 {
        self.effective_cells
    }

    /// Blobs of the last image that were left out because there were more than
    /// [`max_touches`](TouchStreamSettings::max_touches).
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// The noise floor.
    pub fn floor(&self) -> &NoiseFloor {
        &self.floor
    }

    /// Takes one image `[cell]` of the conductivity change, siemens, at `time_s`, and returns the
    /// touches by ascending id; one that ends is among them once more. Of an image that is zero
    /// everywhere only that is looked at.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`], [`InverseError::NonFiniteImage`],
    /// [`InverseError::TimeOrder`]. The stream is then as before.
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
        self.tracker.run(&self.segmenter, (time_s, dt), &self.settings, self.effective_cells);
        Ok(&self.tracker.touches)
    }

    /// [`push`](Self::push) of an image that is known to be zero everywhere, as
    /// [`FrameStatus::Unchanged`](crate::FrameStatus::Unchanged) says: the same touches, and no
    /// image to look at. Touches that were there are missed, and end as they would.
    ///
    /// # Errors
    /// [`InverseError::TimeOrder`]. The stream is then as before.
    pub fn push_unchanged(&mut self, time_s: f64) -> Result<&[Touch], InverseError> {
        let dt = self.advance(time_s)?;
        self.dropped = 0;
        self.segmenter.clear();
        self.tracker.run(&self.segmenter, (time_s, dt), &self.settings, self.effective_cells);
        Ok(&self.tracker.touches)
    }

    /// Moves the clock on; the time since the image before.
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

    /// Touches of the last image.
    pub fn touches(&self) -> &[Touch] {
        &self.tracker.touches
    }
}
