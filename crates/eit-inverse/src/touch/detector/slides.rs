//! How far each touch has slid of late.

use super::places::Spot;
use crate::geometry::distance_m;

/// Time constant of the place from which a slide is measured, seconds.
const BEGAN_S: f64 = 0.5;

/// Way from which a touch counts as sliding, metres. At 20 frames a second a resting touch hardly moves by more when
/// another finger lands beside it; one of 15 mm/s has slid by 7 mm.
const SLIDES_M: f64 = 5e-3;

/// A touch within this distance of a touch of the previous frame is the same one, metres.
const SAME_M: f64 = 15e-3;

/// The touches of the previous frame, and where each of them was half a second ago.
#[derive(Debug, Clone)]
pub(super) struct Slides {
    pub(super) spots: Vec<Spot>,
    /// Mean places, with exponentially falling weights of the past.
    began_m: Vec<[f64; 3]>,
    next_m: Vec<[f64; 3]>,
}

impl Slides {
    pub(super) fn new(most_touches: usize) -> Self {
        Self {
            spots: Vec::with_capacity(most_touches),
            began_m: Vec::with_capacity(most_touches),
            next_m: Vec::with_capacity(most_touches),
        }
    }

    /// Takes the touches of a frame recorded `dt_s` seconds after the previous one.
    pub(super) fn take(&mut self, spots: &[Spot], dt_s: f64) {
        let weight = -(-dt_s / BEGAN_S).exp_m1();
        self.next_m.clear();
        for spot in spots {
            let way =
                |(k, before): (usize, &Spot)| (k, distance_m(before.position_m, spot.position_m));
            let ways = self.spots.iter().enumerate().map(way);
            let mut began_m = match ways.min_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((k, way_m)) if way_m < SAME_M => self.began_m[k],
                _ => spot.position_m,
            };
            for (began, now) in began_m.iter_mut().zip(spot.position_m) {
                *began += weight * (now - *began);
            }
            self.next_m.push(began_m);
        }
        std::mem::swap(&mut self.began_m, &mut self.next_m);
        self.spots.clear();
        self.spots.extend_from_slice(spots);
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
        Spot { place: 0, step_m: [0.0; 2], position_m: [x, 0.0, 0.0] }
    }

    /// A touch of 15 mm/s slides after half a second and no longer does half a second after it stopped; one that
    /// trembles by a millimetre never does, nor one that appears elsewhere.
    #[test]
    fn a_slide_is_told_from_a_tremble() {
        let mut slides = Slides::new(2);
        let count = |slides: &Slides| slides.sliding().count();
        for k in 0..20 {
            let tremble = 0.1 + 1e-3 * f64::from(k % 3 - 1);
            slides.take(&[at(tremble), at(15e-3 * DT_S * f64::from(k))], DT_S);
            assert!(k > 5 || count(&slides) == 0, "frame {k}");
        }
        assert_eq!(count(&slides), 1);
        assert_eq!(slides.sliding().next(), Some(&at(15e-3 * DT_S * 19.0)));
        (0..10).for_each(|_| slides.take(&[at(0.1), at(15e-3 * DT_S * 19.0)], DT_S));
        assert_eq!(count(&slides), 0);
        slides.take(&[at(0.2)], DT_S);
        assert_eq!(count(&slides), 0);
    }
}
