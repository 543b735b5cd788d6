//! How far each touch has slid of late, which ones have slid at all, and which ones began alone.

use super::places::Spot;
use crate::geometry::distance_m;

/// Time constant of the reference point from which a slide is measured, seconds.
const BEGAN_S: f64 = 0.5;

/// Distance from that point above which a touch counts as sliding, metres. At 20 frames a second a
/// resting touch hardly moves farther when another finger lands beside it; at 15 mm/s it has moved
/// by 7 mm.
const SLIDES_M: f64 = 5e-3;

/// Recent path above which a touch drags the fabric along until it ends, metres: a finger that
/// slides at 10 mm/s reaches it after half a second. The fabric stays dragged until the finger
/// lifts.
const DRAGS_M: f64 = 3e-3;
/// ... unless its position is too uncertain: the same in units of the position error. Without it,
/// trembling touches beyond corner snaps may drag, and one of three such recordings shows a touch
/// in 16 untouched frames.
const DRAGS_ERRORS: f64 = 3.0;

/// Touches of successive frames within this distance are the same one, metres.
pub(super) const SAME_M: f64 = 15e-3;

/// Distance within which no other touch may be for a new touch to count as a separate finger,
/// metres.
const ALONE_M: f64 = 35e-3;

/// The touches of the previous frame, and their positions half a second ago.
#[derive(Debug, Clone)]
pub(super) struct Slides {
    pub(super) spots: Vec<Spot>,
    /// Mean positions, with exponentially decaying weights.
    began_m: Vec<[f64; 3]>,
    /// Whether no other touch was near when it began.
    began_alone: Vec<bool>,
    /// Whether it has slid since it began.
    dragged: Vec<bool>,
    next_m: Vec<[f64; 3]>,
    next_alone: Vec<bool>,
    next_dragged: Vec<bool>,
}

impl Slides {
    pub(super) fn new(most_touches: usize) -> Self {
        Self {
            spots: Vec::with_capacity(most_touches),
            began_m: Vec::with_capacity(most_touches),
            began_alone: Vec::with_capacity(most_touches),
            dragged: Vec::with_capacity(most_touches),
            next_m: Vec::with_capacity(most_touches),
            next_alone: Vec::with_capacity(most_touches),
            next_dragged: Vec::with_capacity(most_touches),
        }
    }

