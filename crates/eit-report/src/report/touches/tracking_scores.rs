//! Counts fingers found, false touches and changes of id over a recording.

use super::simulated_disc::distance_m;
use eit_inverse::touch::{Touch, TouchState};

/// A finger with less force is arriving or leaving: it need not be found, but its touch is not
/// false, newtons.
pub(super) const FULL_N: f64 = 0.7;
/// A touch farther than this from every finger is false, metres.
pub(super) const WITHIN_M: f64 = 0.025;

/// A finger in a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct PresentFinger {
    pub finger: u32,
    /// True position, metres.
    pub position_m: [f64; 2],
    /// Whether its force is at least [`FULL_N`].
    pub is_full: bool,
}

/// Scores of a recording.
#[derive(Debug, Clone, Default)]
pub(super) struct TrackingScores {
    /// Number of fingers pressing with full force, over all frames.
    pub fingers: usize,
    /// Number of those that have a touch.
    pub found: usize,
    /// Distances of their touches, metres.
    pub errors_m: Vec<f64>,
    pub frames: usize,
    pub false_touches: usize,
    /// Number of times that a finger's touch has a different id than before.
    pub switches: usize,
    /// Id of the last touch of each finger.
    ids: Vec<Option<u64>>,
}

/// A finger and a nearby touch.
struct Pair {
    distance_m: f64,
    finger: usize,
    touch: usize,
}

/// The touch matched to a finger.
#[derive(Clone, Copy)]
struct Match {
    touch: usize,
    distance_m: f64,
}

impl TrackingScores {
    /// Creates scores for the given number of fingers, numbered from 1.
    pub fn of_fingers(fingers: usize) -> Self {
        Self { ids: vec![None; fingers + 1], ..Default::default() }
    }

    /// Pairs touches with fingers, nearest first, and counts the results.
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
        // a touch of an arriving or leaving finger is not false; a second touch on a finger is
        self.false_touches += finger_of.iter().filter(|finger| finger.is_none()).count();
        for (slot, id) in self.ids.iter_mut().enumerate() {
            // after a finger was lifted, its next touch has a new id
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

/// Returns nearby pairs of fingers and touches, nearest first.
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
