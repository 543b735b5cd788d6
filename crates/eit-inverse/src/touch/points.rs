//! Tracking of detected touches from frame to frame.

mod settings;

pub use settings::TrackerSettings;

use super::contact::{Touch, TouchState};
use super::detector::DetectedTouch;
use super::motion::Motion;
use crate::InverseError;
use crate::assign::Assignment;
use crate::geometry::distance_m;

/// Cost of a forbidden pair: above any sum of squared gates.
const NEVER: f64 = 1e7;

/// Touches per frame that are always accepted: as many as a [`TouchDetector`](super::TouchDetector) can find.
const LEAST_ROOM: usize = 16;

/// Standard deviations that a strength must have for a touch to be reported at once.
///
/// Fabric and electrodes that a finger drags along cause spots at the rim for one frame. They are
/// strong, but the standard deviation of their strength is a third of its value or more; for a
/// finger it is a few percent.
const KNOWN: f64 = 4.0;

/// Standard deviations that the strength of a valid touch must have. Of 61 false touches (five
/// built-in skins and two rectangles with 8 and 32 electrodes; true ones are within 25 mm of a
/// finger) 20 fall below it, of 1 870 true ones at most 3. With three standard deviations 45 and 15
/// would; but a twelfth more of four fingers on a plate would be lost, and half of the presses
/// beyond the outer electrodes, where positions are known better than strengths.
const ACTED_ON: f64 = 0.75;

/// Time for which touches are held while nothing is known of the skin, seconds.
const HELD_S: f64 = 0.5;

#[derive(Debug, Clone, Copy)]
struct Track {
    id: Option<u64>,
    motion: Motion,
    seen: DetectedTouch,
    /// Filtered position in the last frame that showed it.
    last_m: [f64; 3],
    shown: usize,
    /// Time of the last frame that showed it.
    seen_s: f64,
    missed: usize,
    frames: u64,
    begin: Option<(u64, f64)>,
    matched: bool,
    ended: bool,
}

/// Follows touches from frame to frame; [`push`](Self::push) does not allocate.
#[derive(Debug, Clone)]
pub struct TouchTracker {
    settings: TrackerSettings,
    /// Most touches per frame; twice as many are tracked, new ones included.
    most: usize,
    tracks: Vec<Track>,
    assignment: Assignment,
    taken: Vec<bool>,
    next_id: u64,
    before_s: Option<f64>,
    frame: usize,
    is_whole: bool,
    /// Whether the last frame says anything about the skin.
    is_seen: bool,
    touches: Vec<Touch>,
}

