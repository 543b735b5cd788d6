//! Touches on a dome with an uneven sheet, on forward solutions of the full non-linear model of another mesh.

use crate::common::*;
use eit_core::vector::{distance, dot, nearest, norm, scaled};
use eit_skin::eit_fem::fabric::Random;
use eit_skin::ndarray::Array2;
use eit_skin::scene::Scene;
use eit_skin::{Skin, Touch};
use std::f64::consts::TAU;

type Place = [f64; 3];

const RADIUS_M: f64 = 0.1;
/// Number of frames of a press, and of the rest after it.
const PRESS: usize = 8;
const PRESSES: usize = 16;

/// A position on the dome (rim at z = 0), at least 5 mm from the rim.
fn place(random: &mut Random) -> Place {
    // uniform in height, and therefore on the sphere
    let z = RADIUS_M * (0.05 + 0.95 * random.uniform());
    let [x, y] = polar((RADIUS_M * RADIUS_M - z * z).sqrt(), TAU * random.uniform());
    [x, y, z]
}

/// `ln sigma` of a sheet uneven by 5 %: waves in space, of 2 cm correlation length.
fn unevenness(random: &mut Random) -> impl Fn(&Place) -> f64 + use<> {
    let mut wave = || ([0; 3].map(|_| random.normal() / 0.02), TAU * random.uniform());
    let waves: Vec<(Place, f64)> = (0..300).map(|_| wave()).collect();
    move |p| {
        let sum: f64 = waves.iter().map(|(wave, phase)| (dot(*wave, *p) + phase).cos()).sum();
        0.05 * (2.0 / 300.0_f64).sqrt() * sum
    }
}

/// Nothing is shown where no finger is, by 25 mm or four of its own deviations; the mesh has edges of 6 mm.
#[test]
fn touches_on_a_dome() {
    let mut random = Random::new(21);
    let skin = meshed(&Scene::load("hemisphere").unwrap(), 4000);
    let (centroids, field) = (skin.mesh.surface().centroids(), unevenness(&mut random));
    let sheet_s: Vec<_> = centroids.iter().map(|c| skin.conductivity_s * field(c).exp()).collect();
    // each finger raises the conductivity by 30 % in a bell of 8 mm
    let voltages = |fingers: &[Place]| {
        let touched = |(c, sheet_s): (&Place, &f64)| {
            let bell = |at: &Place| 0.3 * (-(distance(*c, *at) / 8e-3).powi(2)).exp();
            sheet_s * (1.0 + fingers.iter().map(bell).sum::<f64>())
        };
        let conductivity_s: Vec<f64> = centroids.iter().zip(&sheet_s).map(touched).collect();
        skin.model.forward(&conductivity_s).unwrap().to_vec()
    };
    let untouched = voltages(&[]);
    let largest = untouched.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    // noise 80 dB below the largest voltage, 16 bits
    let step = 2.0 * 1.25 * largest / 65536.0;
    let (mut rows, mut truth) = (Vec::new(), Vec::new());
    let mut add = |fingers: &[Place], frames: usize, random: &mut Random| {
        let voltages = voltages(fingers);
        for _ in 0..frames {
            let read = |v: &f64| ((v + 1e-4 * largest * random.normal()) / step).round() * step;
            rows.extend(voltages.iter().map(read));
            truth.push(fingers.to_vec());
        }
    };
    add(&[], QUIET_FRAMES, &mut random);
    for press in 0..PRESSES {
        let mut fingers = vec![place(&mut random)];
        // every second press has two fingers
        while press % 2 == 1 && fingers.len() < 2 {
            let other = place(&mut random);
            if distance(fingers[0], other) > 0.05 {
                fingers.push(other);
            }
        }
        add(&fingers, PRESS, &mut random);
        add(&[], PRESS, &mut random);
    }
    let values = Array2::from_shape_vec((truth.len(), untouched.len()), rows).unwrap();
    let found = touches_of(&fit(&quiet_first(Skin::load("hemisphere").unwrap()), &values));
    assert_eq!(found.choices.sheet.as_ref().unwrap().amplitude, 0.05);

    let (mut all, mut extra, mut errors_m) = (0, 0, Vec::new());
    let mut least_outward = f64::INFINITY;
    for (frame, fingers) in truth.iter().enumerate() {
        let here = acted_on(&found, frame);
        all += fingers.len();
        for finger in fingers {
            let places_m = here.iter().map(|touch| touch.position_m);
            let Some((k, error_m)) = nearest(places_m, *finger) else { continue };
            if error_m < 0.025 {
                errors_m.push(error_m);
                let Touch { normal, position_m, .. } = here[k];
                let outward = dot(normal.unwrap(), scaled(1.0 / RADIUS_M, position_m));
                least_outward = least_outward.min(outward);
            }
        }
        // where the top hardly shows in the voltages, the touch states a larger uncertainty
        let is_of = |touch: &Touch, finger: &Place| {
            let std_m = norm(touch.position_std_m());
            distance(touch.position_m, *finger) < (4.0 * std_m).max(0.025)
        };
        let invented = |touch: &&Touch| !fingers.iter().any(|finger| is_of(touch, finger));
        extra += here.len().saturating_sub(fingers.len()) + here.iter().filter(invented).count();
        // on the skin, up to the error of its edges' chords
        let is_on = |touch: &Touch| (norm(touch.position_m) - RADIUS_M).abs() < 1e-3;
        assert!(here.iter().all(is_on), "frame {frame}: {here:?}");
    }
    let (median_m, most_m) = (median(&errors_m), eit_core::quantile(&errors_m, 0.95).unwrap());
    let (part, turned) = (errors_m.len() as f64 / all as f64, least_outward.acos());
    println!("{part:.3}, {median_m:.4} m, 95 % {most_m:.4} m, extra {extra}, {turned:.3} rad");
    // triangles are tilted by 2 to 4 degrees; the filter moves the position by some mm, 1 degree per 1.7 mm
    assert!(turned < 7.0_f64.to_radians(), "{turned}");
    // 1.000, 0.9 and 5.4 mm were measured
    assert!(part >= 0.98 && median_m < 2e-3 && most_m < 6e-3 && extra == 0);
}
