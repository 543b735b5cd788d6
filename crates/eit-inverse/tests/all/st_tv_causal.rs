//! Causal stream: closed forms, comparison with the batch solver on the same frame, every certificate
//! recomputed from the raw Jacobian, events, no allocation.
//!
//! Over 300 lines because every property is checked on the same set of scenes.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    missing_docs,
    reason = "tests"
)]

use crate::common::disc;
use eit_inverse::{
    CausalDual, CausalSettings, CausalStream, DifferenceFrames, Fidelity, Gradient, InverseError,
    SequenceStatus, StTv, StTvSettings, Stop,
};
use fixtures::Random;
use ndarray::{Array1, Array2};
use std::hint::black_box;
use std::time::Duration;

const MEASUREMENTS: usize = 40;
const NOISE: f64 = 0.02;
const GAP: f64 = 1e-2;
/// Default of `CausalSettings::time_share`.
const SHARE: f64 = 0.25;

/// A basis with a smooth Jacobian, and touches on it.
struct Setup {
    jacobian: Array2<f64>,
    gradient: Gradient,
    places: Vec<[f64; 2]>,
}

/// Fields of dipoles near the rim of the unit disc: large near the rim and small in the middle, as in a
/// real skin.
fn scene_on(places: Vec<[f64; 2]>, gradient: Gradient, weight: impl Fn(usize) -> f64) -> Setup {
    let mut random = Random::new(7);
    let mut jacobian = Array2::zeros((MEASUREMENTS, places.len()));
    for mut row in jacobian.rows_mut() {
        let angle = std::f64::consts::TAU * random.uniform();
        let turn = std::f64::consts::TAU * random.uniform();
        let source = [1.2 * angle.cos(), 1.2 * angle.sin()];
        for (p, (value, place)) in row.iter_mut().zip(&places).enumerate() {
            let (dx, dy) = (place[0] - source[0], place[1] - source[1]);
            let dipole = turn.cos() * dx + turn.sin() * dy;
            *value = weight(p) * dipole / (0.02 + dx * dx + dy * dy);
        }
    }
    Setup { jacobian, gradient, places }
}

fn pixels(side: usize) -> Setup {
    let centre = 0.5 * (side as f64 - 1.0);
    let place = |i: usize, j: usize| [(j as f64 - centre) / centre, (i as f64 - centre) / centre];
    let mask = Array2::from_shape_fn((side, side), |(i, j)| {
        let [x, y] = place(i, j);
        x.hypot(y) <= 1.02
    });
    let inside = mask.indexed_iter().filter(|(_, m)| **m);
    let places: Vec<[f64; 2]> = inside.map(|((i, j), _)| place(i, j)).collect();
    scene_on(places, Gradient::pixels(&mask, 1.0).unwrap(), |_| 30.0 / (side * side) as f64)
}

/// Two separate rectangles: a skin in two parts.
fn two_parts() -> Setup {
    let mask = Array2::from_shape_fn((9, 21), |(_, j)| j != 10);
    let inside = mask.indexed_iter().filter(|(_, m)| **m);
    let places = inside.map(|((i, j), _)| [j as f64 / 10.0 - 1.0, i as f64 / 10.0 - 0.4]).collect();
    scene_on(places, Gradient::pixels(&mask, 1.0).unwrap(), |_| 0.1)
}

fn mesh(nodal: bool) -> Setup {
    let surface = disc(1.0, 7);
    let (gradient, points): (_, Vec<[f64; 3]>) = match nodal {
        true => (Gradient::nodal(&surface).unwrap(), surface.nodes().to_vec()),
        false => (Gradient::elements(&surface).unwrap(), surface.centroids()),
    };
    let places = points.iter().map(|p| [p[0], p[1]]).collect();
    let areas = gradient.areas_m2().to_vec();
    scene_on(places, gradient, |p| 10.0 * areas[p])
}