impl TouchTracker {
    /// Builds a tracker after checking the settings.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    pub fn new(settings: TrackerSettings) -> Result<Self, InverseError> {
        settings.validate()?;
        let most = settings.max_touches.max(LEAST_ROOM);
        Ok(Self {
            most,
            tracks: Vec::with_capacity(2 * most),
            assignment: Assignment::new(2 * most, 3 * most),
            taken: Vec::with_capacity(most),
            next_id: 1,
            before_s: None,
            frame: 0,
            is_whole: true,
            is_seen: true,
            touches: Vec::with_capacity(2 * most),
            settings,
        })
    }

    /// Takes the touches of a frame at `time_s` and returns those that are tracked, in ascending order of id.
    ///
    /// A touch that ends is returned once more. `is_whole` says whether every measurement of the frame was
    /// used.
    ///
    /// # Errors
    /// [`InverseError::TimeOrder`]; [`InverseError::TooManyTouches`] for more touches than both
    /// `max_touches` and 16. The tracker is then unchanged.
    pub fn push(
        &mut self,
        found: &[DetectedTouch],
        time_s: f64,
        is_whole: bool,
    ) -> Result<&[Touch], InverseError> {
        if found.len() > self.most {
            return Err(InverseError::TooManyTouches { found: found.len(), most: self.most });
        }
        self.advance(time_s)?;
        (self.is_whole, self.is_seen) = (is_whole, true);
        self.pair(found, time_s);
        self.end_and_begin(found, time_s);
        self.name(time_s);
        self.report(time_s);
        Ok(&self.touches)
    }

    /// Advances to a frame at `time_s` of which nothing is known, and returns the tracked touches:
    /// none of them is valid, and none ends until half a second has passed without information.
    ///
    /// # Errors
    ///
    /// [`InverseError::TimeOrder`]. The tracker is then unchanged.
    pub fn push_unseen(&mut self, time_s: f64) -> Result<&[Touch], InverseError> {
        self.advance(time_s)?;
        (self.is_whole, self.is_seen) = (false, false);
        for track in &mut self.tracks {
            track.ended = time_s - track.seen_s > HELD_S;
        }
        self.tracks.retain(|track| !track.ended || track.id.is_some());
        self.report(time_s);
        Ok(&self.touches)
    }

    /// Moves all tracks on to `time_s`.
    fn advance(&mut self, time_s: f64) -> Result<(), InverseError> {
        let before_s = self.before_s.unwrap_or(f64::NEG_INFINITY);
        if !(time_s.is_finite() && time_s > before_s) {
            return Err(InverseError::TimeOrder { frame: self.frame, time_s, before_s });
        }
        let dt = self.before_s.map_or(0.0, |before_s| time_s - before_s);
        self.before_s = Some(time_s);
        self.frame += 1;
        self.tracks.retain(|track| !track.ended);
        for track in &mut self.tracks {
            track.motion.predict(dt, self.settings.pace());
            track.frames += 1;
            track.matched = false;
        }
        Ok(())
    }

    /// Moves the reported touches of the last frame that are not learnt to the point of the skin
    /// that `nearest` gives, because the filter may leave the rim.
    pub fn place(&mut self, nearest: impl Fn([f64; 3]) -> [f64; 3]) {
        for touch in self.touches.iter_mut().filter(|touch| touch.learnt.is_none()) {
            touch.position_m = nearest(touch.position_m);
        }
    }

    /// Continues the ids of another tracker: the next new touch has this id, or 1 for 0.
    pub fn set_next_id(&mut self, id: u64) {
        self.next_id = id.max(1);
    }

    /// Returns the id that the next new touch will get.
    pub fn next_id(&self) -> u64 {
        self.next_id
    }

    /// Returns the touches of the last frame.
    pub fn touches(&self) -> &[Touch] {
        &self.touches
    }

    /// Marks touches of the last frame as not valid because their model is known to be wrong.
    pub fn invalidate(&mut self, is_doubted: impl Fn(&Touch) -> bool) {
        let doubted = self.touches.iter_mut().filter(|touch| is_doubted(touch));
        doubted.for_each(|touch| touch.valid = false);
    }

    /// Pairs tracks and touches with the least sum of squared distances; tracks with an id come first.
    fn pair(&mut self, found: &[DetectedTouch], time_s: f64) {
        let Self { tracks, assignment, settings, taken, .. } = self;
        let (rows, count, gate) = (tracks.len(), found.len(), settings.gate_m);
        taken.clear();
        taken.resize(count, false);
        let columns = assignment.solve(rows, count + rows, |row, column| match found.get(column) {
            None if column - count == row => {
                if tracks[row].id.is_some() {
                    2.0
                } else {
                    1.0
                }
            }
            None => NEVER,
            Some(touch) => {
                let way = distance_m(tracks[row].motion.state().position_m, touch.position_m)
                    .min(distance_m(tracks[row].seen.position_m, touch.position_m));
                if way <= gate { (way / gate).powi(2) } else { NEVER }
            }
        });
        for (track, &column) in tracks.iter_mut().zip(columns) {
            let Some(touch) = found.get(column) else { continue };
            taken[column] = true;
            track.motion.update(touch.position_m, &measured(touch, settings), touch.normal);
            (track.seen, track.matched, track.missed) = (*touch, true, 0);
            track.seen_s = time_s;
            track.last_m = track.motion.state().position_m;
            track.shown += 1;
        }
    }

    fn end_and_begin(&mut self, found: &[DetectedTouch], time_s: f64) {
        let forgiven = self.settings.forgiven_frames;
        for track in self.tracks.iter_mut().filter(|track| !track.matched) {
            track.missed += 1;
            track.ended = track.missed > forgiven;
        }
        self.tracks.retain(|track| !track.ended || track.id.is_some());
        let left = found.iter().zip(&self.taken).filter(|(_, taken)| !**taken);
        for (touch, _) in left {
            // the assignment has no room for more
            if self.tracks.len() == 2 * self.most {
                break;
            }
            let covariance = measured(touch, &self.settings);
            self.tracks.push(Track {
                id: None,
                motion: Motion::new(touch.position_m, covariance, self.settings.pace()),
                seen: *touch,
                last_m: touch.position_m,
                shown: 1,
                seen_s: time_s,
                missed: 0,
                frames: 0,
                begin: None,
                matched: true,
                ended: false,
            });
        }
    }

    /// Gives an id to new tracks that are strong or have been shown often enough.
    fn name(&mut self, time_s: f64) {
        let named = self.tracks.iter().filter(|track| track.id.is_some() && !track.ended).count();
        let mut free = self.settings.max_touches.saturating_sub(named);
        let matched = self.tracks.iter().filter(|track| track.matched);
        let strongest = matched.map(|t| t.seen.strength_s_m2.abs()).fold(0.0, f64::max);
        for track in self.tracks.iter_mut().filter(|track| track.id.is_none() && track.matched) {
            let DetectedTouch { strength_s_m2, strength_std_s_m2, worth, .. } = track.seen;
            let strength = strength_s_m2.abs();
            let is_worthy = worth >= self.settings.sure_worth;
            let least_s_m2 = if is_worthy { 0.0 } else { self.settings.strong_s_m2 };
            let least_s_m2 = least_s_m2.max(KNOWN * strength_std_s_m2);
            let is_strong = strength >= least_s_m2
                && strength_std_s_m2.is_finite()
                && (2.0 * strength >= strongest || worth >= self.settings.strong_worth);
            let is_sure = is_strong || track.shown >= self.settings.birth_frames;
            if is_sure && free > 0 {
                track.id = Some(self.next_id);
                track.begin = Some((track.frames, time_s));
                self.next_id += 1;
                free -= 1;
            }
        }
    }

    fn report(&mut self, time_s: f64) {
        self.touches.clear();
        for track in &self.tracks {
            let (Some(id), Some((born, begin_s))) = (track.id, track.begin) else { continue };
            let stage = match (track.ended, track.frames == born) {
                (true, _) => TouchState::End,
                (false, true) => TouchState::Begin,
                (false, false) => TouchState::Hold,
            };
            let state = track.motion.state();
            let mut covariance_m2 = match self.settings.errs_alike {
                true => track.seen.position_covariance_m2,
                false => state.pp,
            };
            // the method's error is the same in all frames of a rest
            let least_m2 = self.settings.method_std_m.powi(2);
            (0..3).for_each(|i| covariance_m2[i][i] = covariance_m2[i][i].max(least_m2));
            let spread = (0..3).map(|i| covariance_m2[i][i]).fold(0.0, f64::max);
            let known = track.seen.strength_s_m2.abs() / track.seen.strength_std_s_m2;
            self.touches.push(Touch {
                id,
                state: stage,
                position_m: if track.ended { track.last_m } else { state.position_m },
                normal: Some(track.seen.normal),
                position_covariance_m2: covariance_m2,
                velocity_m_s: state.velocity_m_s,
                intensity_s_m2: track.seen.strength_s_m2,
                intensity_std_s_m2: Some(track.seen.strength_std_s_m2),
                peak_s: track.seen.peak_s,
                learnt: track.seen.learnt,
                confidence: confidence(&track.seen, track.frames - born),
                age_frames: track.frames - born,
                age_s: time_s - begin_s,
                valid: self.is_seen
                    && track.missed == 0
                    && spread.sqrt() <= self.settings.max_position_std_m
                    && known >= ACTED_ON,
                whole: self.is_whole,
                split_from: None,
                merged_into: None,
            });
        }
        self.touches.sort_unstable_by_key(|touch| touch.id);
    }
}

/// Fraction of true touches among those of this evidence ratio, age and ratio of strength to its
/// standard deviation.
///
/// A logistic curve fitted to 25 531 touches reported on simulated fabrics (the paper's skin with
/// one to six fingers and with electrode faults, patches, a plate with a hole), of which 99.6 %
/// were within 25 mm of a finger. docs/validation/touches.md compares it with recordings that it
/// was not fitted to.
fn confidence(touch: &DetectedTouch, age_frames: u64) -> f64 {
    let worth = touch.worth.max(1.0);
    let known = (touch.strength_s_m2 / touch.strength_std_s_m2).abs().max(1.0);
    let logit = 0.5 + worth.ln() + 0.8 * known.ln() + 0.15 * age_frames.min(3) as f64;
    1.0 / (1.0 + (-logit).exp())
}

/// Covariance of a measured position: that of the fit and the method's own error.
fn measured(touch: &DetectedTouch, settings: &TrackerSettings) -> [[f64; 3]; 3] {
    let mut covariance = touch.position_covariance_m2;
    (0..3).for_each(|i| covariance[i][i] += settings.method_std_m.powi(2));
    covariance
}
