//! Sliding window: agreement with a batch solve of the window, no allocation, and all events of a
//! running instrument.
//!
//! Over 300 lines because every event is tested on the same scene.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, reason = "tests")]

use eit_inverse::{
    DifferenceFrames, Fidelity, Gradient, InverseError, SequenceStatus, StTv, StTvSettings,
    StTvStream, Stop, StreamSettings,
};
use fixtures::Random;
use ndarray::{Array1, Array2};
use std::hint::black_box;

const SIDE: usize = 14;
const MEASUREMENTS: usize = 40;

/// A smooth random Jacobian on a disc of pixels, and noisy frames of a moving touch.
struct Scene {
    jacobian: Array2<f64>,
    gradient: Gradient,
    frames: Vec<Vec<f64>>,
}

fn scene(count: usize, noise: f64) -> Scene {
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
    Scene { gradient: Gradient::pixels(&mask, 1.0).unwrap(), jacobian, frames }
}

fn settings(noise: f64) -> StTvSettings {
    StTvSettings {
        lambda_space: 1.0,
        lambda_time: 1.0,
        noise_std: Some(vec![noise; MEASUREMENTS]),
        ..Default::default()
    }
}

const NOISE: f64 = 0.02;
const GAP: f64 = 1e-2;

fn stream_of(solver: &StTv, window: usize, lag: usize) -> StTvStream {
    let settings = StreamSettings { window, lag, target_gap: GAP, ..Default::default() };
    StTvStream::new(solver.clone(), settings).unwrap()
}

#[test]
fn equals_the_batch_solution_of_the_window_to_the_gap() {
    let scene = scene(30, NOISE);
    let forms =
        [Fidelity::Penalised, Fidelity::Constrained { delta: (MEASUREMENTS as f64).sqrt() * 1.2 }];
    for fidelity in forms {
        let settings = StTvSettings { fidelity, ..settings(NOISE) };
        let solver = StTv::new(&scene.jacobian, &scene.gradient, settings).unwrap();
        let (window, lag) = (6, 2);
        let mut stream = stream_of(&solver, window, lag);
        for (f, dv) in scene.frames.iter().enumerate() {
            let step = stream.push(dv, None).unwrap();
            assert_eq!(step.status, SequenceStatus::Converged, "frame {f}: {:?}", step.certificate);
            assert!(step.certificate.relative_gap() <= GAP, "frame {f}");
            assert_eq!(step.image.is_some(), f >= lag, "frame {f}");
            let own = step.certificate;
            if f + 1 < window || f % 6 != 0 {
                continue;
            }
            let values = Array2::from_shape_fn((window, MEASUREMENTS), |(k, i)| {
                scene.frames[f + 1 - window + k][i]
            });
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
    let mut stream = stream_of(&solver, 5, 1);
    let mut lost = vec![true; MEASUREMENTS];
    lost[3] = false;
    lost[17] = false;
    let change = vec![1e-3; MEASUREMENTS];
    let counted = allocation_counter::measure(|| {
        for (f, dv) in scene.frames.iter().enumerate() {
            match f {
                7 => {
                    black_box(stream.push_dropped());
                }
                // a new set of masked channels, twice, then all channels again
                9 | 10 | 15 => {
                    black_box(stream.push(dv, Some(&lost)).unwrap());
                }
                12 => {
                    stream.change_reference(&change).unwrap();
                    {
                        black_box(stream.push(dv, None).unwrap());
                    };
                }
                _ => {
                    black_box(stream.push(dv, None).unwrap());
                }
            }
        }
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
    // the counter does count allocations
    assert!(allocation_counter::measure(|| drop(black_box(vec![0_u8; 100]))).count_total > 0);
}

/// Difference data with its good channels; `None`: all.
#[derive(Clone)]
struct MaskedFrame {
    dv: Vec<f64>,
    good: Option<Vec<bool>>,
}

/// Images of every lagged frame of a sequence.
fn images(solver: &StTv, frames: &[MaskedFrame]) -> Vec<Vec<f64>> {
    let mut stream = stream_of(solver, 6, 2);
    let mut out = Vec::new();
    for MaskedFrame { dv, good } in frames {
        let step = stream.push(dv, good.as_deref()).unwrap();
        out.extend(step.image.map(<[f64]>::to_vec));
    }
    out
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let difference: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    norm(&difference) / norm(b)
}

#[test]
fn a_lost_electrode_changes_the_data_not_the_sanity_of_the_image() {
    let scene = scene(30, NOISE);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings(NOISE)).unwrap();
    let whole_frame = |dv: &Vec<f64>| MaskedFrame { dv: dv.clone(), good: None };
    let clean: Vec<MaskedFrame> = scene.frames.iter().map(whole_frame).collect();
    // from frame 12 on a sixth of the channels is lost and delivers invalid values
    let mut damaged = clean.clone();
    let good: Vec<bool> = (0..MEASUREMENTS).map(|i| i % 6 != 0).collect();
    for frame in damaged.iter_mut().skip(12) {
        for (value, good) in frame.dv.iter_mut().zip(&good) {
            if !good {
                *value = f64::NAN;
            }
        }
        frame.good = Some(good.clone());
    }
    let (whole, part) = (images(&solver, &clean), images(&solver, &damaged));
    for (f, (a, b)) in part.iter().zip(&whole).enumerate() {
        assert!(a.iter().all(|v| v.is_finite()), "image {f}");
        // before the loss enters the window both are equal; later the measured difference is at most 0.33
        let most = if f + 2 < 12 { 0.0 } else { 0.5 };
        assert!(distance(a, b) <= most, "image {f}: {}", distance(a, b));
    }
}

#[test]
fn a_dropped_frame_is_interpolated() {
    let scene = scene(16, NOISE);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings(NOISE)).unwrap();
    let mut stream = stream_of(&solver, 6, 2);
    for (f, dv) in scene.frames.iter().enumerate() {
        let step = match f {
            10 => stream.push_dropped(),
            _ => stream.push(dv, None).unwrap(),
        };
        assert_eq!(step.status, SequenceStatus::Converged, "frame {f}: {:?}", step.certificate);
        if f == 12 {
            assert_eq!(step.residual, 0.0, "a frame without data has no residual");
            let image = step.image.unwrap();
            assert!(image.iter().any(|v| v.abs() > 0.2), "the touch is still visible");
        }
    }
}

#[test]
fn another_reference_moves_the_images() {
    let scene = scene(40, NOISE);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings(NOISE)).unwrap();
    let mut stream = stream_of(&solver, 4, 0);
    for dv in scene.frames.iter().take(20) {
        stream.push(dv, None).unwrap();
    }
    // frame 19 becomes the reference, so the image of the same frame becomes zero
    let reference = scene.frames[19].clone();
    stream.change_reference(&reference).unwrap();
    let zero = vec![0.0; MEASUREMENTS];
    let mut last = None;
    for _ in 0..4 {
        last = stream.push(&zero, None).unwrap().image.map(<[f64]>::to_vec);
    }
    let size = last.unwrap().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    assert!(size < 0.05, "largest value {size} of a touch of 1");
}

#[test]
fn quiet_windows_cost_nothing() {
    let scene = scene(10, NOISE);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings(NOISE)).unwrap();
    let mut stream = stream_of(&solver, 4, 1);
    let mut random = Random::new(3);
    for f in 0..6 {
        let dv: Vec<f64> = (0..MEASUREMENTS).map(|_| NOISE * random.normal()).collect();
        let step = stream.push(&dv, None).unwrap();
        assert!(step.quiet && step.iterations == 0, "frame {f}");
        assert!(step.image.is_none_or(|image| image.iter().all(|v| *v == 0.0)));
    }
    let step = stream.push(&scene.frames[0], None).unwrap();
    assert!(!step.quiet && step.iterations > 0);
}

