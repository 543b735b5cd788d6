//! What touches do to electrodes and their contacts.
//!
//! A press dents the fabric. Away from the dent the fabric moves towards it, by a distance that falls like one
//! over the distance from the touch (plane elasticity), and electrodes move with it. A finger that slides drags
//! the fabric along, by a distance that falls with the logarithm (Kelvin's solution; Love, *A Treatise on the
//! Mathematical Theory of Elasticity*, section 148). A dent beside an electrode presses on its contact.
//!
//! So the electrodes do not move independently of each other: each touch adds up to five unknowns (a pull, a drag
//! along each axis, of which a flat skin has two, a pressure on contacts), each of which acts on all electrodes.
//! What an electrode does on its own is much less. With that much freedom for each electrode by itself, a finger beyond the outer electrodes
//! looks as one that has moved; with little freedom and no pull, a finger beside an electrode looks as two.

use super::dents::Dents;
use super::places::{Places, Spot};
use super::slides::Slides;
use super::whitening::Whitening;
use crate::geometry::distance_m;

/// Kind of an unknown of a [`DetectorModel`](super::DetectorModel).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UnknownKind {
    /// Displacement of an electrode at a position, metres, along a unit vector.
    Displacement {
        /// Position of the electrode, metres.
        at_m: [f64; 3],
        /// Unit vector.
        along: [f64; 3],
    },
    /// Contact impedance of the electrode at a position, metres.
    Contact {
        /// Position of the electrode, metres.
        at_m: [f64; 3],
    },
    /// Anything that touches do not change.
    Other,
}

impl UnknownKind {
    /// Fraction of its standard deviation by which the unknown varies on its own.
    pub(super) fn share_alone(self) -> f64 {
        match self {
            Self::Displacement { .. } => 0.05,
            Self::Contact { .. } => 0.1,
            Self::Other => 1.0,
        }
    }

    /// Standard deviations of this unknown for one of a kind of action of a touch.
    fn share(self, action: usize, touch_m: [f64; 3]) -> f64 {
        match (self, action) {
            (Self::Displacement { at_m, along }, 0) => {
                let way: f64 = (0..3).map(|i| (touch_m[i] - at_m[i]) * along[i]).sum();
                let distance_m = distance_m(touch_m, at_m);
                PULL * way / distance_m.max(f64::MIN_POSITIVE) * (NEAR_M / distance_m).min(1.0)
            }
            (Self::Displacement { at_m, along }, 1..=3) => {
                let far = (FAR_M / distance_m(touch_m, at_m)).ln() / (FAR_M / NEAR_M).ln();
                DRAG * along[action - 1] * far.clamp(0.0, 1.0)
            }
            (Self::Contact { at_m }, PRESSURE) => {
                PRESS * (-distance_m(touch_m, at_m) / PRESS_M).exp()
            }
            _ => 0.0,
        }
    }
}

/// Standard deviation of the pull on electrodes in addition to that of a dent, up to [`NEAR_M`]
/// away, relative to their displacement, ...
const PULL: f64 = 0.5;
/// ... and of the drag.
const DRAG: f64 = 0.5;
/// Standard deviation of the pressure on a contact under a touch, relative to that of the contact,
/// ...
const PRESS: f64 = 3.0;
/// ... and the distance over which it falls by a factor of e, metres.
const PRESS_M: f64 = 25e-3;
/// Distance up to which pull and drag do not fall, metres.
const NEAR_M: f64 = 30e-3;
/// Distance from which there is no drag, metres.
const FAR_M: f64 = 100e-3;

/// Kinds of actions: a pull, a drag along each axis, a pressure on contacts.
const ACTIONS: usize = 5;

/// The pressure among them.
const PRESSURE: usize = 4;

/// Touches closer than this share their actions, metres.
const SAME_M: f64 = 7e-3;

/// Actions of touches on electrodes.
#[derive(Debug, Clone)]
pub(super) struct Electrodes {
    kinds: Vec<UnknownKind>,
    /// Positions of the acting touches, and the nearest candidate positions.
    at_m: Vec<[f64; 3]>,
    places: Vec<usize>,
    /// Whether each touch drags the fabric along.
    dragged: Vec<bool>,
    /// Whitened effects of the touches on the fabric around them, `[effect][row]`.
    pub(super) dented: Vec<f64>,
    /// Standard deviations of each unknown for one of each action: `[action][unknown]`.
    pub(super) actions: Vec<f64>,
    /// The same, followed by each unknown by itself.
    all: Vec<f64>,
}

impl Electrodes {
    /// Sets the unknowns on which touches act.
    pub(super) fn new(kinds: Vec<UnknownKind>, most_touches: usize) -> Self {
        // touches of the previous frame, and twice as many of this one
        let most = 3 * most_touches;
        Self {
            actions: Vec::with_capacity((most * ACTIONS + 1) * kinds.len()),
            all: Vec::with_capacity((most * ACTIONS + kinds.len()) * kinds.len()),
            at_m: Vec::with_capacity(most),
            places: Vec::with_capacity(most),
            dragged: Vec::with_capacity(most),
            dented: Vec::new(),
            kinds,
        }
    }

    /// Forgets all touches.
    pub(super) fn clear(&mut self) {
        self.at_m.clear();
        self.places.clear();
        self.dragged.clear();
        self.actions.clear();
        self.dented.clear();
    }

    /// Adds pressure on contacts alone.
    pub(super) fn press(&mut self, touch_m: [f64; 3]) {
        self.actions.extend(self.kinds.iter().map(|kind| kind.share(PRESSURE, touch_m)));
    }

