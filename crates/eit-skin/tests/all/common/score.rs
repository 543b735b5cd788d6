//! Comparison of touches with the truth, as a robot would experience them.

use super::Recording;
use super::script::{RATE_HZ, distance_m};
use eit_skin::touches::{TouchRow, Touches};
use eit_skin::{Touch, TouchState};
use std::collections::HashMap;

/// A touch farther than this from every finger belongs to none, metres.
const GATE_M: f64 = 25e-3;

/// Lighter fingers need not be found, because they are about to lift, newton.
const LEAST_N: f64 = 0.3;

/// Time after a lift in which a touch does not count as a ghost, seconds.
const LATE_S: f64 = 0.2;

/// How well touches match the fingers.
#[derive(Debug, Clone, Copy)]
pub struct Score {
    /// Fraction of the fingers in all frames that have a touch of their own within the gate.
    pub found: f64,
    /// Position error that 95 % of those do not exceed, metres.
    pub error_m: f64,
    /// Number of additional touches per frame with a finger.
    pub extra: f64,
    /// Frames without a finger, more than 0.2 s after a lift, that show a touch, ...
    pub ghosts: usize,
    /// ... out of this number.
    pub bare: usize,
    /// How often a finger's touch changes its id while it presses.
    pub id_changes: usize,
}

impl Score {
    /// Fails if a frame without a finger shows a touch, or if there are too few of those to tell.
    pub fn check_ghosts(&self) {
        assert!(self.ghosts == 0 && self.bare >= 10, "{self:?}");
    }
}

/// Counts from which scores are computed, of one recording or several.
#[derive(Default)]
pub struct Counts {
    hit: usize,
    fingers: usize,
    errors_m: Vec<f64>,
    extra: usize,
    touched: usize,
    ghosts: usize,
    bare: usize,
    id_changes: usize,
    /// Id of the last touch of each pressing finger.
    id_of: HashMap<u32, u64>,
}

/// Touches that a robot acts on: valid, and not ending.
pub fn acted_on(touches: &Touches, frame: usize) -> Vec<Touch> {
    let counts = |row: &&TouchRow| {
        row.frame == frame && row.touch.valid && row.touch.state != TouchState::End
    };
    touches.rows.iter().filter(counts).map(|row| row.touch).collect()
}

impl Counts {
    /// Of one recording, from frame `first` on.
    pub fn of(recording: &Recording, touches: &Touches, first: usize) -> Self {
        let mut counts = Self::default();
        counts.add(recording, touches, first);
        counts
    }

    /// Counts the frames from `first` on.
    pub fn add(&mut self, recording: &Recording, touches: &Touches, first: usize) {
        self.id_of.clear();
        let (mut since_lift, mut pressed) = (0, false);
        for frame in first..recording.values.nrows() {
            let here = acted_on(touches, frame);
            if self.add_fingers(recording, frame, &here) {
                (since_lift, pressed) = (0, true);
                continue;
            }
            since_lift += 1;
            if !pressed || since_lift as f64 > LATE_S * RATE_HZ {
                self.bare += 1;
                self.ghosts += usize::from(!here.is_empty());
            }
        }
    }

    /// Counts a frame's fingers and their touches; returns whether there are fingers.
    fn add_fingers(&mut self, recording: &Recording, frame: usize, here: &[Touch]) -> bool {
        let fingers: Vec<_> = recording.truth.iter().filter(|t| t.frame == frame).collect();
        self.id_of.retain(|id, _| fingers.iter().any(|finger| finger.finger == *id));
        if fingers.is_empty() {
            return false;
        }
        let far = |finger: usize, touch: usize| {
            let [x, y, _] = here[touch].position_m;
            distance_m(fingers[finger].position_m, [x, y])
        };
        let pairs = assign(fingers.len(), here.len(), &far);
        self.touched += 1;
        self.extra += here.len() - pairs.iter().flatten().count();
        for (k, finger) in fingers.iter().enumerate().filter(|(_, f)| f.force_n >= LEAST_N) {
            self.fingers += 1;
            let Some(touch) = pairs[k] else { continue };
            self.hit += 1;
            self.errors_m.push(far(k, touch));
            let before = self.id_of.insert(finger.finger, here[touch].id);
            self.id_changes += usize::from(before.is_some_and(|id| id != here[touch].id));
        }
        true
    }

    /// The score of all that was counted.
    pub fn score(&self) -> Score {
        let mut errors_m = self.errors_m.clone();
        errors_m.sort_by(f64::total_cmp);
        let rank = (0.95 * errors_m.len() as f64) as usize;
        Score {
            found: self.hit as f64 / self.fingers.max(1) as f64,
            error_m: errors_m.get(rank).copied().unwrap_or(f64::NAN),
            extra: self.extra as f64 / self.touched.max(1) as f64,
            ghosts: self.ghosts,
            bare: self.bare,
            id_changes: self.id_changes,
        }
    }
}

/// The touch of each finger: as many pairs within the gate as possible, with the least total distance. Tries
/// every assignment, for at most four fingers.
fn assign(fingers: usize, touches: usize, far: &dyn Fn(usize, usize) -> f64) -> Vec<Option<usize>> {
    fn try_all(
        chosen: &mut Vec<Option<usize>>,
        fingers: usize,
        touches: usize,
        far: &dyn Fn(usize, usize) -> f64,
    ) -> (f64, Vec<Option<usize>>) {
        let finger = chosen.len();
        if finger == fingers {
            return (0.0, chosen.clone());
        }
        let mut best = (f64::INFINITY, Vec::new());
        let free: Vec<usize> = (0..touches).filter(|t| !chosen.contains(&Some(*t))).collect();
        let near = free.into_iter().filter(|t| far(finger, *t) <= GATE_M).map(Some);
        for choice in near.chain([None]) {
            chosen.push(choice);
            let (cost, pairs) = try_all(chosen, fingers, touches, far);
            chosen.pop();
            // a finger without a touch costs more than any distance
            let cost = cost + choice.map_or(1e3, |touch| far(finger, touch));
            if cost < best.0 {
                best = (cost, pairs);
            }
        }
        best
    }
    try_all(&mut Vec::new(), fingers, touches, far).1
}

/// A quantile of values.
pub fn quantile_of(values: &[f64], part: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[(part * (sorted.len() - 1) as f64).round() as usize]
}
