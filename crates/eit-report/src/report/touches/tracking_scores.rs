//! Fingers found, false touches and changed ids over a recording.

use super::simulated_disc::distance_m;
use eit_inverse::touch::{Touch, TouchState};

/// A finger weaker than this is on its way: neither to be found nor false, newton.
pub(super) const FULL_N: f64 = 0.7;
/// A touch farther than this from every finger is false, metres.
pub(super) const WITHIN_M: f64 = 0.025;

/// A finger of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct PresentFinger {
    pub finger: u32,
    /// Its true place, metres.
    pub position_m: [f64; 2],
    /// Whether it presses with [`FULL_N`].
    pub is_full: bool,
}

/// Scores of a recording.
#[derive(Debug, Clone, Default)]
pub(super) struct TrackingScores {
    /// Fingers that press in full, over all frames.
    pub fingers: usize,
    /// Those that have a touch.
    pub found: usize,
    /// Their distances from it, metres.
    pub errors_m: Vec<f64>,
    pub frames: usize,
    pub false_touches: usize,
    /// How often a finger's touch has another id than before.
    pub switches: usize,
    /// Id of the touch that each finger had last.
    ids: Vec<Option<u64>>,
}

/// A finger and a touch near it.
struct Pair {
    distance_m: f64,
    finger: usize,
    touch: usize,
}

/// The touch of a finger.
#[derive(Clone, Copy)]
struct Match {
    touch: usize,
    distance_m: f64,
}

impl TrackingScores {
    /// Follows the ids of so many fingers, numbered from 1.
    pub fn of_fingers(fingers: usize) -> Self {
        Self { ids: vec![None; fingers + 1], ..Default::default() }
    }

    /// Pairs touches and fingers, the nearest first, and counts.
    pub fn add(&mut self, present: &[PresentFinger], touches: &[Touch]) {
        let alive: Vec<&Touch> =
            touches.iter().filter(|t| t.state != TouchState::End && t.valid).collect();
        let mut finger_of = vec![None; alive.len()];
        let mut match_of = vec![None; present.len()];
        for Pair { distance_m, finger, touch } in pairs(present, &alive) {
            if finger_of[touch].is_none() && match_of[finger].is_none() {
                finger_of[touch] = Some(finger);
                match_of[finger] = Some(Match { touch, distance_m });
            }
        }
        self.frames += 1;
        // a finger on its way may be seen, a second touch on a finger is false
        self.false_touches += finger_of.iter().filter(|finger| finger.is_none()).count();
        for (slot, id) in self.ids.iter_mut().enumerate() {
            // lifted: its next touch has a new id
            if !present.iter().any(|present| present.finger as usize == slot) {
                *id = None;
            }
        }
        for (PresentFinger { finger, is_full, .. }, found) in present.iter().zip(match_of) {
            self.fingers += usize::from(*is_full);
            let Some(Match { touch, distance_m }) = found else { continue };
            if *is_full {
                self.found += 1;
                self.errors_m.push(distance_m);
            }
            if let Some(id) = self.ids.get_mut(*finger as usize) {
                self.switches += usize::from(id.is_some_and(|old| old != alive[touch].id));
                *id = Some(alive[touch].id);
            }
        }
    }
}

/// Fingers and touches near each other, the nearest first.
fn pairs(present: &[PresentFinger], touches: &[&Touch]) -> Vec<Pair> {
    let mut pairs: Vec<Pair> = Vec::new();
    for (finger, place) in present.iter().map(|present| present.position_m).enumerate() {
        for (touch, position_m) in touches.iter().map(|touch| touch.position_m).enumerate() {
            let distance_m = distance_m(position_m, place);
            if distance_m <= WITHIN_M {
                pairs.push(Pair { distance_m, finger, touch });
            }
        }
    }
    pairs.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    pairs
}