    /// Returns the whitened columns of the actions of a touch at a candidate position: pressure on
    /// contacts, pull and drags, then the dent: `[action][row]`, as if no row were lost.
    pub(super) fn columns_of(
        &self,
        place: usize,
        places: &Places,
        dents: &Dents,
        whitening: &Whitening,
        out: &mut Vec<f64>,
    ) {
        let touch_m = places.at[place].position_m;
        for action in [PRESSURE, 0, 1, 2, 3] {
            let from = out.len();
            out.resize(from + whitening.rows(), 0.0);
            for (kind, column) in self.kinds.iter().zip(whitening.local_of_all()) {
                let share = kind.share(action, touch_m);
                out[from..].iter_mut().zip(column).for_each(|(o, c)| *o += share * c);
            }
        }
        out.extend_from_slice(dents.of(place));
    }

    /// Starts a frame with the touches of the previous one. A touch that has hardly moved acts from where it did
    /// before, which changes nothing.
    pub(super) fn start(&mut self, before: &Slides, places: &Places, dents: &Dents) {
        let near = |at_m: [f64; 3], spot: &Spot| distance_m(spot.position_m, at_m) < SAME_M;
        let is_as_before = |k: usize| {
            let at_m = self.at_m[k];
            before.spots.iter().any(|spot| near(at_m, spot))
                && self.dragged[k] == before.has_slid(at_m)
        };
        if !(0..self.at_m.len()).all(is_as_before) {
            self.at_m.retain(|at_m| before.spots.iter().any(|spot| near(*at_m, spot)));
            let at_m = &self.at_m;
            self.places.retain(|place| at_m.contains(&places.at[*place].position_m));
            self.dragged.clear();
            self.dragged.extend(at_m.iter().map(|at_m| before.has_slid(*at_m)));
            self.actions.clear();
            self.dented.clear();
            (0..self.at_m.len()).for_each(|k| self.act(k, dents));
        }
        self.add(&before.spots, before, places, dents);
    }

    /// Adds touches, each at the nearest of the candidate positions; `before`: those of the previous frame.
    pub(super) fn add(&mut self, spots: &[Spot], before: &Slides, places: &Places, dents: &Dents) {
        for spot in spots {
            let is_there = self.at_m.iter().any(|at_m| distance_m(*at_m, spot.position_m) < SAME_M);
            if !is_there && self.at_m.len() < self.at_m.capacity() {
                self.at_m.push(places.at[spot.place].position_m);
                self.places.push(spot.place);
                self.dragged.push(before.has_slid(spot.position_m));
                self.act(self.at_m.len() - 1, dents);
            }
        }
    }

    /// Returns the actions, and each unknown by itself with the additional variance that restores
    /// its full standard deviation.
    pub(super) fn with_each_alone(&mut self) -> [&[f64]; 2] {
        self.all.clone_from(&self.actions);
        for (k, kind) in self.kinds.iter().enumerate() {
            let more = (1.0 - kind.share_alone().powi(2)).max(0.0).sqrt();
            self.all.extend((0..self.kinds.len()).map(|i| if i == k { more } else { 0.0 }));
        }
        [&self.all, &self.dented]
    }

    /// Adds the actions of a touch that have an effect.
    fn act(&mut self, k: usize, dents: &Dents) {
        let (touch_m, place) = (self.at_m[k], self.places[k]);
        self.dented.extend_from_slice(dents.of(place));
        if self.dragged[k] {
            self.dented.extend_from_slice(dents.drags_of(place));
        }
        for action in 0..ACTIONS {
            let from = self.actions.len();
            self.actions.extend(self.kinds.iter().map(|kind| kind.share(action, touch_m)));
            if self.actions[from..].iter().all(|share| *share == 0.0) {
                self.actions.truncate(from);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT_M: [f64; 3] = [0.1, 0.0, 0.0];

    fn share(along: [f64; 3], action: usize, touch_m: [f64; 3]) -> f64 {
        UnknownKind::Displacement { at_m: AT_M, along }.share(action, touch_m)
    }

    /// An electrode is pulled towards the touch, half as far at twice the distance; not across.
    #[test]
    fn a_touch_pulls_electrodes_towards_itself() {
        let (inward, across) = ([-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let [near, far] = [0.06, 0.02].map(|x| share(inward, 0, [x, 0.0, 0.0]));
        assert!(near > 0.0 && (near / far - 2.0).abs() < 1e-12, "{near} {far}");
        assert_eq!(share(across, 0, [0.06, 0.0, 0.0]), 0.0);
        // no direction under the finger, and no division by zero
        assert_eq!(share(inward, 0, AT_M), 0.0);
    }

    /// A drag acts along its axis alone and ends at a distance; contacts feel touches nearby.
    #[test]
    fn drags_and_pressures_are_local() {
        let along = [0.0, 1.0, 0.0];
        assert_eq!(share(along, 1, [0.09, 0.0, 0.0]), 0.0);
        assert_eq!(share(along, 2, [0.09, 0.0, 0.0]), DRAG);
        assert_eq!(share(along, 2, [-0.01, 0.0, 0.0]), 0.0);
        let contact = UnknownKind::Contact { at_m: AT_M };
        assert_eq!(contact.share(4, AT_M), PRESS);
        assert!(contact.share(4, [0.0; 3]) < 0.02 * PRESS);
        assert_eq!(contact.share(0, [0.0; 3]), 0.0);
    }
}
