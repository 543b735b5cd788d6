//! How strong touches were of late: what they leave behind is a small part of them.

use super::places::{Places, Spot};
use super::settings::DetectorSettings;
use crate::geometry::distance_m;

/// Largest factor by which the strongest touch counts as stronger than the next one. In a poorly
/// sensed corner strengths are arbitrary, up to twenty times too large, and touches of the next
/// seconds counted as remains of such a touch.
const BELIEVED: f64 = 4.0;

/// Time constant with which recent strengths near a position fade while something touches the skin,
/// seconds: what the memory explains then does not enter the reference, and fabric settles in some
/// 10 s. With 5 s, one of 45 recordings of slides shows a trail as a touch after the next two
/// slides.
const KEPT_HERE_S: f64 = 20.0;

/// Distance within which hysteresis left by a touch can show, metres.
const LATE_M: f64 = 20e-3;

/// Strength of the strongest touch of a frame, limited relative to the others.
fn strongest_believed(strengths: &[f64]) -> f64 {
    let [first, second] =
        strengths.iter().fold([0.0_f64; 2], |[first, second], &s| match s > first {
            true => [s, first],
            false => [first, second.max(s)],
        });
    if second > 0.0 { first.min(BELIEVED * second) } else { first }
}

/// Strongest recent touches, fading.
#[derive(Debug, Clone)]
pub(super) struct Late {
    /// Anywhere, S m^2.
    pub(super) strongest_s_m2: f64,
    /// Near each position, S m^2.
    pub(super) here_s_m2: Vec<f64>,
    /// Whether the previous frame had touches, all so faint that they may be what stronger ones left behind.
    pub(super) was_faint: bool,
}

impl Late {
    pub(super) fn new(places: &Places) -> Self {
        Self { strongest_s_m2: 0.0, here_s_m2: vec![0.0; places.len()], was_faint: false }
    }

    /// Records the touches of a frame, which was recorded `dt_s` seconds after the previous one.
    pub(super) fn take(
        &mut self,
        spots: &[Spot],
        strengths: &[f64],
        places: &Places,
        settings: &DetectorSettings,
        dt_s: f64,
    ) {
        // what a touch leaves behind enters the reference, but hardly while something touches the skin
        let late_s = settings.late_s;
        let here_s = if spots.is_empty() { late_s } else { late_s.max(KEPT_HERE_S) };
        let strongest = strongest_believed(strengths);
        self.strongest_s_m2 = strongest.max(self.strongest_s_m2 * (-dt_s / late_s).exp());
        let faint = settings.least_share_of_here * self.strongest_s_m2;
        self.was_faint = !strengths.is_empty() && strengths.iter().all(|s| *s < faint);
        let fading = (-dt_s / here_s).exp();
        self.here_s_m2.iter_mut().for_each(|late| *late *= fading);
        for (spot, strength) in spots.iter().zip(strengths) {
            for (late, place) in self.here_s_m2.iter_mut().zip(&places.at) {
                if distance_m(place.position_m, spot.position_m) < LATE_M {
                    *late = late.max(*strength);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A single touch counts in full, and one that is far stronger than all others only in part.
    #[test]
    fn the_strength_of_an_outlier_is_not_believed() {
        for (strengths, wanted) in [
            (&[][..], 0.0),
            (&[7.0], 7.0),
            (&[1.0, 3.0, 2.0], 3.0),
            (&[20.0, 1.0, 1.5], 6.0),
            (&[0.5, 20.0], 2.0),
            (&[20.0, 0.0], 20.0),
        ] {
            assert_eq!(strongest_believed(strengths), wanted, "{strengths:?}");
        }
    }
}
