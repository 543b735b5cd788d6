//! The model's response to a touch at each place, as prior of what is learnt, and the size of the skin.

use super::LearnedSkin;
use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use eit_core::vector::{distance, nearest};
use eit_inverse::learn::{ModelResponses, Orientation, bell_responses, candidates};
use ndarray::Array2;

/// Approximate number of places for which responses are learnt.
const PLACES: usize = 2000;
/// Ratios of measured to modelled voltage beyond this factor of the median are attributed to noise.
const RATIO_RANGE: f64 = 20.0;
/// Distance beyond the outermost press up to which touches are sought, as a fraction of the skin's radius.
const BEYOND: f64 = 0.1;

/// Ratios of measured to modelled voltage per channel, with sign: values of an instrument that measures
/// magnitudes change with the sign of the model's voltage.
pub(super) fn ratios(skin: &LinearisedSkin, channels: &[usize], levels: &[f64]) -> Vec<f64> {
    let ratios: Vec<f64> =
        channels.iter().zip(levels).map(|(&i, level)| level / skin.voltages[i]).collect();
    let sizes = ratios.iter().map(|ratio| ratio.abs()).filter(|r| r.is_finite());
    let median = eit_core::median(sizes).filter(|m| *m > 0.0).unwrap_or(1.0);
    let within = |r: f64| match r.is_finite() {
        true => r.signum() * r.abs().clamp(median / RATIO_RANGE, median * RATIO_RANGE),
        false => median,
    };
    ratios.into_iter().map(within).collect()
}

/// The model's responses to 1 S m^2 at given places, times a factor for each channel, `[place, channel]`.
pub(super) fn responses(
    skin: &LinearisedSkin,
    channels: &[usize],
    factors: &[f64],
    places_m: &[[f64; 3]],
    bell_m: f64,
) -> Result<Array2<f64>, SkinError> {
    let surface = skin.skin.mesh.surface();
    let jacobian = skin.jacobian.select(ndarray::Axis(0), channels);
    let all = bell_responses(surface, &jacobian, places_m, bell_m)?;
    Ok(all * ndarray::ArrayView1::from(factors))
}

/// All places of a skin.
pub(super) fn places(skin: &LinearisedSkin) -> Vec<[f64; 3]> {
    candidates(skin.skin.mesh.surface(), PLACES)
}

pub(super) fn middle_m(skin: &LinearisedSkin) -> [f64; 3] {
    let [low, high] = skin.skin.mesh.surface().bounds_m();
    std::array::from_fn(|k| 0.5 * (low[k] + high[k]))
}

/// Half of the longest side of the bounding box.
pub(super) fn radius_m(skin: &LinearisedSkin) -> f64 {
    let [low, high] = skin.skin.mesh.surface().bounds_m();
    (0..3).map(|k| 0.5 * (high[k] - low[k])).fold(0.0, f64::max)
}

impl LearnedSkin {
    /// The model's responses at the presses and at all places within their reach.
    ///
    /// # Errors
    ///
    /// A press that is not on the skin.
    pub(super) fn model_responses(
        &self,
        skin: &LinearisedSkin,
    ) -> Result<ModelResponses, SkinError> {
        let Self { channels, orientation, bell_m, presses, .. } = self;
        let middle_m = middle_m(skin);
        let from_middle = |place: &[f64; 3]| distance(*place, middle_m);
        let reach_m = presses.places_m.iter().map(from_middle).fold(0.0, f64::max);
        let reach_m = reach_m + BEYOND * radius_m(skin);
        let all = places(skin);
        let candidates_m: Vec<[f64; 3]> =
            all.iter().filter(|place| from_middle(place) <= reach_m).copied().collect();
        let factors: Vec<f64> = ratios(skin, channels, &self.levels)
            .into_iter()
            .map(|ratio| ratio * orientation.sign)
            .collect();
        let on_model = |place: &[f64; 3]| on_skin(&all, orientation, *place);
        let at = |places_m: &[[f64; 3]]| {
            let on_model: Vec<[f64; 3]> = places_m.iter().map(on_model).collect();
            responses(skin, channels, &factors, &on_model, *bell_m)
        };
        Ok(ModelResponses {
            at_candidates: at(&candidates_m)?,
            at_presses: at(&presses.places_m)?,
            candidates_m,
        })
    }
}

/// A place turned to the model's skin; the nearest place of that if a turned one is farther from it than places are from
/// each other.
fn on_skin(all: &[[f64; 3]], orientation: &Orientation, place_m: [f64; 3]) -> [f64; 3] {
    let turned = orientation.to_model(place_m);
    if *orientation == Orientation::of_model(orientation.sign) {
        return turned;
    }
    let others = all.iter().skip(1).copied();
    let spacing_m = all.first().and_then(|first| nearest(others, *first));
    match (nearest(all.iter().copied(), turned), spacing_m) {
        (Some((at, distance_m)), Some((_, spacing_m))) if distance_m > spacing_m => all[at],
        _ => turned,
    }
}
