//! How the model lies under the places of presses, if their table is in a robot's coordinates: turn, mirror and sign.

use super::process::gain;
use super::response_map::unit_rows;
use eit_core::vector::nearest;
use ndarray::{Array2, ArrayRef2, Axis};

/// Number of turns that are tried: 5.6 degrees apart, a tenth of the angle that a bell covers half way to the rim.
const TURNS: usize = 64;

/// Maps places of presses to places on the model's skin.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Orientation {
    /// Centre of turn and mirror, metres.
    pub middle_m: [f64; 3],
    /// Counter-clockwise turn, radians, after the mirror.
    pub turn_rad: f64,
    /// Whether y is reversed first.
    pub is_mirrored: bool,
    /// Sign of the response, 1 or -1, relative to the model's to a higher conductivity.
    pub sign: f64,
}

impl Orientation {
    /// That of places on the model's skin itself.
    pub fn of_model(sign: f64) -> Self {
        Self { middle_m: [0.0; 3], turn_rad: 0.0, is_mirrored: false, sign }
    }

    /// Maps a place to the model's skin, metres; z is unchanged.
    pub fn to_model(&self, place_m: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let [x, y] = [0, 1].map(|k| place_m[k] - self.middle_m[k]);
        let y = if self.is_mirrored { -y } else { y };
        let [a, b, _] = self.middle_m;
        [a + cos * x - sin * y, b + sin * x + cos * y, place_m[2]]
    }

    /// Finds the orientation under which a gain per channel predicts left-out presses best. `changes` are those of the
    /// presses, `[press, channel]`, `responses` those of the model at `places_m`, `[place, channel]`, both in one unit.
    ///
    /// The sign is tried alone if `is_turned` is false: places are then the model's.
    pub fn find(
        changes: &ArrayRef2<f64>,
        presses_m: &[[f64; 3]],
        places_m: &[[f64; 3]],
        responses: &ArrayRef2<f64>,
        middle_m: [f64; 3],
        is_turned: bool,
    ) -> Self {
        let (changes, responses) = (unit_rows(changes).0, unit_rows(responses).0);
        let (turns, mirrors): (usize, &[bool]) =
            if is_turned { (TURNS, &[false, true]) } else { (1, &[false]) };
        let tried = mirrors.iter().flat_map(|mirror| (0..turns).map(move |turn| (*mirror, turn)));
        let mut best = (f64::INFINITY, Self { middle_m, ..Self::of_model(1.0) });
        for (is_mirrored, turn) in tried {
            let turn_rad = turn as f64 * std::f64::consts::TAU / TURNS as f64;
            let turned = Self { middle_m, turn_rad, is_mirrored, sign: 1.0 };
            let at = |place: &[f64; 3]| {
                let at = nearest(places_m.iter().copied(), turned.to_model(*place));
                at.map_or(0, |(at, _)| at)
            };
            let at: Vec<usize> = presses_m.iter().map(at).collect();
            let model = responses.select(Axis(0), &at);
            for sign in [1.0, -1.0] {
                let rest = rest_of_left_out(&changes, &(&model * sign));
                if rest < best.0 {
                    best = (rest, Self { sign, ..turned });
                }
            }
        }
        best.1
    }
}

/// Squared length of what gains learnt from the other presses leave of each press, in closed form.
fn rest_of_left_out(changes: &Array2<f64>, model: &Array2<f64>) -> f64 {
    let products = (changes * model).sum_axis(Axis(0));
    let squares = (model * model).sum_axis(Axis(0));
    // a sign that only a negative gain explains is the other one
    let gains = gain(&products, &squares, 1.0, true);
    let ridge = squares.mean().unwrap_or(0.0);
    let rest = changes - &(model * &gains);
    let own = model * model / &(squares + ridge).insert_axis(Axis(0));
    (rest / (1.0 - own)).mapv(|v| v * v).sum()
}
