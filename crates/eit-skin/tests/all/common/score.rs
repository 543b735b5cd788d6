//! Comparison of touches with the truth, as a robot would experience them.

use super::Recording;
use super::script::{QUIET_FRAMES, RATE_HZ};
use eit_skin::eit_fem::fabric::TrueTouch;
use eit_skin::touches::{TouchRow, Touches};
use eit_skin::{Touch, TouchState};
use std::collections::HashMap;

/// A touch farther than this from every finger belongs to none, metres.
const GATE_M: f64 = 25e-3;

/// Lighter fingers need not be found, because they are about to lift, newton.
const LEAST_N: f64 = 0.3;

/// Time after a lift in which a touch does not count as a ghost, seconds.
const LATE_S: f64 = 0.2;

/// Bars that a script must meet.
pub struct Bars {
    pub found: f64,
    pub error_m: f64,
    pub extra: f64,
    pub id_changes: usize,
}

/// Those of the full scripts are tighter: here a press at the rim is 5 % of all frames, one found a frame late 0.003.
pub const ONE: Bars = Bars { found: 0.97, error_m: 6e-3, extra: 0.05, id_changes: 0 };

/// No bar but that for ghosts.
pub const ANY: Bars =
    Bars { found: 0.0, error_m: f64::INFINITY, extra: f64::INFINITY, id_changes: usize::MAX };

/// How well touches match the fingers, in one recording or several.
#[derive(Debug, Default)]
pub struct Score {
    /// Fingers in all frames, and position errors of those with a touch of their own within the gate, metres.
    fingers: usize,
    errors_m: Vec<f64>,
    /// Frames with a finger, and additional touches in them.
    touched: usize,
    extra: usize,
    /// Frames without a finger, more than 0.2 s after a lift, and those of them that show a touch.
    bare: usize,
    ghosts: usize,
    /// How often a finger's touch changes its id while it presses.
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

impl Score {
    pub fn of(recording: &Recording, touches: &Touches) -> Self {
        let mut score = Self::default();
        score.add(recording, touches);
        score
    }

    /// Fraction of the fingers in all frames that have a touch of their own.
    pub fn found(&self) -> f64 {
        self.errors_m.len() as f64 / self.fingers.max(1) as f64
    }

    /// Number of additional touches per frame with a finger.
    pub fn extra(&self) -> f64 {
        self.extra as f64 / self.touched.max(1) as f64
    }

    /// Fails below the bars (errors: of 95 %), and if a frame without a finger shows a touch or too few of those can tell.
    pub fn check(&self, name: &str, bars: &Bars) {
        let mut errors_m = self.errors_m.clone();
        errors_m.sort_by(f64::total_cmp);
        let error_m = errors_m[(0.95 * errors_m.len() as f64) as usize];
        let Self { ghosts, bare, id_changes, .. } = *self;
        let found = [self.found(), error_m, self.extra()];
        let told =
            format!("{name}: {found:?}, {ghosts} of {bare} ghosts, {id_changes} changes of id");
        println!("{told}");
        assert!(ghosts == 0 && bare >= 10, "{told}");
        assert!(found[0] >= bars.found && found[2] <= bars.extra, "{told}");
        assert!(error_m < bars.error_m && id_changes <= bars.id_changes, "{told}");
    }

    /// Counts the frames after the quiet ones.
    pub fn add(&mut self, recording: &Recording, touches: &Touches) {
        self.id_of.clear();
        let (mut since_lift, mut pressed) = (0, false);
        for frame in QUIET_FRAMES..recording.values.nrows() {
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
        let far = |f: &&TrueTouch| here.iter().map(|touch| off_m(touch, f.position_m)).collect();
        let far: Vec<Vec<f64>> = fingers.iter().map(far).collect();
        let pairs = assign(&far, &[]).1;
        self.touched += 1;
        self.extra += here.len() - pairs.iter().flatten().count();
        for (k, finger) in fingers.iter().enumerate().filter(|(_, f)| f.force_n >= LEAST_N) {
            self.fingers += 1;
            let Some(touch) = pairs[k] else { continue };
            self.errors_m.push(far[k][touch]);
            let before = self.id_of.insert(finger.finger, here[touch].id);
            self.id_changes += usize::from(before.is_some_and(|id| id != here[touch].id));
        }
        true
    }
}

/// The touch of each finger after those `chosen`, and the cost: most pairs within the gate, then least total distance.
fn assign(far: &[Vec<f64>], chosen: &[Option<usize>]) -> (f64, Vec<Option<usize>>) {
    let Some(row) = far.get(chosen.len()) else { return (0.0, chosen.to_vec()) };
    let near = (0..row.len()).filter(|t| row[*t] <= GATE_M && !chosen.contains(&Some(*t)));
    // a finger without a touch costs more than any distance
    let choices = near.map(|touch| (Some(touch), row[touch])).chain([(None, 1e3)]);
    let costs = choices.map(|(choice, cost)| {
        let (rest, pairs) = assign(far, &[chosen, &[choice]].concat());
        (cost + rest, pairs)
    });
    costs.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
}

pub fn median(values: &[f64]) -> f64 {
    eit_core::quantile(values, 0.5).unwrap()
}

pub fn off_m(touch: &Touch, [x, y]: [f64; 2]) -> f64 {
    (touch.position_m[0] - x).hypot(touch.position_m[1] - y)
}
