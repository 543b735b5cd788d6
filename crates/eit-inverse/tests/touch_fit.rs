//! Bells fitted to frames of a finer mesh, against the Cramer-Rao bound.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test file: a panic is a failed test"
)]

mod common;

use common::Random;
use eit_fem::{DrivenElectrodes, ForwardModel, Order, PairPattern, PairProtocol};
use eit_inverse::InverseError;
use eit_inverse::touch::{Bell, FitSettings, FitStatus, Nuisance, TouchFit, cramer_rao};
use eit_mesh::{Mesh, MeshSettings, RimElectrodes, SkinShape, generate};

const RADIUS_M: f64 = 0.1;
const SHEET_S: f64 = 1e-5;

/// The built-in skin: 16 electrodes of 19.6 mm, adjacent drive and measurement, 208 values.
fn skin(edge_m: f64) -> (Mesh, ForwardModel) {
    let shape = SkinShape::Disc { radius_m: RADIUS_M };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let mesh = generate(&shape, &electrodes, &MeshSettings::with_edge(edge_m)).unwrap();
    let protocol = PairProtocol {
        electrodes: 16,
        drive: PairPattern::Adjacent,
        measure: PairPattern::Adjacent,
        driven_electrodes: DrivenElectrodes::Drop,
        order: Order::Rotated,
        current_a: 1e-4,
    };
    let model = ForwardModel::new(&mesh, &protocol.protocol().unwrap(), &[1e3; 16]).unwrap();
    (mesh, model)
}

fn background(model: &ForwardModel) -> Vec<f64> {
    vec![SHEET_S; model.elements()]
}

fn bell(x: f64) -> Bell {
    // off the axis: no symmetry of the electrodes helps
    Bell { position_m: [x, 0.1 * x, 0.0], amplitude: 0.3, radius_m: 0.01 }
}

/// Noise of `decibel` below the root mean square of the reference voltages.
fn noise_v(reference: &[f64], decibel: f64) -> f64 {
    let square = reference.iter().map(|v| v * v).sum::<f64>() / reference.len() as f64;
    square.sqrt() * 10.0_f64.powf(-decibel / 20.0)
}

fn settings(reference: &[f64], decibel: f64) -> FitSettings {
    FitSettings::with_noise(vec![noise_v(reference, decibel); reference.len()])
}

/// Frames of a skin with touches.
fn frame(mesh: &Mesh, model: &ForwardModel, bells: &[Bell]) -> Vec<f64> {
    let sigma: Vec<f64> = mesh
        .surface()
        .centroids()
        .iter()
        .map(|p| {
            let of = |b: &Bell| {
                let d = (p[0] - b.position_m[0]).powi(2) + (p[1] - b.position_m[1]).powi(2);
                b.amplitude * (-0.5 * d / b.radius_m.powi(2)).exp()
            };
            SHEET_S * (1.0 + bells.iter().map(of).sum::<f64>())
        })
        .collect();
    model.forward(&sigma).unwrap().to_vec()
}

fn noisy(frame: &[f64], std: f64, random: &mut Random) -> Vec<f64> {
    frame.iter().map(|v| v + std * random.normal()).collect()
}

fn distance_m(a: &Bell, b: &Bell) -> f64 {
    (a.position_m[0] - b.position_m[0]).hypot(a.position_m[1] - b.position_m[1])
}

/// Taylor test: the remainder of the linear model falls with the square of the step.
#[test]
fn derivatives_leave_a_quadratic_remainder() {
    let (mesh, model) = skin(0.008);
    let reference = model.forward(&background(&model)).unwrap().to_vec();
    let sheet = background(&model);
    let mut fit =
        TouchFit::new(&model, mesh.surface(), &sheet, settings(&reference, 60.0)).unwrap();
    let bells =
        [bell(0.04), Bell { position_m: [-0.03, 0.02, 0.0], amplitude: -0.2, radius_m: 0.015 }];
    let slopes = fit.derivatives(&bells).unwrap();
    let at = fit.differences(&bells).unwrap();
    for parameter in 0..slopes.ncols() {
        let (k, which) = (parameter / 4, parameter % 4);
        let unit = [1e-3, 1e-3, 0.05, 0.05][which];
        let remainder = |h: f64| {
            let mut moved = bells;
            match which {
                0 | 1 => moved[k].position_m[which] += h,
                2 => moved[k].amplitude += h,
                _ => moved[k].radius_m *= h.exp(),
            }
            let there = fit.differences(&moved).unwrap();
            let rest = |i: usize| there[i] - at[i] - h * slopes[(i, parameter)];
            (0..at.len()).map(|i| rest(i).powi(2)).sum::<f64>().sqrt()
        };
        let (mut remainder, linear) =
            (remainder, slopes.column(parameter).mapv(|x| x * x).sum().sqrt());
        let (whole, half) = (remainder(unit), remainder(0.5 * unit));
        // 4 for an exact derivative; a wrong one by 1 % of the slope would give 2 to 3.5
        assert!((whole / half - 4.0).abs() < 0.4, "parameter {parameter}: {}", whole / half);
        assert!(whole < 0.2 * linear * unit, "parameter {parameter}");
    }
}