/// Touches in frame `f`: none, pressed, moving, jumping, released.
fn touches(f: usize) -> Vec<([f64; 2], f64)> {
    let at = |angle: f64, radius: f64| [radius * angle.cos(), radius * angle.sin()];
    let turn = 0.03 * f as f64;
    match f % 120 {
        0..10 => vec![],
        10..40 => vec![(at(turn, 0.5), 1.0)],
        40..70 => vec![(at(turn, 0.5), 1.0), (at(2.0 + turn, 0.4), 0.7)],
        70..90 => vec![(at(2.5 + turn, 0.4), 0.7)],
        90..110 => vec![(at(4.0 - turn, 0.6), 1.2)],
        _ => vec![],
    }
}

impl Setup {
    fn image(&self, f: usize) -> Array1<f64> {
        let touches = touches(f);
        let value = |p: &[f64; 2]| -> f64 {
            let near = touches.iter().filter(|(at, _)| (p[0] - at[0]).hypot(p[1] - at[1]) < 0.22);
            near.map(|touch| touch.1).sum()
        };
        self.places.iter().map(value).collect()
    }

    fn frame(&self, f: usize, random: &mut Random) -> Vec<f64> {
        let mut dv = self.jacobian.dot(&self.image(f)).to_vec();
        dv.iter_mut().for_each(|v| *v += NOISE * random.normal());
        dv
    }

    /// Weights that suit the noise, in units of the data term over those of the sums.
    fn settings(&self) -> StTvSettings {
        let area: f64 = self.gradient.areas_m2().iter().sum();
        let length = (area / std::f64::consts::PI).sqrt();
        StTvSettings {
            lambda_space: 6.0 / length,
            lambda_time: 6.0 / length / self.pixel_m(),
            noise_std: Some(vec![NOISE; MEASUREMENTS]),
            ..Default::default()
        }
    }

    fn pixel_m(&self) -> f64 {
        let areas = self.gradient.areas_m2();
        (areas.iter().sum::<f64>() / areas.len() as f64).sqrt()
    }

    fn stream(&self, settings: StTvSettings, target_gap: f64) -> CausalStream {
        let solver = StTv::new(&self.jacobian, &self.gradient, settings).unwrap();
        let settings = CausalSettings { target_gap, ..Default::default() };
        CausalStream::new(solver, settings).unwrap()
    }
}

/// Objective and lower bound of a frame, computed from the raw Jacobian, the previous image and the dual
/// point.
struct Audit {
    primal: f64,
    lower_bound: f64,
    /// Largest ratio of a dual to its radius, for duals that no bound relaxes.
    kappa: f64,
    /// `|W^1/2 (J x - dv)|` over the radius of a constrained frame.
    violation: f64,
}

