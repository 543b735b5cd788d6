//! A reference frame that follows slow drift and holds while something touches the skin.
//!
//! Each channel has a level `l` with a slope `s`, tracked by a critically damped g-h filter:
//!
//! ```text
//! p = l + s dt,   r = v - p,   l = p + (1 - b^2) r,   s += (1 - b)^2 r / dt,   b = exp(-dt / tau)
//! ```
//!
//! so a drift of constant rate is followed without lag (Brookner, *Tracking and Kalman Filtering Made Easy*
//! (1998), section 1.2.6). Under contact the level holds; its earlier slope continues and decays with the
//! same time constant. Changes common to the whole skin are followed under contact too, in the channels
//! that the touch changes least: temperature, for example, changes the conductivity of the whole sheet and
//! with it every voltage by one factor.

mod common;
mod settings;

use crate::InverseError;
use crate::check::check_length;
use crate::noise::deviations;
use common::{Common, Held};
use ndarray::ArrayView2;
pub use settings::ReferenceSettings;

/// Fewest quiet frames for the noise of a channel: with 20 it is known to a fifth.
const LEAST_FRAMES: usize = 20;

/// Threshold for a quiet frame: chi^2 above its mean, in standard deviations.
const ABOVE: f64 = 6.0;

/// What the reference did with a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum ReferenceState {
    /// It followed the frame.
    Following,
    /// It held: the tracker reports a touch, or did a moment ago.
    Touched,
    /// It held: the frame differs from it by more than noise.
    Disturbed,
    /// It was set to the frame on request.
    Zeroed,
}

/// Comparison of a frame with the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ReferenceStep {
    /// What the reference did with the frame.
    pub state: ReferenceState,
    /// Mean square of the difference from the reference in units of the noise; near 1 for quiet frames.
    pub reduced_chi_square: f64,
    /// How long the reference has held, seconds. If the skin does not return after a touch (creep), it
    /// holds forever; [`AdaptiveReference::rezero`] ends that.
    pub held_s: f64,
    /// Factor of the common drift since contact began; 1 while following.
    pub common_factor: f64,
}

/// Adaptive reference frame of a stream. [`push`](Self::push) does not allocate.
///
/// ```
/// use eit_inverse::{AdaptiveReference, ReferenceSettings};
///
/// // two measurements with 1 uV of noise that drift by 1 nV a frame for 100 s while nobody touches
/// let mut reference =
///     AdaptiveReference::with_noise(&[1e-3, 2e-3], &[1e-6; 2], ReferenceSettings::default())?;
/// for frame in 0..2000 {
///     let drift = 1e-9 * f64::from(frame);
///     reference.push(&[1e-3 + drift, 2e-3 + drift], 0.05 * f64::from(frame), false)?;
/// }
/// assert!(reference.reference()[0] > 1e-3 + 1.5e-6, "it follows");
/// # Ok::<(), eit_inverse::InverseError>(())
/// ```
#[derive(Debug, Clone)]
pub struct AdaptiveReference {
    settings: ReferenceSettings,
    noise_std_v: Vec<f64>,
    level_v: Vec<f64>,
    slope_v_s: Vec<f64>,
    /// Reference to subtract from the last frame.
    reference_v: Vec<f64>,
    /// Time since the level was last updated, seconds.
    held_s: f64,
    /// Time since the last sign of contact, seconds.
    quiet_s: f64,
    last_s: Option<f64>,
    frame: usize,
    zero_next: bool,
    common: Common,
}

