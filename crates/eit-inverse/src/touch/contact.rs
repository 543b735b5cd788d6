//! What is reported for each touch.

use super::LearntTouch;

/// Stage of a touch's life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum TouchState {
    /// Reported for the first time.
    Begin,
    /// Reported before.
    Hold,
    /// Reported for the last time: the touch has been missing for more frames than are forgiven. Position
    /// and strength are those of the last frame that showed it.
    End,
}

/// A contact on the skin.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Touch {
    /// Id, counted from 1 and never reused.
    pub id: u64,
    /// Begin, hold or end.
    pub state: TouchState,
    /// Filtered position, metres. On a curved skin the filter works in space, so a position between two
    /// others may be off the surface by the sagitta of one step.
    pub position_m: [f64; 3],
    /// Unit normal of the skin's mesh where the last frame showed the touch, on the side from which the
    /// corners of its triangles run counter-clockwise: +z on a flat skin, outward on a dome.
    pub normal: Option<[f64; 3]>,
    /// Covariance of the position, square metres, from the noise and the filter.
    pub position_covariance_m2: [[f64; 3]; 3],
    /// Velocity, metres per second.
    pub velocity_m_s: [f64; 3],
    /// Integral of the conductivity change over the touch, S m^2, with the sign of the change.
    pub intensity_s_m2: f64,
    /// Standard deviation of [`intensity_s_m2`](Self::intensity_s_m2), S m^2; `None` if unknown.
    pub intensity_std_s_m2: Option<f64>,
    /// Peak of the conductivity change, siemens (per square), with its sign.
    pub peak_s: f64,
    /// Result of the map learnt from presses at known positions and forces; `None` if nothing was learnt.
    pub learnt: Option<LearntTouch>,
    /// Confidence that there is a touch now, 0 to 1.
    ///
    /// From a [`TouchDetector`](super::TouchDetector): the fraction of touches with the same worth, age and
    /// ratio of strength to its standard deviation that were true on simulated fabrics.
    pub confidence: f64,
    /// Frames since [`TouchState::Begin`].
    pub age_frames: u64,
    /// Time since [`TouchState::Begin`], seconds.
    pub age_s: f64,
    /// Whether position and strength may be acted on: the current frame showed the touch, separate
    /// from all others, the standard deviation of its position is within the tracker's limit
    /// ([`max_position_std_m`](crate::touch::TrackerSettings::max_position_std_m)), and the
    /// model is not known to be wrong
    /// ([`TouchTracker::invalidate`](crate::touch::TouchTracker::invalidate)).
    pub valid: bool,
    /// Whether the frame was complete. False if faulty electrodes or bad values were left out, so that less
    /// is known than usual.
    pub whole: bool,
    /// The touch from whose area this one split off.
    pub split_from: Option<u64>,
    /// The touch into whose area this one has merged; it may come back.
    pub merged_into: Option<u64>,
}

impl Touch {
    /// Returns the force, newtons; `None` if none was learnt.
    pub fn force_n(&self) -> Option<f64> {
        self.learnt?.force_n.map(|[force_n, _]| force_n)
    }

    /// Returns the standard deviation of the force, newtons; `None` if none was learnt.
    pub fn force_std_n(&self) -> Option<f64> {
        self.learnt?.force_n.map(|[_, std_n]| std_n)
    }

    /// Returns the standard deviation of each coordinate, metres.
    pub fn position_std_m(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.position_covariance_m2[i][i].max(0.0).sqrt())
    }
}

/// For other mathematics crates.
#[cfg(feature = "mint")]
#[cfg_attr(docsrs, doc(cfg(feature = "mint")))]
impl Touch {
    /// Returns the position as a point of `mint`, metres, which most mathematics crates convert.
    pub fn position(&self) -> mint::Point3<f64> {
        self.position_m.into()
    }

    /// Returns the unit normal as a vector of `mint`; see [`normal`](Self::normal).
    pub fn normal_vector(&self) -> Option<mint::Vector3<f64>> {
        self.normal.map(Into::into)
    }

    /// Returns the velocity as a vector of `mint`, metres per second.
    pub fn velocity(&self) -> mint::Vector3<f64> {
        self.velocity_m_s.into()
    }
}