fn audit(
    scene: &Setup,
    settings: &StTvSettings,
    good: &[bool],
    dv: &[f64],
    before: &[f64],
    image: &[f64],
    dual: &CausalDual,
) -> Audit {
    let gradient = &scene.gradient;
    let noise = settings.noise_std.as_ref().map_or(1.0, |std| std[0]);
    let weight: Vec<f64> = good.iter().map(|g| if *g { 1.0 / noise } else { 0.0 }).collect();
    let model = |x: &[f64]| scene.jacobian.dot(&Array1::from(x.to_vec()));
    let misfit = |x: &[f64]| -> Vec<f64> {
        let terms = model(x).to_vec().into_iter().zip(dv).zip(&weight);
        // masked values may be NaN
        terms.map(|((m, v), w)| if *w > 0.0 { w * (m - v) } else { 0.0 }).collect()
    };
    let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
    let (own, anchored) = (misfit(image), misfit(before));
    let areas = gradient.areas_m2();
    let lambda_time = SHARE * settings.lambda_time;
    let change: f64 =
        (0..image.len()).map(|p| areas[p] * (image[p] - before[p]).abs()).sum::<f64>();
    let variation =
        settings.lambda_space * gradient.total_variation(image).unwrap() + lambda_time * change;

    let weighted: Array1<f64> = dual.data.iter().zip(&weight).map(|(y, w)| y * w).collect();
    let mut force = scene.jacobian.t().dot(&weighted).to_vec();
    // -y.(b - A x^)
    let mut linear: f64 = dual.data.iter().zip(&anchored).map(|(y, r)| y * r).sum();
    let mut kappa = 0.0_f64;
    let components = gradient.components();
    for group in 0..gradient.groups() {
        let mut norm = 0.0;
        for row in group * components..(group + 1) * components {
            let (columns, values) = gradient.row(row);
            norm += dual.flow[row].powi(2);
            for (&p, v) in columns.iter().zip(values) {
                force[p as usize] += v * dual.flow[row];
                linear += v * dual.flow[row] * before[p as usize];
            }
        }
        kappa = kappa.max(norm.sqrt() / settings.lambda_space);
    }
    let mut support = 0.0;
    for (p, force) in force.iter().enumerate() {
        let radius = lambda_time * areas[p];
        // h(r) with r = -force
        let room = match *force > 0.0 {
            true => before[p] - settings.lower_s,
            false => settings.upper_s - before[p],
        };
        if room.is_finite() {
            support += (force.abs() - radius).max(0.0) * room;
        } else {
            kappa = kappa.max(force.abs() / radius);
        }
    }
    match settings.fidelity {
        Fidelity::Constrained { delta } => {
            let count = good.iter().filter(|g| **g).count() as f64;
            let delta = delta * (count / MEASUREMENTS as f64).sqrt();
            Audit {
                primal: variation,
                lower_bound: linear - delta * square(&dual.data).sqrt() - support,
                kappa,
                violation: square(&own).sqrt() / delta,
            }
        }
        _ => Audit {
            primal: 0.5 * square(&own) + variation,
            lower_bound: linear - 0.5 * square(&dual.data) - support,
            kappa,
            violation: 0.0,
        },
    }
}

/// Streams frames and checks the certificate of each; returns their numbers of iterations.
fn stream_and_audit(
    scene: &Setup,
    settings: &StTvSettings,
    target_gap: f64,
    frames: usize,
    good: impl Fn(usize) -> Vec<bool>,
) -> Vec<usize> {
    let mut stream = scene.stream(settings.clone(), target_gap);
    let mut random = Random::new(11);
    let mut iterations = Vec::new();
    for f in 0..frames {
        let (mut dv, good) = (scene.frame(f, &mut random), good(f));
        for (value, good) in dv.iter_mut().zip(&good) {
            if !good {
                *value = f64::NAN;
            }
        }
        let step = stream.push(&dv, Some(&good)).unwrap();
        iterations.push(step.iterations);
        if step.quiet || step.status == SequenceStatus::Stalled {
            assert!(step.image.iter().all(|x| *x == 0.0), "frame {f}");
            continue;
        }
        let (own, status) = (step.certificate, step.status);
        let image = step.image.to_vec();
        // Constrained frames with bounds, and frames that have lost most of their channels, do not always
        // converge within the cap. The reported bounds must be valid nevertheless.
        let is_hard = settings.lower_s.is_finite() && settings.fidelity != Fidelity::Penalised
            || good.iter().filter(|g| **g).count() < MEASUREMENTS / 4;
        if is_hard && status == SequenceStatus::IterationCap && own.primal.is_infinite() {
            continue;
        }
        let is_converged = status == SequenceStatus::Converged;
        assert!(is_converged || is_hard, "frame {f} of {settings:?}: {own:?}");
        let [lower, upper] = [settings.lower_s, settings.upper_s];
        assert!(image.iter().all(|x| (lower..=upper).contains(x)), "frame {f}");
        let found =
            audit(scene, settings, &good, &dv, stream.image_before(), &image, &stream.dual());
        // rounding in f64 of sums over a few hundred terms; the objective of a touch is above 1, and after
        // its release differences of values of that size remain
        let rounding = 1e-9 * found.primal.abs() + 1e-12;
        // the reported objective includes the rounding error of f32, so the true one may only be lower
        assert!(found.primal <= own.primal + rounding, "frame {f}: {} {own:?}", found.primal);
        assert!(found.kappa <= 1.0 + 1e-9, "frame {f}: {}", found.kappa);
        assert!(found.violation <= 1.0 + 1e-8, "frame {f}: {}", found.violation);
        assert!(
            found.lower_bound >= own.lower_bound - rounding,
            "frame {f}: {} {own:?}",
            found.lower_bound
        );
        let gap = found.primal - found.lower_bound;
        let claimed = if is_converged { target_gap } else { own.relative_gap() };
        assert!(gap <= claimed * found.primal * (1.0 + 1e-6) + rounding, "frame {f}: {gap}");
    }
    iterations
}

