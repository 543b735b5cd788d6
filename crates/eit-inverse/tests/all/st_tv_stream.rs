//! Frames solved one by one: agreement with a batch solve, no allocation, and all events of a running
//! instrument.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, reason = "tests")]

use eit_inverse::{
    CausalSettings, CausalStream, DifferenceFrames, Fidelity, Gradient, InverseError,
    SequenceStatus, StTv, StTvSettings, Stop,
};
use fixtures::Random;
use ndarray::{Array1, Array2};
use std::hint::black_box;

const SIDE: usize = 14;
const MEASUREMENTS: usize = 40;

/// A smooth random Jacobian on a disc of pixels, and noisy frames of a moving touch.
struct Setup {
    jacobian: Array2<f64>,
    gradient: Gradient,
    frames: Vec<Vec<f64>>,
}

fn scene(count: usize, noise: f64) -> Setup {
    let centre = 0.5 * (SIDE as f64 - 1.0);
    let place = |i: usize, j: usize| [i as f64 - centre, j as f64 - centre];
    let mask = Array2::from_shape_fn((SIDE, SIDE), |(i, j)| {
        let [x, y] = place(i, j);
        x.hypot(y) <= centre + 0.3
    });
    let pixels: Vec<[f64; 2]> =
        mask.indexed_iter().filter(|(_, m)| **m).map(|((i, j), _)| place(i, j)).collect();
    let mut random = Random::new(7);
    let mut jacobian = Array2::zeros((MEASUREMENTS, pixels.len()));
    for mut row in jacobian.rows_mut() {
        // field of a dipole near the rim: large near the rim and small in the middle, as in a real skin
        let angle = std::f64::consts::TAU * random.uniform();
        let turn = std::f64::consts::TAU * random.uniform();
        let source = [1.2 * centre * angle.cos(), 1.2 * centre * angle.sin()];
        for (value, pixel) in row.iter_mut().zip(&pixels) {
            let (dx, dy) = (pixel[0] - source[0], pixel[1] - source[1]);
            *value = (turn.cos() * dx + turn.sin() * dy) / (1.0 + dx * dx + dy * dy);
        }
    }
    let frames = (0..count)
        .map(|f| {
            let angle = 0.05 * f as f64;
            let touch = [0.5 * centre * angle.cos(), 0.5 * centre * angle.sin()];
            let near = |p: &[f64; 2]| (p[0] - touch[0]).hypot(p[1] - touch[1]) < 2.5;
            let image: Array1<f64> = pixels.iter().map(|p| f64::from(near(p))).collect();
            let mut dv = jacobian.dot(&image).to_vec();
            for value in &mut dv {
                let normal = random.normal();
                *value += noise * normal;
            }
            dv
        })
        .collect();
    Setup { gradient: Gradient::pixels(&mask, 1.0).unwrap(), jacobian, frames }
}

fn settings(noise: f64) -> StTvSettings {
    StTvSettings {
        lambda_space: 1.0,
        lambda_time: 0.0,
        noise_std: Some(vec![noise; MEASUREMENTS]),
        ..Default::default()
    }
}

const NOISE: f64 = 0.02;
const GAP: f64 = 1e-2;

fn stream_of(solver: &StTv) -> CausalStream {
    let settings = CausalSettings { target_gap: GAP, ..Default::default() };
    CausalStream::new(solver.clone(), settings).unwrap()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let difference: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    norm(&difference) / norm(b)
}

