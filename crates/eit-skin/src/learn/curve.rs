//! The learning curve: errors on later presses after learning the first ones, in the order of time.

use super::{Frame, LearnedSkin, PlaceErrors, PlacesBy, PressFrames, StrengthBy};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::progress::Progress;
use eit_inverse::learn::{Locator, PlaceRegression};
use std::time::Instant;

/// Numbers of presses that are learnt.
const COUNTS: [usize; 7] = [5, 10, 25, 50, 100, 200, 400];

/// Smallest number of test presses for which errors are stated.
const LEAST_TESTED: usize = 5;

/// A point of the learning curve.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CurvePoint {
    /// Number of presses learnt: those of the earlier file, and the first of the table.
    pub learnt: usize,
    /// Number of those from the earlier file.
    pub earlier: usize,
    /// Number of presses tested: all later ones.
    pub tested: usize,
    /// How touches were located.
    pub places_by: PlacesBy,
    /// Position errors, metres of the table.
    pub place: PlaceErrors,
    /// Median and 90 % quantile of the relative force error.
    pub force: Option<[f64; 2]>,
    /// Time that learning took, seconds.
    pub time_s: f64,
}

/// Learns from the first presses, together with those of an earlier file, and tests on all later ones. With
/// an earlier file the first point is that file alone, tested on the whole table.
///
/// Too few presses give an empty curve.
///
/// # Errors
///
/// Those of [`LearnedSkin::learn`], except for too few presses.
pub fn learning_curve(
    fitted: &FittedFrames,
    pressed: &PressFrames,
    frame: Frame,
    earlier: Option<&LearnedSkin>,
    progress: &mut Progress,
) -> Result<Vec<CurvePoint>, SkinError> {
    let alone = earlier.map(|_| 0);
    let counts = alone.into_iter().chain(COUNTS);
    let counts: Vec<usize> = counts.filter(|count| count + LEAST_TESTED <= pressed.len()).collect();
    progress.steps("learning curve", counts.len(), |bar| {
        counts
            .iter()
            .map(|&learnt| {
                let made = point(fitted, pressed, frame, earlier, learnt);
                bar.inc();
                made
            })
            .collect()
    })
}

fn point(
    fitted: &FittedFrames,
    pressed: &PressFrames,
    frame: Frame,
    earlier: Option<&LearnedSkin>,
    learnt: usize,
) -> Result<CurvePoint, SkinError> {
    let first = pressed.select(&(0..learnt).collect::<Vec<_>>());
    let rest = pressed.select(&(learnt..pressed.len()).collect::<Vec<_>>());
    let start = Instant::now();
    let learned = match earlier.filter(|_| learnt == 0) {
        Some(earlier) => earlier.clone(),
        None => LearnedSkin::learn(fitted, &first, frame, earlier, &mut Progress::silent())?.skin,
    };
    let time_s = start.elapsed().as_secs_f64();
    let tested = test(&learned, fitted, &rest)?;
    let force = [0.5, 0.9].map(|part| eit_core::quantile(&tested.force_errors, part));
    let force = force[0].zip(force[1]).map(|(half, most)| [half, most]);
    Ok(CurvePoint {
        learnt: learned.presses.places_m.len(),
        earlier: earlier.map_or(0, |earlier| earlier.presses.places_m.len()),
        tested: rest.len(),
        places_by: learned.places_by,
        place: PlaceErrors::of_errors(tested.errors_m),
        force,
        time_s,
    })
}

/// Errors of individual presses.
struct Tested {
    errors_m: Vec<f64>,
    force_errors: Vec<f64>,
}

fn test(
    learned: &LearnedSkin,
    fitted: &FittedFrames,
    pressed: &PressFrames,
) -> Result<Tested, SkinError> {
    let skin = &*fitted.skin;
    let noise = vec![0.0; learned.channels.len()];
    let mut locator = Locator::new(learned.response_map(skin)?, &noise)?;
    let regression = PlaceRegression::with_settings(&learned.presses, learned.regression)?;
    let by_model = learned.places_by == PlacesBy::Model
        || learned.force.as_ref().is_some_and(|force| force.strength_by != StrengthBy::Map);
    let detected = if by_model { pressed.detect(fitted, learned.places_by)? } else { None };
    let differences = pressed.differences(&learned.channels);
    let (mut errors_m, mut force_errors) = (Vec::new(), Vec::new());
    for (k, difference) in differences.rows().into_iter().enumerate() {
        let difference = difference.to_vec();
        let touch = detected.as_ref().and_then(|all| all[k]);
        let located = locator.locate(&difference, None, 0.0);
        let place = match learned.places_by {
            PlacesBy::Model => touch.map(|found| found.touch.position_m),
            PlacesBy::Map => located.map(|located| located.position_m),
            PlacesBy::Regression => Some(regression.place(&difference)?.position_m),
        };
        let error_m = match place {
            Some(place) => {
                eit_core::vector::distance(learned.pose.to_table(place), pressed.places_m[k])
            }
            None => super::model::radius_m(skin) / learned.pose.scale,
        };
        errors_m.push(error_m);
        let Some((force, known_n)) = learned.force.as_ref().zip(pressed.forces_n[k]) else {
            continue;
        };
        let by_model = touch.map(|found| found.even_strength_s_m2);
        let by_map = located.map(|located| located.strength_s_m2);
        let strength = force.strength_by.strength(by_model, by_map);
        let place = place.unwrap_or(super::model::middle_m(skin));
        let found = force.curve.force(strength, place, 0.0);
        force_errors.push((found.force_n / known_n - 1.0).abs());
    }
    Ok(Tested { errors_m, force_errors })
}