fn all(_: usize) -> Vec<bool> {
    vec![true; MEASUREMENTS]
}

/// Masks of successive frames: none, one lost electrode, two, most channels, none.
fn some(f: usize) -> Vec<bool> {
    (0..MEASUREMENTS)
        .map(|i| match f % 80 {
            0..30 => true,
            30..50 => i % 8 != 0,
            50..60 => i % 8 != 0 && i % 9 != 4,
            60..70 => i < 6,
            _ => true,
        })
        .collect()
}

fn constrained() -> Fidelity {
    Fidelity::Constrained { delta: 1.2 * (MEASUREMENTS as f64).sqrt() }
}

#[test]
fn every_certificate_holds_over_ten_thousand_frames_with_events() {
    let scene = pixels(11);
    // 10 000 frames in all: penalised, masked, bounded
    stream_and_audit(&scene, &scene.settings(), GAP, 6000, all);
    stream_and_audit(&scene, &scene.settings(), GAP, 2000, some);
    let bounded = StTvSettings { lower_s: 0.0, upper_s: 0.9, ..scene.settings() };
    stream_and_audit(&scene, &bounded, GAP, 1000, all);
    let settings = StTvSettings { fidelity: constrained(), ..scene.settings() };
    stream_and_audit(&scene, &settings, GAP, 1000, all);
}

#[test]
fn every_form_on_every_basis() {
    for scene in [pixels(14), two_parts(), mesh(true), mesh(false)] {
        for lower_s in [f64::NEG_INFINITY, 0.0] {
            for fidelity in [Fidelity::Penalised, constrained()] {
                for good in [all, some] {
                    let settings = StTvSettings { lower_s, fidelity, ..scene.settings() };
                    stream_and_audit(&scene, &settings, GAP, 80, good);
                }
            }
        }
    }
}

/// Without a term in time a frame is the problem that `StTv::solve` has for it alone.
#[test]
fn frames_that_are_not_linked_have_the_optimum_of_a_sequence_of_one() {
    for scene in [pixels(14), two_parts(), mesh(true), mesh(false)] {
        for lower_s in [f64::NEG_INFINITY, 0.0] {
            for fidelity in [Fidelity::Penalised, constrained()] {
                let settings =
                    StTvSettings { lower_s, fidelity, lambda_time: 0.0, ..scene.settings() };
                let solver = StTv::new(&scene.jacobian, &scene.gradient, settings.clone()).unwrap();
                let mut stream = scene.stream(settings, GAP);
                let mut random = Random::new(5);
                for f in (8..14).chain(34..40) {
                    let (dv, good) = (scene.frame(f, &mut random), some(f));
                    let step = stream.push(&dv, Some(&good)).unwrap();
                    // constrained frames with bounds do not always converge within the cap, linked or not
                    let is_hard = lower_s == 0.0 && fidelity != Fidelity::Penalised;
                    let is_solved = step.quiet || step.status == SequenceStatus::Converged;
                    assert!(is_solved || is_hard, "frame {f}: {:?}", step.certificate);
                    let (own, is_quiet) = (step.certificate, step.quiet);
                    let row = |row: &[f64]| Array2::from_shape_vec((1, row.len()), row.to_vec());
                    let values = row(&dv).unwrap();
                    let good = Array2::from_shape_vec((1, good.len()), good).unwrap();
                    let frames =
                        DifferenceFrames { values: values.view(), good: Some(good.view()) };
                    let stop = Stop { target_gap: 1e-3, ..Default::default() };
                    let whole = solver.solve(&frames, &stop).unwrap().report.certificate.unwrap();
                    if !is_quiet {
                        // both intervals contain the optimum, up to the rounding of f64
                        assert!(own.lower_bound <= whole.primal * (1.0 + 1e-9), "frame {f}");
                        assert!(whole.lower_bound <= own.primal * (1.0 + 1e-9), "frame {f}");
                    }
                }
            }
        }
    }
}