#[test]
fn equals_the_batch_solution_of_the_frame_to_the_gap() {
    let scene = scene(30, NOISE);
    let delta = (MEASUREMENTS as f64).sqrt() * 1.2;
    let forms = [
        (Fidelity::Penalised, f64::NEG_INFINITY),
        (Fidelity::Penalised, 0.0),
        (Fidelity::Constrained { delta }, f64::NEG_INFINITY),
    ];
    for (fidelity, lower_s) in forms {
        let settings = StTvSettings { fidelity, lower_s, ..settings(NOISE) };
        let solver = StTv::new(&scene.jacobian, &scene.gradient, settings).unwrap();
        let mut stream = stream_of(&solver);
        for (f, dv) in scene.frames.iter().enumerate() {
            let step = stream.push(dv, None).unwrap();
            assert_eq!(step.status, SequenceStatus::Converged, "frame {f}: {:?}", step.certificate);
            assert!(step.certificate.relative_gap() <= GAP, "frame {f}");
            let own = step.certificate;
            if f % 6 != 0 {
                continue;
            }
            let values = Array2::from_shape_fn((1, MEASUREMENTS), |(_, i)| dv[i]);
            let stop = Stop { target_gap: 1e-4, ..Default::default() };
            let batch = solver.solve(&DifferenceFrames::all_good(values.view()), &stop).unwrap();
            let optimum = batch.report.certificate.unwrap();
            // both are certified, so the intervals overlap, up to the rounding of f64
            assert!(own.lower_bound <= optimum.primal * (1.0 + 1e-9), "frame {f}");
            assert!(optimum.lower_bound <= own.primal * (1.0 + 1e-9), "frame {f}");
            // the stream's objective is within its own gap of the optimum
            assert!(own.primal <= optimum.primal * (1.0 + 1.1 * GAP), "frame {f}");
        }
    }
}

#[test]
fn allocates_nothing_after_set_up() {
    let scene = scene(24, NOISE);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings(NOISE)).unwrap();
    let mut stream = stream_of(&solver);
    let lost: Vec<bool> = (0..MEASUREMENTS).map(|i| i != 3 && i != 17).collect();
    let counted = allocation_counter::measure(|| {
        for (f, dv) in scene.frames.iter().enumerate() {
            black_box(match f {
                7 => stream.push_dropped(),
                // a new set of masked channels, twice, then all channels again
                9 | 10 | 15 => stream.push(dv, Some(&lost)).unwrap(),
                _ => stream.push(dv, None).unwrap(),
            });
        }
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
    // the counter does count allocations
    assert!(allocation_counter::measure(|| drop(black_box(vec![0_u8; 100]))).count_total > 0);
}

#[test]
fn a_lost_electrode_changes_the_data_not_the_sanity_of_the_image() {
    let scene = scene(30, NOISE);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings(NOISE)).unwrap();
    let (mut whole, mut part) = (stream_of(&solver), stream_of(&solver));
    // from frame 12 on a sixth of the channels is lost and delivers invalid values
    let good: Vec<bool> = (0..MEASUREMENTS).map(|i| i % 6 != 0).collect();
    for (f, dv) in scene.frames.iter().enumerate() {
        let wanted = whole.push(dv, None).unwrap().image;
        let value = |(dv, good): (&f64, &bool)| if *good { *dv } else { f64::NAN };
        let damaged: Vec<f64> = dv.iter().zip(&good).map(value).collect();
        let found = match f < 12 {
            true => part.push(dv, None).unwrap().image,
            false => part.push(&damaged, Some(&good)).unwrap().image,
        };
        assert!(found.iter().all(|v| v.is_finite()), "image {f}");
        let most = if f < 12 { 0.0 } else { 0.5 };
        assert!(distance(found, wanted) <= most, "image {f}: {}", distance(found, wanted));
    }
}