#[test]
fn bad_input_is_refused_and_leaves_the_window() {
    let scene = scene(8, NOISE);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings(NOISE)).unwrap();
    let mut stream = stream_of(&solver, 4, 1);
    let mut twin = stream_of(&solver, 4, 1);
    for dv in &scene.frames[..5] {
        stream.push(dv, None).unwrap();
        twin.push(dv, None).unwrap();
    }
    let mut bad = scene.frames[5].clone();
    bad[7] = f64::NAN;
    let error = stream.push(&bad, None).unwrap_err();
    let wanted = matches!(error, InverseError::NonFiniteData { frame: 5, measurement: 7, .. });
    assert!(wanted, "{error}");
    assert!(stream.push(&bad[1..], None).is_err());
    assert!(stream.push(&scene.frames[5], Some(&[true])).is_err());
    assert!(stream.change_reference(&bad).is_err());
    let good = |i: usize| i != 7;
    let mask: Vec<bool> = (0..MEASUREMENTS).map(good).collect();
    // if masked, the same value is never read
    stream.push(&bad, Some(&mask)).unwrap();
    twin.push(&bad, Some(&mask)).unwrap();
    let pixels = solver.unknowns();
    assert!((0..pixels).all(|p| stream.window_image(0, p) == twin.window_image(0, p)));
}

#[test]
fn settings_out_of_range_are_refused() {
    let scene = scene(1, NOISE);
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings(NOISE)).unwrap();
    let fine = StreamSettings::default();
    for wrong in [
        StreamSettings { window: 0, lag: 0, ..fine },
        StreamSettings { window: 4, lag: 4, ..fine },
        StreamSettings { target_gap: 0.0, ..fine },
        StreamSettings { target_gap: f64::NAN, ..fine },
        StreamSettings { max_iterations: 0, ..fine },
    ] {
        assert!(StTvStream::new(solver.clone(), wrong).is_err(), "{wrong:?}");
    }
}