#[test]
fn tight_gaps_are_proven_in_double() {
    let scene = pixels(11);
    let settings = scene.settings();
    stream_and_audit(&scene, &settings, 1e-3, 30, all);
    stream_and_audit(&scene, &settings, 1e-5, 20, all);
}

#[test]
fn one_pixel_is_a_shifted_and_clipped_least_squares() {
    let gradient = Gradient::pixels(&Array2::from_elem((1, 1), true), 1.0).unwrap();
    let jacobian = Array2::from_shape_vec((3, 1), vec![2.0, -1.0, 0.5]).unwrap();
    let power = 5.25;
    let settings = StTvSettings { lambda_space: 1.0, lambda_time: 0.8, ..Default::default() };
    let bounded = StTvSettings { lower_s: -0.1, upper_s: 1.5, ..settings.clone() };
    // an objective within the gap, with curvature `power`: error sqrt(2 gap P / power), with P of order 1
    for (settings, target_gap, error) in [(settings, 1e-6, 1e-3), (bounded, 1e-2, 0.07)] {
        let [lower, upper] = [settings.lower_s, settings.upper_s];
        let solver = StTv::new(&jacobian, &gradient, settings).unwrap();
        let how = CausalSettings { target_gap, ..Default::default() };
        let mut stream = CausalStream::new(solver, how).unwrap();
        let mut before = 0.0_f64;
        for (f, value) in [1.0, 1.02, 3.0, 0.5, 0.45, -2.0].into_iter().enumerate() {
            let dv = [2.0 * value + 0.1, -value, 0.5 * value - 0.2];
            let least: f64 = (2.0 * dv[0] - dv[1] + 0.5 * dv[2]) / power;
            let shift = SHARE * 0.8 / power;
            let change = (least - before).signum() * ((least - before).abs() - shift).max(0.0);
            let wanted = (before + change).clamp(lower, upper);
            let step = stream.push(&dv, None).unwrap();
            assert_eq!(step.status, SequenceStatus::Converged, "frame {f} {lower} {step:?}");
            let image = step.image[0];
            assert!((image - wanted).abs() < error, "frame {f}: {image} for {wanted}: {step:?}");
            before = image;
        }
    }
}