#[test]
fn bad_input_is_refused_and_leaves_the_stream() {
    let mut scene = scene(14, NOISE);
    // a duplicate measurement
    let twin = scene.jacobian.row(MEASUREMENTS - 2).to_owned();
    scene.jacobian.row_mut(MEASUREMENTS - 1).assign(&twin);
    scene.frames.iter_mut().for_each(|dv| dv[MEASUREMENTS - 1] = dv[MEASUREMENTS - 2]);
    let fidelity = Fidelity::Constrained { delta: (MEASUREMENTS as f64).sqrt() * 1.2 };
    let settings = StTvSettings { fidelity, ..settings(NOISE) };
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings).unwrap();
    let (mut clean, mut tried) = (stream_of(&solver), stream_of(&solver));
    let mask: Vec<bool> = (0..MEASUREMENTS).map(|i| i != 7).collect();
    for (f, dv) in scene.frames.iter().enumerate() {
        let mut bad = dv.clone();
        bad[7] = f64::NAN;
        if f == 7 {
            let refused = tried.push(&bad, None).unwrap_err();
            let wanted =
                matches!(refused, InverseError::NonFiniteData { frame: 7, measurement: 7, .. });
            assert!(wanted, "{refused}");
            assert!(tried.push(&bad[1..], None).is_err());
            assert!(tried.push(dv, Some(&[true])).is_err());
            // a difference of 100 between two duplicates puts each 50 standard deviations off
            let mut contradiction = dv.clone();
            contradiction[MEASUREMENTS - 1] += 100.0 * NOISE;
            let refused = tried.push(&contradiction, None).unwrap_err();
            assert!(matches!(refused, InverseError::DeltaTooSmall { frame: 7, .. }), "{refused}");
        }
        // if masked, the same value is never read
        let (values, good) = if f == 9 { (&bad, Some(&mask[..])) } else { (dv, None) };
        let wanted = clean.push(values, good).unwrap().image;
        assert_eq!(tried.push(values, good).unwrap().image, wanted, "frame {f}");
    }
    let fine = CausalSettings::default();
    for wrong in [
        CausalSettings { target_gap: 0.0, ..fine },
        CausalSettings { target_gap: f64::NAN, ..fine },
        CausalSettings { max_iterations: 0, ..fine },
    ] {
        assert!(CausalStream::new(solver.clone(), wrong).is_err(), "{wrong:?}");
    }
}

#[test]
fn a_first_frame_next_to_nothing_does_not_spoil_the_rest() {
    let scene = scene(12, NOISE);
    for noise_std in [None, Some(vec![NOISE; MEASUREMENTS])] {
        let settings = StTvSettings { noise_std, ..settings(NOISE) };
        let solver = StTv::new(&scene.jacobian, &scene.gradient, settings).unwrap();
        let mut stream = stream_of(&solver);
        let rounding: Vec<f64> = scene.frames[0].iter().map(|dv| 1e-16 * dv).collect();
        let _ = stream.push(&rounding, None).unwrap();
        for (f, dv) in scene.frames.iter().enumerate() {
            let step = stream.push(dv, None).unwrap();
            assert_eq!(step.status, SequenceStatus::Converged, "frame {f}: {:?}", step.certificate);
        }
    }
}

/// Noise, frames equal to the reference and dropped frames cost nothing; what follows is solved as by a new
/// stream. Without `noise_std` only data of zero is quiet.
#[test]
fn quiet_frames_cost_nothing() {
    let scene = scene(6, NOISE);
    let zero = vec![0.0; MEASUREMENTS];
    let mut random = Random::new(3);
    for noise_std in [None, Some(vec![NOISE; MEASUREMENTS])] {
        let is_noise_known = noise_std.is_some();
        let settings = StTvSettings { noise_std, ..settings(NOISE) };
        let solver = StTv::new(&scene.jacobian, &scene.gradient, settings).unwrap();
        let mut stream = stream_of(&solver);
        for dv in &scene.frames[..3] {
            let step = stream.push(dv, None).unwrap();
            assert!(!step.quiet && step.iterations > 0);
        }
        for f in 0..10 {
            let noise: Vec<f64> = (0..MEASUREMENTS).map(|_| NOISE * random.normal()).collect();
            let step = match f {
                5 => stream.push_dropped(),
                6.. if is_noise_known => stream.push(&noise, None).unwrap(),
                _ => stream.push(&zero, None).unwrap(),
            };
            assert!(step.quiet && step.iterations == 0, "frame {f}");
            assert!(step.image.iter().all(|x| *x == 0.0), "frame {f}");
            if f < 6 {
                assert_eq!((step.certificate.primal, step.residual), (0.0, 0.0));
            }
        }
        // a stream that was at rest and a new stream solve the same problems
        let mut fresh = stream_of(&solver);
        for dv in &scene.frames[3..] {
            let [rested, new] = [&mut stream, &mut fresh].map(|stream| {
                let step = stream.push(dv, None).unwrap();
                assert_eq!(step.status, SequenceStatus::Converged);
                step.certificate
            });
            // both are certified, so the intervals of the optimum overlap
            assert!(rested.lower_bound <= new.primal * (1.0 + 1e-9));
            assert!(new.lower_bound <= rested.primal * (1.0 + 1e-9));
        }
    }
}