impl AdaptiveReference {
    /// Estimates reference and noise from quiet frames `[frame, measurement]`, volts.
    ///
    /// # Errors
    /// [`InverseError::TooFewQuietFrames`] below 20; [`InverseError::NonFiniteData`];
    /// [`InverseError::NoiseUnknown`] if a channel never changes: give the noise with
    /// [`with_noise`](Self::with_noise) instead.
    pub fn of_quiet_frames(
        frames: ArrayView2<'_, f64>,
        settings: ReferenceSettings,
    ) -> Result<Self, InverseError> {
        let count = frames.nrows();
        if count < LEAST_FRAMES {
            return Err(InverseError::TooFewQuietFrames { found: count, needed: LEAST_FRAMES });
        }
        if let Some(((frame, measurement), &value)) =
            frames.indexed_iter().find(|(_, v)| !v.is_finite())
        {
            return Err(InverseError::NonFiniteData { frame, measurement, value });
        }
        let mean = |channel: ndarray::ArrayView1<'_, f64>| channel.sum() / count as f64;
        let reference: Vec<f64> = frames.columns().into_iter().map(mean).collect();
        // from differences of successive frames, so that drift does not count as noise
        let noise = deviations(frames);
        if noise.contains(&0.0) {
            let what = "a measurement does not change over the quiet frames";
            return Err(InverseError::NoiseUnknown { what });
        }
        // The reference has noise of its own, and the mean of 1 / estimated variance is too large by n / (n
        // - 2), n the effective degrees of freedom (3 / 2 frames for each).
        let degrees = 2.0 * (count - 1) as f64 / 3.0;
        let share = ((1.0 + 1.0 / count as f64) * degrees / (degrees - 2.0)).sqrt();
        let noise: Vec<f64> = noise.iter().map(|e| e * share).collect();
        Self::with_noise(&reference, &noise, settings)
    }

    /// Starts from a known reference frame and the standard deviation of a frame's noise, both
    /// `[measurement]`, volts.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`], [`InverseError::NonFiniteReference`],
    /// [`InverseError::MeasurementOutOfRange`], [`InverseError::OutOfRange`].
    pub fn with_noise(
        reference_v: &[f64],
        noise_std_v: &[f64],
        settings: ReferenceSettings,
    ) -> Result<Self, InverseError> {
        settings.validate()?;
        check_length("noise_std_v", noise_std_v.len(), reference_v.len())?;
        if reference_v.is_empty() {
            return Err(InverseError::NothingUsed { measurements: 0 });
        }
        if let Some(measurement) = reference_v.iter().position(|v| !v.is_finite()) {
            let value = reference_v[measurement];
            return Err(InverseError::NonFiniteReference { measurement, value });
        }
        if let Some(measurement) = noise_std_v.iter().position(|e| !(e.is_finite() && *e > 0.0)) {
            let (quantity, value) = ("noise_std_v", noise_std_v[measurement]);
            let must = "finite and above zero";
            return Err(InverseError::MeasurementOutOfRange { quantity, measurement, value, must });
        }
        let count = reference_v.len();
        Ok(Self {
            settings,
            noise_std_v: noise_std_v.to_vec(),
            level_v: reference_v.to_vec(),
            slope_v_s: vec![0.0; count],
            reference_v: reference_v.to_vec(),
            held_s: 0.0,
            quiet_s: f64::INFINITY,
            last_s: None,
            frame: 0,
            zero_next: false,
            common: Common::new(count),
        })
    }

    /// Returns the reference to subtract from the last frame, volts, `[measurement]`.
    pub fn reference(&self) -> &[f64] {
        &self.reference_v
    }

    /// Returns the noise of a frame, volts, `[measurement]`.
    pub fn noise_std_v(&self) -> &[f64] {
        &self.noise_std_v
    }

    /// Sets the reference to the next frame whatever touches the skin; its slope becomes zero.
    pub fn rezero(&mut self) {
        self.zero_next = true;
    }

