//! What is reported of a touch.

use super::LearntTouch;

/// Where a touch is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TouchState {
    /// Reported for the first time.
    Begin,
    /// Reported before.
    Hold,
    /// Reported for the last time: the touch has been missing for longer than is forgiven. Place
    /// and strength are those of the last image that showed it.
    End,
}

/// A contact on the skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Name, from 1, never used again.
    pub id: u64,
    /// Begin, hold or end.
    pub state: TouchState,
    /// Filtered position, metres. On a curved skin the filter works in space, so that a place
    /// between two others may be off the surface by the sagitta of one step.
    pub position_m: [f64; 3],
    /// Covariance of the position, square metres: the image's noise and the filter's. What the
    /// imaging method errs by (one-step images: outward, up to a tenth of the radius near a rim) is
    /// not in it.
    pub position_covariance_m2: [[f64; 3]; 3],
    /// Velocity, metres per second.
    pub velocity_m_s: [f64; 3],
    /// Area in which the change is at least half of its peak, square metres; `None` where the method
    /// does not tell touches of one size from those of another.
    pub area_m2: Option<f64>,
    /// Integral of the conductivity change over the touch, S m^2; with the sign of the change.
    pub intensity_s_m2: f64,
    /// Standard deviation of it; `None` where it is not known.
    pub intensity_std_s_m2: Option<f64>,
    /// Peak of the conductivity change, siemens (per square); with its sign.
    pub peak_s: f64,
    /// What presses at known places and forces have taught of it; `None` where none were learnt.
    pub learnt: Option<LearntTouch>,
    /// How sure it is that there is a touch now, 0 to 1. Of a [`TouchDetector`](super::TouchDetector)'s:
    /// the part of touches that explain as much, are as old and are as well known which were true on
    /// simulated fabrics. Of images: `(1 - p) h`, where `p` is the probability that noise alone
    /// makes a peak as high anywhere in one image and `h` the share of the last
    /// images (as many as a birth may take, fewer for young touches) that showed the touch. It
    /// knows of noise alone, not of artefacts.
    pub confidence: f64,
    /// Images since [`TouchState::Begin`].
    pub age_frames: u64,
    /// Time since [`TouchState::Begin`], seconds.
    pub age_s: f64,
    /// Whether position and strength can be acted on: this image showed the touch, apart from all
    /// others, and its position is known to
    /// [`max_position_std_m`](crate::touch::TouchStreamSettings::max_position_std_m).
    pub valid: bool,
    /// Whether every measurement counted: false where faulty electrodes or bad values were left out of
    /// the frame, so that less is known than otherwise.
    pub whole: bool,
    /// The touch out of whose area this one came.
    pub split_from: Option<u64>,
    /// The touch in whose area this one has vanished; it may come back.
    pub merged_into: Option<u64>,
}

impl Touch {
    /// Force, newtons, where it was learnt.
    pub fn force_n(&self) -> Option<f64> {
        self.learnt?.force_n.map(|[force_n, _]| force_n)
    }

    /// Standard deviation of the force, newtons.
    pub fn force_std_n(&self) -> Option<f64> {
        self.learnt?.force_n.map(|[_, std_n]| std_n)
    }

    /// Standard deviation of each coordinate, metres.
    pub fn position_std_m(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.position_covariance_m2[i][i].max(0.0).sqrt())
    }
}