#[test]
fn a_first_frame_with_a_faint_anchor_is_the_batch_solution() {
    let scene = pixels(14);
    let mut random = Random::new(5);
    let dv = scene.frame(20, &mut random);
    for fidelity in [Fidelity::Penalised, constrained()] {
        let settings = StTvSettings { fidelity, ..scene.settings() };
        let alone = StTvSettings { lambda_time: 0.0, ..settings.clone() };
        let batch = StTv::new(&scene.jacobian, &scene.gradient, alone).unwrap();
        let values = Array2::from_shape_vec((1, MEASUREMENTS), dv.clone()).unwrap();
        let stop = Stop { target_gap: 1e-5, ..Default::default() };
        let optimum = batch.solve(&DifferenceFrames::all_good(values.view()), &stop).unwrap();
        let optimum = optimum.report.certificate.unwrap();
        // so small that the anchor term is below the gap, yet large enough for its dual
        let share = 2e-2;
        let solver = StTv::new(&scene.jacobian, &scene.gradient, settings.clone()).unwrap();
        let how = CausalSettings { target_gap: 1e-3, time_share: share, ..Default::default() };
        let mut stream = CausalStream::new(solver, how).unwrap();
        let step = stream.push(&dv, None).unwrap();
        let added: f64 =
            share * settings.lambda_time * step.image.iter().map(|x| x.abs()).sum::<f64>();
        let own = step.certificate;
        assert_eq!(step.status, SequenceStatus::Converged, "{own:?}");
        // without the anchor term the image is a candidate of the batch problem, and the anchor term only
        // increases the objective
        assert!(own.primal - added >= optimum.lower_bound * (1.0 - 1e-9), "{own:?} {optimum:?}");
        assert!(own.lower_bound <= optimum.primal + 1.5 * added, "{own:?} {optimum:?}");
        assert!(own.primal >= optimum.lower_bound, "{own:?} {optimum:?}");
    }
}

#[test]
fn events_are_bounded() {
    let Some(problem) = fixtures::st_tv::load(32).unwrap() else { return };
    let gradient = Gradient::pixels(&problem.mask, 1.0).unwrap();
    let settings = StTvSettings {
        lambda_space: problem.lambda,
        lambda_time: problem.lambda,
        ..Default::default()
    };
    let solver = StTv::new(&problem.jacobian, &gradient, settings).unwrap();
    let mut stream = CausalStream::new(solver, CausalSettings::default()).unwrap();
    let noise = problem.noise_norm / (problem.values.len() as f64).sqrt();
    let side = problem.mask.nrows() as f64;
    let inside = problem.mask.indexed_iter().filter(|(_, m)| **m);
    let place = |i: usize| (i as f64 + 0.5) / side * 2.0 - 1.0;
    let places: Vec<[f64; 2]> = inside.map(|((i, j), _)| [place(j), place(i)]).collect();
    let mut random = Random::new(2);
    let mut iterations = Vec::new();
    for f in 0..400 {
        let angle = f as f64 / 397.0 * std::f64::consts::TAU;
        // of each 100 frames, one finger is pressed at 60 and released at 20, the other at 80 and 40
        let is_pressed = [!(20..60).contains(&(f % 100)), !(40..80).contains(&(f % 100))];
        let touch = |k: usize| [(0.55, 0.15, 0.5, 0.0), (0.45, 0.12, 0.4, 2.0)][k];
        let value = |p: &[f64; 2]| -> f64 {
            let own =
                (0..2).filter(|&k| is_pressed[k]).map(touch).filter(|(radius, size, _, turn)| {
                    let (x, y) = (radius * (angle + turn).cos(), radius * (angle + turn).sin());
                    (p[0] - x).hypot(p[1] - y) < *size
                });
            own.map(|touch| touch.2).sum()
        };
        let image: Array1<f64> = places.iter().map(value).collect();
        let mut dv = problem.jacobian.dot(&image).to_vec();
        dv.iter_mut().for_each(|v| *v += noise * random.normal());
        let step = stream.push(&dv, None).unwrap();
        assert_eq!(step.status, SequenceStatus::Converged, "frame {f}");
        iterations.push(step.iterations);
    }
    let most = *iterations.iter().max().unwrap();
    let mut sorted = iterations.clone();
    sorted.sort_unstable();
    let median = sorted[sorted.len() / 2];
    assert!(most <= 5 * median, "most {most}, median {median}");
}