    /// Records the touches of a frame recorded `dt_s` seconds after the previous one, and their
    /// root mean square position errors.
    pub(super) fn take(&mut self, spots: &[Spot], errors_m: &[f64], dt_s: f64) {
        let weight = -(-dt_s / BEGAN_S).exp_m1();
        self.next_m.clear();
        self.next_alone.clear();
        self.next_dragged.clear();
        for (own, spot) in spots.iter().enumerate() {
            let way =
                |(k, before): (usize, &Spot)| (k, distance_m(before.position_m, spot.position_m));
            let ways = self.spots.iter().enumerate().map(way);
            let others = || spots.iter().enumerate().filter(|(k, _)| *k != own);
            let is_far = |(_, other): (usize, &Spot)| {
                distance_m(other.position_m, spot.position_m) >= ALONE_M
            };
            let (mut began_m, alone, dragged) = match ways.min_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((k, way_m)) if way_m < SAME_M => {
                    (self.began_m[k], self.began_alone[k], self.dragged[k])
                }
                _ => (spot.position_m, others().all(is_far), false),
            };
            for (began, now) in began_m.iter_mut().zip(spot.position_m) {
                *began += weight * (now - *began);
            }
            self.next_m.push(began_m);
            self.next_alone.push(alone);
            let error_m = errors_m.get(own).copied().unwrap_or(0.0);
            let way_m = distance_m(began_m, spot.position_m);
            self.next_dragged.push(dragged || way_m >= DRAGS_M.max(DRAGS_ERRORS * error_m));
        }
        std::mem::swap(&mut self.began_m, &mut self.next_m);
        std::mem::swap(&mut self.began_alone, &mut self.next_alone);
        std::mem::swap(&mut self.dragged, &mut self.next_dragged);
        self.spots.clear();
        self.spots.extend(spots.iter().map(|spot| Spot { spread_m2: None, ..*spot }));
    }

    /// Whether this may continue a touch of the previous frame that began separately.
    pub(super) fn began_alone(&self, at_m: [f64; 3]) -> bool {
        self.before(at_m).is_some_and(|k| self.began_alone[k])
    }

    /// Whether this may continue a touch of the previous frame that has slid.
    pub(super) fn has_slid(&self, at_m: [f64; 3]) -> bool {
        self.before(at_m).is_some_and(|k| self.dragged[k])
    }

    /// The touch of the previous frame that may continue here.
    fn before(&self, at_m: [f64; 3]) -> Option<usize> {
        let ways = self.spots.iter().map(|spot| distance_m(spot.position_m, at_m)).enumerate();
        let near = ways.filter(|(_, way_m)| *way_m < SAME_M);
        near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
    }

    /// Touches of the previous frame that began separately.
    pub(super) fn alone(&self) -> impl Iterator<Item = &Spot> {
        let spots = self.spots.iter().zip(&self.began_alone);
        spots.filter(|(_, alone)| **alone).map(|(spot, _)| spot)
    }

    /// Touches of the previous frame that were sliding.
    pub(super) fn sliding(&self) -> impl Iterator<Item = &Spot> {
        let spots = self.spots.iter().zip(&self.began_m);
        let slid =
            spots.filter(|(spot, began_m)| distance_m(spot.position_m, **began_m) >= SLIDES_M);
        slid.map(|(spot, _)| spot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.05;

    fn at(x: f64) -> Spot {
        Spot { place: 0, step_m: [0.0; 2], position_m: [x, 0.0, 0.0], spread_m2: None }
    }

    /// A touch at 15 mm/s counts as sliding after half a second, and no longer half a second after
    /// it stopped; one that trembles by a millimetre never does, nor one that appears elsewhere.
    #[test]
    fn a_slide_is_told_from_a_tremble() {
        let mut slides = Slides::new(2);
        let count = |slides: &Slides| slides.sliding().count();
        for k in 0..20 {
            let tremble = 0.1 + 1e-3 * f64::from(k % 3 - 1);
            slides.take(&[at(tremble), at(15e-3 * DT_S * f64::from(k))], &[], DT_S);
            assert!(k > 5 || count(&slides) == 0, "frame {k}");
        }
        assert_eq!(count(&slides), 1);
        let has_slid = |slides: &Slides, x: f64| slides.has_slid([x, 0.0, 0.0]);
        assert!(has_slid(&slides, 0.014) && !has_slid(&slides, 0.1) && !has_slid(&slides, 0.05));
        assert_eq!(slides.sliding().next(), Some(&at(15e-3 * DT_S * 19.0)));
        (0..10).for_each(|_| slides.take(&[at(0.1), at(15e-3 * DT_S * 19.0)], &[], DT_S));
        assert_eq!(count(&slides), 0);
        assert!(has_slid(&slides, 0.014) && !has_slid(&slides, 0.1));
        slides.take(&[at(0.2)], &[], DT_S);
        assert_eq!(count(&slides), 0);
        assert!(!has_slid(&slides, 0.2));
    }

    /// A touch that began separately stays so beside another one; one that began beside it does
    /// not.
    #[test]
    fn who_began_alone() {
        let mut slides = Slides::new(3);
        slides.take(&[at(0.0)], &[], DT_S);
        slides.take(&[at(0.0), at(0.03)], &[], DT_S);
        assert!(slides.began_alone([0.0; 3]) && !slides.began_alone([0.03, 0.0, 0.0]));
        slides.take(&[at(0.0), at(0.03), at(0.07)], &[], DT_S);
        for x in [0.062, 0.054, 0.046] {
            slides.take(&[at(0.0), at(0.03), at(x)], &[], DT_S);
        }
        let alone = [0.0, 0.03, 0.046].map(|x| slides.began_alone([x, 0.0, 0.0]));
        assert_eq!(alone, [true, false, true]);
        assert!(!slides.began_alone([0.1, 0.0, 0.0]));
    }
}