    /// Takes a frame `[measurement]`, volts, at `time_s`.
    ///
    /// `touched` says whether the tracker reports a touch (of the previous frame, since this frame's
    /// touches are not known yet).
    ///
    /// # Errors
    /// [`InverseError::WrongLength`], [`InverseError::NonFiniteData`], [`InverseError::TimeOrder`]. The
    /// reference is then unchanged.
    pub fn push(
        &mut self,
        frame: &[f64],
        time_s: f64,
        touched: bool,
    ) -> Result<ReferenceStep, InverseError> {
        check_length("frame", frame.len(), self.level_v.len())?;
        if let Some(measurement) = frame.iter().position(|v| !v.is_finite()) {
            let value = frame[measurement];
            return Err(InverseError::NonFiniteData { frame: self.frame, measurement, value });
        }
        let before_s = self.last_s.unwrap_or(f64::NEG_INFINITY);
        if !(time_s.is_finite() && time_s > before_s) {
            return Err(InverseError::TimeOrder { frame: self.frame, time_s, before_s });
        }
        let dt = self.last_s.map_or(0.0, |last_s| time_s - last_s);
        self.last_s = Some(time_s);
        self.frame += 1;
        if std::mem::take(&mut self.zero_next) {
            return Ok(self.zero(frame));
        }
        self.held_s += dt;
        self.quiet_s += dt;
        self.extrapolate();
        let mut chi_square = self.reduced_chi_square(frame, 1.0);
        let spread = (2.0 / frame.len() as f64).sqrt();
        let limit = 1.0 + ABOVE * spread;
        let mut disturbed = chi_square > limit;
        if disturbed && !touched && self.settings.common_mode {
            // a drift whose slope is not known yet lags; a change common to all channels is not a touch
            let factor = 1.0 + self.common.median_of_all(frame, &self.reference_v);
            disturbed = self.reduced_chi_square(frame, factor) > limit;
        }
        if touched || disturbed {
            self.quiet_s = 0.0;
        }
        let state = match (touched || self.quiet_s < self.settings.release_s, disturbed) {
            (_, true) if !touched => ReferenceState::Disturbed,
            (true, _) => ReferenceState::Touched,
            _ => ReferenceState::Following,
        };
        if state == ReferenceState::Following {
            self.follow(frame, dt);
        } else if self.settings.common_mode {
            let held = Held { held_s: self.held_s, dt_s: dt, touched };
            self.common.update(&self.settings, held, frame, &mut self.reference_v);
            chi_square = self.reduced_chi_square(frame, 1.0);
        }
        let held_s = if state == ReferenceState::Following { 0.0 } else { self.held_s };
        let common_factor = self.common.factor;
        Ok(ReferenceStep { state, reduced_chi_square: chi_square, held_s, common_factor })
    }

    fn zero(&mut self, frame: &[f64]) -> ReferenceStep {
        self.level_v.copy_from_slice(frame);
        self.reference_v.copy_from_slice(frame);
        self.slope_v_s.fill(0.0);
        self.common.reset();
        (self.held_s, self.quiet_s) = (0.0, f64::INFINITY);
        let state = ReferenceState::Zeroed;
        ReferenceStep { state, reduced_chi_square: 0.0, held_s: 0.0, common_factor: 1.0 }
    }

    /// Extrapolates the level by its slope: fully for the next frame, decaying under contact.
    fn extrapolate(&mut self) {
        let tau = self.settings.time_constant_s;
        let way = -tau * (-self.held_s / tau).exp_m1();
        let parts = self.level_v.iter().zip(&self.slope_v_s);
        for (reference, (level, slope)) in self.reference_v.iter_mut().zip(parts) {
            *reference = (level + slope * way) * self.common.factor;
        }
    }

    /// Mean squared difference from the reference times a factor, in units of the noise.
    fn reduced_chi_square(&self, frame: &[f64], factor: f64) -> f64 {
        let parts = frame.iter().zip(&self.reference_v).zip(&self.noise_std_v);
        let sum: f64 =
            parts.map(|((v, reference), e)| ((v - factor * reference) / e).powi(2)).sum();
        sum / frame.len() as f64
    }

    fn follow(&mut self, frame: &[f64], dt: f64) {
        // the common drift under contact stays in the level
        let gap_s = self.held_s;
        self.common.reset();
        self.held_s = 0.0;
        let tau = self.settings.time_constant_s;
        // after a gap, weigh this frame as one frame and not by the length of the gap
        let beta = (-dt / tau).exp();
        let [gain, slope_gain] =
            [1.0 - beta * beta, (1.0 - beta).powi(2) / dt.max(f64::MIN_POSITIVE)];
        for (i, v) in frame.iter().enumerate() {
            let residual = v - self.reference_v[i];
            self.level_v[i] = self.reference_v[i] + gain * residual;
            self.slope_v_s[i] *= (-(gap_s - dt).max(0.0) / tau).exp();
            if dt > 0.0 {
                self.slope_v_s[i] += slope_gain * residual;
            }
        }
    }
}
