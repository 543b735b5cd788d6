//! The learning curve: what the touch list shows of later presses after learning the first ones, in the order of time.

use super::{Frame, LearnedSkin, PlaceErrors, PlacesBy, PressFrames};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::linearised::LinearisedSkin;
use crate::progress::Progress;
use crate::touches::{DEFAULT_RATE_HZ, TouchFinder};
use eit_core::vector::{distance, sub};
use eit_inverse::touch::{Touch, TouchState};
use std::time::Instant;

/// Numbers of presses that are learnt.
const COUNTS: [usize; 7] = [5, 10, 25, 50, 100, 200, 400];

/// Smallest number of test presses for which errors are stated.
const LEAST_TESTED: usize = 5;

/// Most presses that are tested, evenly chosen from all later ones.
const MOST_TESTED: usize = 100;

/// Frames of the untouched skin and of the press that are shown to the touch list for each press.
const FRAMES: usize = 3;

/// A point of the learning curve.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CurvePoint {
    /// Number of presses learnt: those of the earlier file, and the first of the table.
    pub learnt: usize,
    /// Number of those from the earlier file.
    pub earlier: usize,
    /// Number of presses tested, of all later ones.
    pub tested: usize,
    /// How touches were found.
    pub places_by: PlacesBy,
    /// Part of them that a valid touch shows, ...
    pub shown: f64,
    /// ... position errors of those touches, metres, ...
    pub place: PlaceErrors,
    /// ... and valid touches without a press in each frame: beside the one of a press, and on the untouched skin.
    pub ghosts: [f64; 2],
    /// Median and 90 % quantile of the relative force error.
    pub force: Option<[f64; 2]>,
    /// Time that learning took, seconds.
    pub time_s: f64,
}

/// Learns from the first presses, together with those of an earlier file, and tests on all later ones. With
/// an earlier file the first point is that file alone, tested on the whole table.
///
/// Too few presses, or frames of unknown noise, give an empty curve.
///
/// # Errors
///
/// Those of [`LearnedSkin::learn`], except for too few presses and presses from which nothing is learnt.
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
        let mut points = Vec::with_capacity(counts.len());
        for &learnt in &counts {
            points.extend(point(fitted, pressed, frame, earlier, learnt)?);
            bar.inc();
        }
        Ok(points)
    })
}

fn point(
    fitted: &FittedFrames,
    pressed: &PressFrames,
    frame: Frame,
    earlier: Option<&LearnedSkin>,
    learnt: usize,
) -> Result<Option<CurvePoint>, SkinError> {
    let first = pressed.select(&(0..learnt).collect::<Vec<_>>());
    let later = pressed.len() - learnt;
    let tested = later.min(MOST_TESTED);
    let later: Vec<usize> = (0..tested).map(|k| learnt + k * later / tested).collect();
    let rest = pressed.select(&later);
    let start = Instant::now();
    let learned = match earlier.filter(|_| learnt == 0) {
        Some(earlier) => earlier.clone(),
        None => {
            match LearnedSkin::learn(fitted, &first, frame, earlier, &mut Progress::silent()) {
                Ok(learning) => learning.skin,
                // the first presses are often too few to learn from
                Err(SkinError::NothingLearnt { .. }) => return Ok(None),
                Err(error) => return Err(error),
            }
        }
    };
    let time_s = start.elapsed().as_secs_f64();
    let Some(tested) = test(&learned, fitted, &rest)? else { return Ok(None) };
    let force = [0.5, 0.9].map(|part| eit_core::quantile(&tested.force_errors, part));
    let count = rest.len() as f64;
    Ok(Some(CurvePoint {
        learnt: learned.presses.places_m.len(),
        earlier: earlier.map_or(0, |earlier| earlier.presses.places_m.len()),
        tested: rest.len(),
        places_by: learned.places_by,
        shown: tested.errors_m.len() as f64 / count,
        place: PlaceErrors::of_errors(tested.errors_m),
        ghosts: tested.ghosts.map(|ghosts| ghosts as f64 / count),
        force: force[0].zip(force[1]).map(|(half, most)| [half, most]),
        time_s,
    }))
}

/// What the touch list shows.
#[derive(Default)]
struct Tested {
    /// Errors of the presses that are shown.
    errors_m: Vec<f64>,
    force_errors: Vec<f64>,
    /// Valid touches beside a press, and on the untouched skin.
    ghosts: [usize; 2],
}

/// Shows each press to the touch list, after the untouched skin before it, which is its reference.
fn test(
    learned: &LearnedSkin,
    fitted: &FittedFrames,
    pressed: &PressFrames,
) -> Result<Option<Tested>, SkinError> {
    let rate_hz = fitted.frames.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
    let quiet = learned.quiet_frames(fitted);
    let mut silent = Progress::silent();
    let finder = TouchFinder::with_learned(&quiet, rate_hz, Some(learned), &mut silent)?;
    let Some(mut finder) = finder else { return Ok(None) };
    let (mut tested, mut frame) = (Tested::default(), 0);
    let is_valid = |touch: &&Touch| touch.valid && touch.state != TouchState::End;
    for (k, [values, reference]) in pressed.pairs().enumerate() {
        finder.set_reference(&reference)?;
        let mut show = |values: &[f64]| {
            let mut last = Vec::new();
            for _ in 0..FRAMES {
                frame += 1;
                let touches = finder.push(values, |_| true, frame as f64 / rate_hz)?;
                last = touches.iter().filter(is_valid).copied().collect::<Vec<_>>();
            }
            Ok::<_, SkinError>(last)
        };
        tested.ghosts[1] += show(&reference)?.len();
        let shown = show(&values)?;
        tested.ghosts[0] += shown.len().saturating_sub(1);
        let strength = |touch: &&Touch| touch.intensity_s_m2.abs();
        let Some(touch) = shown.iter().max_by(|a, b| strength(a).total_cmp(&strength(b))) else {
            continue;
        };
        let place_m = sub(touch.position_m, learned.shift_m);
        tested.errors_m.push(distance(place_m, pressed.places_m[k]));
        if let (Some(found_n), Some(known_n)) = (touch.force_n(), pressed.forces_n[k]) {
            tested.force_errors.push((found_n / known_n - 1.0).abs());
        }
    }
    Ok(Some(tested))
}

impl LearnedSkin {
    /// Frames whose noise is that of the learnt presses if it is unknown.
    fn quiet_frames(&self, fitted: &FittedFrames) -> FittedFrames {
        let mut quiet = fitted.clone();
        let is_known = fitted.noise().is_ok_and(|noise| noise.is_some());
        if !is_known {
            let std = self.noise_std(fitted);
            let median = eit_core::median(std.iter().copied()).unwrap_or(0.0);
            let mut skin: LinearisedSkin = (*fitted.skin).clone();
            skin.skin.settings.noise.additive_v = Some(median.max(f64::MIN_POSITIVE));
            quiet.skin = std::sync::Arc::new(skin);
        }
        quiet
    }
}