#[test]
fn allocates_nothing_after_set_up() {
    let scene = pixels(14);
    for fidelity in [Fidelity::Penalised, constrained()] {
        let settings = StTvSettings { fidelity, lower_s: 0.0, ..scene.settings() };
        let mut stream = scene.stream(settings, GAP);
        let mut random = Random::new(3);
        let frames: Vec<Vec<f64>> = (0..60).map(|f| scene.frame(f, &mut random)).collect();
        let masks: Vec<Vec<bool>> = (30..90).map(some).collect();
        let change = vec![1e-3; MEASUREMENTS];
        let image = vec![0.1; scene.places.len()];
        let counted = allocation_counter::measure(|| {
            for (f, (dv, mask)) in frames.iter().zip(&masks).enumerate() {
                match f {
                    7 => {
                        black_box(stream.push_dropped());
                    }
                    12 => stream.change_reference(&change).unwrap(),
                    40 => stream.anchor(&image).unwrap(),
                    50 => stream.restart(),
                    _ => {}
                }
                let good = (f >= 20).then_some(mask.as_slice());
                black_box(stream.push(dv, good).unwrap().iterations);
            }
        });
        assert_eq!(counted.count_total, 0, "{counted:?}");
    }
    // the counter does count allocations
    assert!(allocation_counter::measure(|| drop(black_box(vec![0_u8; 100]))).count_total > 0);
}

#[test]
fn a_deadline_is_kept() {
    let scene = pixels(40);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, scene.settings()).unwrap();
    let deadline = Duration::from_millis(40);
    let how = CausalSettings {
        target_gap: 1e-13,
        max_iterations: usize::MAX,
        deadline: Some(deadline),
        ..Default::default()
    };
    let mut stream = CausalStream::new(solver, how).unwrap();
    let mut random = Random::new(3);
    let mut least = f64::INFINITY;
    for f in 20..28 {
        let step = stream.push(&scene.frame(f, &mut random), None).unwrap();
        assert_eq!(step.status, SequenceStatus::Deadline, "frame {f}: {:?}", step.certificate);
        assert!(step.certificate.relative_gap().is_finite(), "frame {f}");
        least = least.min(step.seconds);
    }
    println!("best of eight: {:.3} of the deadline", least / deadline.as_secs_f64());
    // without the check of the deadline the call would never return; a test on a shared processor cannot
    // measure how precisely the deadline is kept
    assert!(least <= 3.0 * deadline.as_secs_f64(), "{least}");
}

#[test]
fn the_image_does_not_depend_on_units() {
    let scene = pixels(11);
    let images = |volt: f64, siemens: f64| -> Vec<Vec<f64>> {
        let jacobian = scene.jacobian.mapv(|j| j * volt / siemens);
        let noise = NOISE * volt;
        let settings = scene.settings();
        let settings = StTvSettings {
            lambda_space: settings.lambda_space / siemens,
            lambda_time: settings.lambda_time / siemens,
            noise_std: Some(vec![noise; MEASUREMENTS]),
            ..settings
        };
        let solver = StTv::new(&jacobian, &scene.gradient, settings).unwrap();
        let mut stream = CausalStream::new(solver, CausalSettings::default()).unwrap();
        let mut random = Random::new(9);
        let frame = |f: usize, random: &mut Random| -> Vec<f64> {
            scene.frame(f, random).iter().map(|v| v * volt).collect()
        };
        (20..30)
            .map(|f| {
                let dv = frame(f, &mut random);
                let image = stream.push(&dv, None).unwrap().image.to_vec();
                image.iter().map(|x| x / siemens).collect()
            })
            .collect()
    };
    let plain = images(1.0, 1.0);
    for (volt, siemens) in [(1e-9, 1e-6), (1e9, 1e12), (1e-3, 1e9)] {
        for (a, b) in plain.iter().zip(images(volt, siemens)) {
            let largest = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            for (a, b) in a.iter().zip(&b) {
                // in internal units the problems differ by rounding only, far below the gap of 1e-2
                assert!((a - b).abs() <= 1e-2 * largest, "{volt} {siemens}: {a} {b}");
            }
        }
    }
}