#[test]
fn a_frame_that_no_image_can_fit_leaves_the_window_as_it_was() {
    let mut scene = scene(14, NOISE);
    // a duplicate measurement
    let twin = scene.jacobian.row(MEASUREMENTS - 2).to_owned();
    scene.jacobian.row_mut(MEASUREMENTS - 1).assign(&twin);
    scene.frames.iter_mut().for_each(|dv| dv[MEASUREMENTS - 1] = dv[MEASUREMENTS - 2]);
    let fidelity = Fidelity::Constrained { delta: (MEASUREMENTS as f64).sqrt() * 1.2 };
    let settings = StTvSettings { fidelity, ..settings(NOISE) };
    let solver = StTv::new(&scene.jacobian, &scene.gradient, settings).unwrap();
    let mut contradiction = scene.frames[7].clone();
    contradiction[MEASUREMENTS - 1] += 100.0 * NOISE;
    let mut change = vec![0.0; MEASUREMENTS];
    change[MEASUREMENTS - 1] = 100.0 * NOISE;
    let (mut clean, mut tried) = (stream_of(&solver, 6, 2), stream_of(&solver, 6, 2));
    for (f, dv) in scene.frames.iter().enumerate() {
        if f == 7 {
            // a difference of 100 between two duplicates puts each 50 standard deviations off
            let refused = tried.push(&contradiction, None).unwrap_err();
            assert!(matches!(refused, InverseError::DeltaTooSmall { frame: 7, .. }), "{refused}");
            let refused = tried.change_reference(&change).unwrap_err();
            assert!(matches!(refused, InverseError::DeltaTooSmall { .. }), "{refused}");
        }
        let wanted = clean.push(dv, None).unwrap().image.map(<[f64]>::to_vec);
        let found = tried.push(dv, None).unwrap().image.map(<[f64]>::to_vec);
        match (found, wanted) {
            // the data was changed and restored; the rounding error is amplified by the f32 iterations
            (Some(found), Some(wanted)) => assert!(distance(&found, &wanted) < 1e-3, "frame {f}"),
            (found, wanted) => assert_eq!(found, wanted, "frame {f}"),
        }
    }
}

#[test]
fn a_first_frame_next_to_nothing_does_not_spoil_the_rest() {
    let scene = scene(12, NOISE);
    for noise_std in [None, Some(vec![NOISE; MEASUREMENTS])] {
        let settings = StTvSettings { noise_std, ..settings(NOISE) };
        let solver = StTv::new(&scene.jacobian, &scene.gradient, settings).unwrap();
        let mut stream = stream_of(&solver, 4, 0);
        let rounding: Vec<f64> = scene.frames[0].iter().map(|dv| 1e-16 * dv).collect();
        let _ = stream.push(&rounding, None).unwrap();
        for (f, dv) in scene.frames.iter().enumerate() {
            let step = stream.push(dv, None).unwrap();
            assert_eq!(step.status, SequenceStatus::Converged, "frame {f}: {:?}", step.certificate);
        }
    }
}

/// Frames equal to the reference; without `noise_std` only these are quiet. They are treated as data while
/// the window contains a touch, and cost nothing afterwards. Later results are the same as if they had been
/// solved.
#[test]
fn frames_that_equal_the_reference_cost_nothing_once_the_window_holds_no_other() {
    let scene = scene(6, NOISE);
    let zero = vec![0.0; MEASUREMENTS];
    for noise_std in [None, Some(vec![NOISE; MEASUREMENTS])] {
        let settings = StTvSettings { noise_std, ..settings(NOISE) };
        let solver = StTv::new(&scene.jacobian, &scene.gradient, settings).unwrap();
        let window = 4;
        let mut stream = stream_of(&solver, window, 0);
        for dv in &scene.frames[..3] {
            assert!(!stream.push(dv, None).unwrap().quiet);
        }
        for f in 0..10 {
            let step = stream.push(&zero, None).unwrap();
            // the touched frames leave the window one by one
            assert_eq!(step.quiet, f + 1 >= window, "zero frame {f}");
            assert_eq!(step.iterations == 0, step.quiet);
            if step.quiet {
                assert!(step.image.unwrap().iter().all(|x| *x == 0.0), "zero frame {f}");
                assert_eq!((step.certificate.primal, step.residual), (0.0, 0.0));
                assert_eq!(stream.window_image(window - 1, 5), Some(0.0));
            }
        }
        // a stream that was at rest and a new stream solve the same problems
        let mut fresh = stream_of(&solver, window, 0);
        for _ in 0..window {
            assert!(fresh.push(&zero, None).unwrap().quiet);
        }
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
