//! Summary of a live session, in bounded memory.

use super::clock::Arrival;
use super::{ImageState, LiveImages, SkinState, TouchFrame};
use crate::faults::ElectrodeFault;
use eit_core::quantile;
use eit_inverse::touch::{Touch, TouchState};

/// Number of latest latencies on which the summary is based.
const LATENCIES: usize = 10_000;
/// Maximum number of notices kept, the first ones: a broken line repeats the same notice all day.
pub(super) const NOTICES: usize = 100;

/// Longest time between the arrivals of two frames, seconds; a longer gap counts as silence.
const MOST_STEP_S: f64 = 60.0;

/// Summary of a live session.
#[derive(Debug, Clone, Default, serde::Serialize)]
#[non_exhaustive]
pub struct Summary {
    /// Number of frames shown.
    pub frames: u64,
    /// Number of references taken.
    pub references: u64,
    /// Number of touches that were valid in at least one frame.
    pub touches: u64,
    /// Largest number of simultaneous valid touches.
    pub most_at_once: usize,
    /// Ids of the valid touches that have not ended.
    #[serde(skip)]
    counted: Vec<u64>,
    /// Relative change of the voltages while the reference waited, if it was still waiting at the
    /// end.
    pub unrest: Option<f64>,
    /// Number of frames that touches do not explain ([`SkinState::NotExplained`]).
    pub not_explained: u64,
    /// Number of frames in which the instrument repeated an old frame.
    pub frozen: u64,
    /// How images were made.
    pub images: ImageSummary,
    /// The first faults of electrodes, in the order in which they were found.
    pub faults: Vec<ElectrodeFault>,
    /// Latest latencies of touches, seconds, unordered.
    pub latencies_s: Vec<f64>,
    /// Latest latencies of images, seconds, unordered.
    pub image_latencies_s: Vec<f64>,
    /// Time from the first frame shown to the last by this computer's clock (for live frames, their
    /// arrivals), seconds, without times in which the source was silent or a new reference was
    /// taken.
    pub span_s: f64,
    /// Number of intervals between frames within [`span_s`](Self::span_s).
    pub intervals: u64,
    /// The first notices of the source.
    pub notices: Vec<String>,
    /// Number of further notices.
    pub more_notices: u64,
}

/// How the images of a live session were made.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct ImageSummary {
    /// Method and weights of the last epoch.
    pub how: String,
    /// Largest certified gap of an image that reached the one it should have, ...
    pub worst_gap: Option<f64>,
    /// ... number of those whose time was over before, ...
    pub unfinished: u64,
    /// ... and the largest gap of these.
    pub worst_unfinished_gap: Option<f64>,
    /// Number of frames whose U-net image did not explain the measurements, so that its input was shown.
    pub put_aside: u64,
    /// Number of those whose raw image does not explain the measurements either.
    pub unexplained: u64,
    /// Number of frames that no image explains within `delta`.
    pub beyond_delta: u64,
    /// Number of frames without an image, because movement of electrodes cannot be removed from a frame with
    /// bad values.
    pub lost: u64,
    /// Number of frames whose image was skipped because further frames were waiting.
    pub skipped: u64,
}

impl ImageSummary {
    /// Describes for people how the images were made.
    pub fn description(&self) -> String {
        let mut words = self.how.clone();
        if let Some(gap) = self.worst_gap {
            words += &format!(", proven to within {:.1} % of the optimum", 100.0 * gap.max(0.0));
        }
        if let Some(gap) = self.worst_unfinished_gap {
            let (count, gap) = (self.unfinished, 100.0 * gap.max(0.0));
            words += &format!(", {count} images whose time was over before to within {gap:.1} %");
        }
        let mut add = |count: u64, what: &str| {
            if count > 0 {
                words += &format!("; {count} {what}");
            }
        };
        add(
            self.put_aside,
            "of the U-net do not explain their measurements: the raw image is shown",
        );
        add(self.beyond_delta, "frames fit no image within delta: skipped");
        let lost = "frames have bad values and no image: electrode_movement_m mixes measurements";
        add(self.lost, lost);
        let skipped =
            "frames have no image, as this computer could not keep up (touches are never skipped)";
        add(self.skipped, skipped);
        words
    }

    fn take(&mut self, state: ImageState) {
        self.put_aside += u64::from(state.is_aside);
        self.unexplained += u64::from(state.is_unexplained);
        self.beyond_delta += u64::from(state.is_interpolated);
        self.lost += u64::from(state.is_lost);
        self.unfinished += u64::from(state.is_unfinished);
        if let Some(gap) = state.gap {
            let worst = match state.is_unfinished {
                true => &mut self.worst_unfinished_gap,
                false => &mut self.worst_gap,
            };
            *worst = Some(worst.map_or(gap, |worst| worst.max(gap)));
        }
    }
}

impl Summary {
    /// Returns the frame rate, excluding times without frames; `None` for fewer than two frames.
    pub fn frame_rate_hz(&self) -> Option<f64> {
        (self.span_s > 0.0).then(|| self.intervals as f64 / self.span_s)
    }