/// Bounds of the paper's skin: 0.62 mm in the centre, 0.28 mm at half the radius, 0.07 mm near the
/// rim at 60 dB, by an independent calculation with the same noise (each difference has 1e-3 of the
/// root mean square of the reference voltages).
#[test]
fn bound_of_the_paper_disc() {
    let (mesh, model) = skin(0.004);
    let reference = model.forward(&background(&model)).unwrap().to_vec();
    let sheet = background(&model);
    for nuisance in [Nuisance::Known, Nuisance::Amplitude, Nuisance::AmplitudeAndRadius] {
        let mut line = String::new();
        for x in [0.0, 0.05, 0.08, 0.085, 0.09] {
            let touch = [Bell { position_m: [x, 0.0, 0.0], amplitude: 0.3, radius_m: 0.01 }];
            let bound = cramer_rao(
                &model,
                mesh.surface(),
                &sheet,
                settings(&reference, 60.0),
                (&touch, nuisance),
            )
            .unwrap()[0];
            let c = bound.position_covariance_m2;
            line += &format!(
                " {x}: {:.3} ({:.3} {:.3}) a {:.4} r {:.3};",
                1e3 * bound.position_std_m,
                1e3 * c[0][0].sqrt(),
                1e3 * c[1][1].sqrt(),
                bound.amplitude_std,
                1e3 * bound.radius_std_m
            );
        }
        println!("{nuisance:?}{line}");
    }
}

/// Root mean square and median distance errors of the fit against the bound, on data of another,
/// finer mesh.
#[test]
fn fit_reaches_the_bound() {
    let (fine_mesh, fine) = skin(0.0025);
    let (mesh, model) = skin(0.005);
    println!("{} {}", fine.elements(), model.elements());
    let reference = fine.forward(&background(&fine)).unwrap().to_vec();
    let sheet = background(&model);
    let mut random = Random(5);
    for x in [0.002, 0.05, 0.08] {
        let truth = bell(x);
        let clean = frame(&fine_mesh, &fine, &[truth]);
        for (decibel, trials) in [(40.0, 25), (50.0, 25), (60.0, 25)] {
            let std = noise_v(&reference, decibel);
            let mut fit =
                TouchFit::new(&model, mesh.surface(), &sheet, settings(&reference, decibel))
                    .unwrap();
            let bound = fit.bound(&[truth], Nuisance::AmplitudeAndRadius).unwrap()[0];
            let start = Bell {
                position_m: [x + 0.006, 0.1 * x - 0.006, 0.0],
                amplitude: 0.2,
                radius_m: 0.012,
            };
            let exact = fit.fit(&clean, &reference, &[start]).unwrap();
            let mut squares = Vec::new();
            let (mut chi, mut seconds, mut solves) = (0.0, 0.0, 0);
            for _ in 0..trials {
                let data = noisy(&clean, std, &mut random);
                let result = fit.fit(&data, &reference, &[start]).unwrap();
                if result.status != FitStatus::Converged {
                    println!("  {:?} {}", result.status, result.iterations);
                }
                chi += result.reduced_chi_square() / trials as f64;
                seconds += result.seconds / trials as f64;
                solves += result.forward_solves;
                squares.push(distance_m(&result.touches[0].bell, &truth).powi(2));
            }
            squares.sort_by(f64::total_cmp);
            let rms = (squares.iter().sum::<f64>() / trials as f64).sqrt();
            println!(
                "{x} {decibel} dB: rms {:.3} median {:.3} mm, bound {:.3} mm (ratio {:.2}), mesh {:.3} mm, chi {chi:.2}, {:.1} ms, {:.1} solves",
                1e3 * rms,
                1e3 * squares[trials / 2].sqrt(),
                1e3 * bound.position_std_m * 2f64.sqrt(),
                rms / bound.position_std_m / 2f64.sqrt(),
                1e3 * distance_m(&exact.touches[0].bell, &truth),
                1e3 * seconds,
                solves as f64 / trials as f64
            );
        }
    }
}