#[test]
fn rest_dropped_frames_and_references() {
    let scene = pixels(14);
    let mut stream = scene.stream(scene.settings(), GAP);
    let mut random = Random::new(3);
    // pure noise: rest
    let step = stream.push(&scene.frame(0, &mut random), None).unwrap();
    assert!(step.quiet && step.iterations == 0);
    // a touch, held over a dropped frame and one without a good channel
    let dv = scene.frame(20, &mut random);
    let held = stream.push(&dv, None).unwrap().image.to_vec();
    assert!(held.iter().any(|x| *x > 0.1));
    assert_eq!(stream.push_dropped().image, held);
    let none = vec![false; MEASUREMENTS];
    let step = stream.push(&dv, Some(&none)).unwrap();
    assert_eq!(step.image, held);
    assert_eq!(step.status, SequenceStatus::Direct);
    // an anchor becomes the previous image
    stream.anchor(&held).unwrap();
    stream.push(&dv, None).unwrap();
    assert_eq!(stream.image_before(), held);
    // the touch becomes part of the reference and vanishes
    stream.change_reference(&dv).unwrap();
    let step = stream.push(&vec![0.0; MEASUREMENTS], None).unwrap();
    assert!(step.quiet && step.image.iter().all(|x| *x == 0.0));
    // after a restart a frame is treated as the first one
    let first = scene.stream(scene.settings(), GAP).push(&dv, None).unwrap().image.to_vec();
    stream.restart();
    let again = stream.push(&dv, None).unwrap().image.to_vec();
    let distance: f64 = first.iter().zip(&again).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let norm: f64 = first.iter().map(|a| a * a).sum::<f64>().sqrt();
    // both are within the gap of the same optimum; their steps differ
    assert!(distance <= 0.1 * norm, "{distance} {norm}");
    // release: after at most eight quiet frames the image is zero
    let mut zero = false;
    for _ in 0..9 {
        let quiet: Vec<f64> = (0..MEASUREMENTS).map(|_| 0.5 * NOISE * random.normal()).collect();
        zero = stream.push(&quiet, None).unwrap().image.iter().all(|x| *x == 0.0);
    }
    assert!(zero);
}

#[test]
fn refuses_what_cannot_be() {
    let scene = pixels(11);
    let plain = || StTv::new(&scene.jacobian, &scene.gradient, scene.settings()).unwrap();
    let with = |how| CausalStream::new(plain(), how).map(drop);
    let bad = [
        CausalSettings { target_gap: 0.0, ..Default::default() },
        CausalSettings { target_gap: f64::NAN, ..Default::default() },
        CausalSettings { max_iterations: 0, ..Default::default() },
        CausalSettings { time_share: 0.0, ..Default::default() },
    ];
    for how in bad {
        assert!(matches!(with(how), Err(InverseError::OutOfRange { .. })), "{how:?}");
    }

    let mut stream = scene.stream(scene.settings(), GAP);
    let mut dv = vec![0.0; MEASUREMENTS];
    assert!(matches!(stream.push(&dv[1..], None), Err(InverseError::WrongLength { .. })));
    dv[5] = f64::INFINITY;
    assert!(matches!(
        stream.push(&dv, None),
        Err(InverseError::NonFiniteData { frame: 0, measurement: 5, .. })
    ));
    assert!(stream.change_reference(&dv).is_err());
    assert!(stream.anchor(&[0.0]).is_err());
    let tight = StTvSettings { fidelity: Fidelity::Constrained { delta: 0.0 }, ..scene.settings() };
    let few = Array2::from_shape_fn((MEASUREMENTS, scene.places.len()), |(i, p)| {
        scene.jacobian[(i % 3, p)]
    });
    let solver = StTv::new(&few, &scene.gradient, tight).unwrap();
    let mut stream = CausalStream::new(solver, CausalSettings::default()).unwrap();
    let dv: Vec<f64> = (0..MEASUREMENTS).map(|i| i as f64).collect();
    assert!(matches!(stream.push(&dv, None), Err(InverseError::DeltaTooSmall { .. })));
}