    /// Returns the latency from a frame's last byte to its touches that the fraction `share` (0 to 1) of the
    /// frames did not exceed.
    pub fn latency_s(&self, share: f64) -> Option<f64> {
        quantile(&self.latencies_s, share)
    }

    /// Returns the same for the latency to its image.
    pub fn image_latency_s(&self, share: f64) -> Option<f64> {
        quantile(&self.image_latencies_s, share)
    }

    fn take(&mut self, touches: &[Touch], state: ImageState, latency_s: Option<f64>) {
        self.frames += 1;
        for touch in touches {
            let place = self.counted.iter().position(|id| *id == touch.id);
            match (place, touch.state == TouchState::End) {
                (Some(place), true) => drop(self.counted.swap_remove(place)),
                (None, false) if touch.valid => {
                    self.counted.push(touch.id);
                    self.touches += 1;
                }
                _ => {}
            }
        }
        let counts = |touch: &&Touch| touch.valid && touch.state != TouchState::End;
        self.most_at_once = self.most_at_once.max(touches.iter().filter(counts).count());
        self.images.take(state);
        remember(&mut self.latencies_s, self.frames, latency_s);
    }

    /// Records a frame and its image.
    pub(crate) fn take_frame(&mut self, shown: &TouchFrame<'_>) {
        let state = shown.images.map(LiveImages::state).unwrap_or_default();
        self.take(shown.touches, state, shown.latency_s);
        self.not_explained += u64::from(shown.state == SkinState::NotExplained);
        self.frozen += u64::from(shown.state == SkinState::Frozen);
        self.take_faults(shown.faults);
        remember(&mut self.image_latencies_s, self.frames, shown.image_latency_s);
    }

    /// Adds the time since the frame before, if frames came all the time. Frames that waited while a reference was taken
    /// are shown at once, but arrived in their time.
    pub(super) fn take_interval(&mut self, before: Option<Arrival>, now: Arrival) {
        let Some(before) = before else { return };
        let arrived_s =
            now.arrived_s.zip(before.arrived_s).map(|(now_s, before_s)| now_s - before_s);
        let shown_s = now.shown.duration_since(before.shown).as_secs_f64();
        // a clock that was set says nothing
        self.span_s += arrived_s.filter(|s| (0.0..=MOST_STEP_S).contains(s)).unwrap_or(shown_s);
        self.intervals += 1;
    }

    /// Records new faults.
    fn take_faults(&mut self, faults: &[ElectrodeFault]) {
        for fault in faults {
            if self.faults.len() < NOTICES && !self.faults.contains(fault) {
                self.faults.push(*fault);
            }
        }
    }

    pub(crate) fn say(&mut self, words: String) {
        if self.notices.len() < NOTICES {
            self.notices.push(words);
        } else {
            self.more_notices += 1;
        }
    }
}

/// Keeps the latest values.
fn remember(latencies_s: &mut Vec<f64>, frame: u64, latency_s: Option<f64>) {
    let Some(latency_s) = latency_s else { return };
    if latencies_s.len() == LATENCIES {
        latencies_s[(frame % LATENCIES as u64) as usize] = latency_s;
    } else {
        latencies_s.push(latency_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Touches count from the first frame on in which they are valid; those that never are do not.
    #[test]
    fn valid_touches_are_counted_once() {
        let touch = |id, valid, state| Touch {
            id,
            state,
            position_m: [0.0; 3],
            normal: None,
            position_covariance_m2: [[1e-6; 3]; 3],
            velocity_m_s: [0.0; 3],
            intensity_s_m2: 1e-11,
            intensity_std_s_m2: None,
            peak_s: 1e-6,
            learnt: None,
            confidence: 0.9,
            age_frames: 0,
            age_s: 0.0,
            valid,
            whole: true,
            split_from: None,
            merged_into: None,
        };
        use TouchState::{Begin, End, Hold};
        let mut summary = Summary::default();
        let never = [Begin, Hold, End].map(|state| touch(1, false, state));
        let later = [
            touch(2, false, Begin),
            touch(2, true, Hold),
            touch(2, true, Hold),
            touch(2, true, End),
        ];
        for touch in never.into_iter().chain(later) {
            summary.take(&[touch], ImageState::default(), None);
        }
        assert_eq!((summary.touches, summary.most_at_once), (1, 1));
        let two = [touch(3, true, Begin), touch(4, true, Begin), touch(5, false, Begin)];
        summary.take(&two, ImageState::default(), None);
        assert_eq!((summary.touches, summary.most_at_once), (3, 2));
    }

    /// A source that repeats its notices forever does not fill the memory.
    #[test]
    fn notices_and_latencies_are_bounded() {
        let mut summary = Summary::default();
        for number in 0..NOTICES + 900 {
            summary.say(format!("notice {number}"));
        }
        assert_eq!((summary.notices.len(), summary.more_notices), (NOTICES, 900));
        assert_eq!(summary.notices[0], "notice 0");
        for number in 0..3 * LATENCIES {
            summary.take(&[], ImageState::default(), Some(number as f64));
        }
        assert_eq!(summary.latencies_s.len(), LATENCIES);
        // the latest values
        assert!(summary.latencies_s.iter().all(|&s| s >= (2 * LATENCIES) as f64));
    }
}