/// As many touches as the data carries: none, one, two, and no more.
#[test]
fn number_of_touches_is_what_the_data_carries() {
    let (fine_mesh, fine) = skin(0.0025);
    let (mesh, model) = skin(0.005);
    let reference = fine.forward(&background(&fine)).unwrap().to_vec();
    let sheet = background(&model);
    let mut fit =
        TouchFit::new(&model, mesh.surface(), &sheet, settings(&reference, 55.0)).unwrap();
    let std = noise_v(&reference, 55.0);
    let mut random = Random(11);
    let start = Bell { position_m: [0.03, 0.0, 0.0], amplitude: 0.3, radius_m: 0.015 };
    let at = |x: f64| Bell { position_m: [x, 0.01, 0.0], amplitude: 0.3, radius_m: 0.01 };
    for (touches, wanted) in [
        (vec![], 0),
        (vec![at(0.04)], 1),
        (vec![at(0.015), at(0.06)], 2),
        // their distance is 0.8 radii: one bell to the data
        (vec![at(0.036), at(0.044)], 1),
    ] {
        let data = noisy(&frame(&fine_mesh, &fine, &touches), std, &mut random);
        // one blob, as an image would show it
        let (found, rejected) = fit.fit_number(&data, &reference, &[start], 4).unwrap();
        println!(
            "{} -> {} chi {:.2}, {:.0} ms; {:?}",
            touches.len(),
            found.touches.len(),
            found.reduced_chi_square(),
            1e3 * found.seconds,
            found.touches.iter().map(|t| t.bell).collect::<Vec<_>>()
        );
        assert_eq!(found.touches.len(), wanted, "{touches:?}");
        // 208 numbers: six standard deviations of reduced chi^2
        assert!((found.reduced_chi_square() - 1.0).abs() < 0.6);
        if wanted == touches.len() {
            for touch in &touches {
                let near = found.touches.iter().map(|t| distance_m(&t.bell, touch));
                // the bound of two touches at 55 dB is below a millimetre
                assert!(near.fold(f64::INFINITY, f64::min) < 4e-3);
            }
            assert!(found.touches.iter().all(|t| t.valid && t.confidence > 0.99));
        }
        assert!(rejected.is_some_and(|more| more.touches.len() == wanted + 1));
    }
}

/// More touches than the data carries: said, not hidden.
#[test]
fn touches_that_are_not_there_are_not_valid() {
    let (mesh, model) = skin(0.006);
    let reference = model.forward(&background(&model)).unwrap().to_vec();
    let sheet = background(&model);
    let mut fit =
        TouchFit::new(&model, mesh.surface(), &sheet, settings(&reference, 40.0)).unwrap();
    let data = noisy(&reference, noise_v(&reference, 40.0), &mut Random(2));
    let result = fit.fit(&data, &reference, &[bell(0.0), bell(0.03)]).unwrap();
    assert!(result.touches.iter().all(|touch| !touch.valid), "{result:?}");
    // two bells in one place: their parameters cannot be told apart, and no panic
    let twins = fit.bound(&[bell(0.03), bell(0.03)], Nuisance::AmplitudeAndRadius).unwrap();
    assert!(twins.iter().all(|bound| bound.position_std_m > 0.1));
}

#[test]
fn bad_input_is_refused_by_name() {
    let (mesh, model) = skin(0.01);
    let sheet = background(&model);
    let reference = model.forward(&sheet).unwrap().to_vec();
    let good = settings(&reference, 60.0);
    let new = |settings: FitSettings| TouchFit::new(&model, mesh.surface(), &sheet, settings).err();
    let mut unknown = good.clone();
    unknown.data.noise_std = None;
    assert!(matches!(new(unknown), Some(InverseError::NoiseUnknown { .. })));
    let mut negative = good.clone();
    negative.data.noise_std.as_mut().unwrap()[7] = -1.0;
    assert!(matches!(
        new(negative),
        Some(InverseError::MeasurementOutOfRange { measurement: 7, .. })
    ));
    for settings in [
        FitSettings { tolerance: f64::NAN, ..good.clone() },
        FitSettings { max_iterations: 0, ..good.clone() },
        FitSettings { radius_range_m: [0.1, 0.01], ..good.clone() },
    ] {
        assert!(matches!(new(settings), Some(InverseError::OutOfRange { .. })));
    }
    let mut fit = TouchFit::new(&model, mesh.surface(), &sheet, good).unwrap();
    let mut broken = reference.clone();
    broken[3] = f64::NAN;
    let nan = fit.fit(&broken, &reference, &[bell(0.0)]);
    assert!(matches!(nan, Err(InverseError::NonFiniteData { measurement: 3, .. })));
    let short = fit.fit(&reference[1..], &reference, &[bell(0.0)]);
    assert!(matches!(short, Err(InverseError::WrongLength { found: 207, wanted: 208, .. })));
    let outside = fit.fit(&reference, &reference, &[bell(0.0), bell(0.15)]);
    assert!(matches!(outside, Err(InverseError::OutsideSkin { touch: 1, .. })));
    let insulator = Bell { amplitude: -1.0, ..bell(0.0) };
    assert!(matches!(
        fit.fit(&reference, &reference, &[insulator]),
        Err(InverseError::OutOfRange { .. })
    ));
    let hole = [Bell { amplitude: -0.6, ..bell(0.0) }; 2];
    assert!(matches!(fit.fit(&reference, &reference, &hole), Err(InverseError::OutOfRange { .. })));
    let many = [bell(0.0); 60];
    assert!(matches!(fit.fit(&reference, &reference, &many), Err(InverseError::OutOfRange { .. })));
}
