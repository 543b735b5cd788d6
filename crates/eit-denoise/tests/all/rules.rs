//! The threshold rule and the symmetry of measurements.

use crate::common::disc;
use crate::says;
use eit_denoise::{DenoiseError, DiscSymmetry, ImageStack, MeasurementOrder, ThresholdRule};
use ndarray::{Array2, Array3, Axis};

/// A finger (5 x 5), a weaker one below the share, a stronger artefact on the rim, a speck.
#[test]
fn the_rule_keeps_the_finger_and_drops_rim_weak_and_small() {
    let mask = disc(64, 64);
    let mut image = Array2::zeros((64, 64));
    let mut square = |row: usize, column: usize, side: usize, value: f64| {
        for r in row..row + side {
            (column..column + side).for_each(|c| image[[r, c]] = value);
        }
    };
    square(30, 30, 5, 2.0);
    square(30, 42, 5, 1.1); // exactly 0.55 of the maximum does not exceed it
    square(40, 20, 3, 2.0); // 9 pixels
    square(31, 0, 4, 9.0);
    square(18, 30, 4, 1.2); // 16 pixels above the share
    let mut rule = ThresholdRule::default().on(mask.view()).unwrap();
    let mut out = Array2::from_elem((64, 64), f64::NAN);
    rule.apply_into(image.view(), out.view_mut()).unwrap();
    let sum = |value: f64| out.iter().filter(|v| **v == value).count();
    assert_eq!([sum(2.0), sum(1.2), sum(0.0)], [25, 16, 64 * 64 - 41]);

    // twice applied changes nothing: the largest value is inside the ring
    let mut twice = out.clone();
    rule.apply_into(out.view(), twice.view_mut()).unwrap();
    assert_eq!(twice, out);
    // no ring, no least size: everything above the share of the largest, which is on the rim
    let all = ThresholdRule { ring_pixels: 0, share: 0.55, least_pixels: 0 };
    all.on(mask.view()).unwrap().apply_into(image.view(), out.view_mut()).unwrap();
    assert!(out.iter().all(|v| *v == 0.0 || *v == 9.0) && out.iter().any(|v| *v == 9.0));
}

#[test]
fn the_rule_refuses_what_it_cannot_judge() {
    let mask = disc(16, 16);
    let rule = ThresholdRule::default();
    for (rule, wanted) in [
        (ThresholdRule { share: 1.0, ..rule }, "share is 1: it must be at least 0"),
        (ThresholdRule { share: f64::NAN, ..rule }, "share is NaN"),
        (ThresholdRule { ring_pixels: 8, ..rule }, "no pixel"),
    ] {
        says(rule.on(mask.view()), wanted);
    }
    let mut ready = rule.on(mask.view()).unwrap();
    let mut out = Array2::ones((16, 16));
    let flat = Array2::from_elem((16, 16), -3.0);
    let error = ready.apply_into(flat.view(), out.view_mut()).unwrap_err();
    assert_eq!((error, out.sum()), (DenoiseError::ConstantImage { value: -3.0 }, 0.0));
    // an untouched skin is no error, nor is one where all falls
    ready.apply_into(Array2::zeros((16, 16)).view(), out.view_mut()).unwrap();
    let falls = Array2::from_shape_fn((16, 16), |(r, _)| -1.0 - r as f64);
    ready.apply_into(falls.view(), out.view_mut()).unwrap();
    assert_eq!(out.sum(), 0.0);
    let mut frames = Array3::zeros((2, 16, 16));
    frames.index_axis_mut(Axis(0), 1).fill(1.0);
    // in a stack, as total variation may make one of a noisy frame, it is an image without touches
    let wanted = ready.apply(&ImageStack::new(frames, mask.clone()).unwrap()).unwrap();
    assert!(wanted.values().iter().all(|value| *value == 0.0 || value.is_nan()));
}

/// A law of any skin with reciprocity: `(G_am - G_an) - (G_bm - G_bn)` with a symmetric `G`, which a
/// turned skin has turned.
#[test]
fn a_turned_frame_is_the_frame_of_the_turned_skin() {
    let count = 8;
    let potential = |i: u32, j: u32| {
        let (i, j) = (f64::from(i.min(j)), f64::from(i.max(j)));
        (1.3 * i + 0.7 * j * j).sin()
    };
    // adjacent drive and measurement, driven electrodes left out
    let pairs = |d: u32| (2..count - 1).map(move |k| [d, d + 1, d + k, d + k + 1]);
    let quadruples: Vec<[u32; 4]> =
        (0..count).flat_map(pairs).map(|q| q.map(|electrode| electrode % count)).collect();
    let frame_of = |potential: &dyn Fn(u32, u32) -> f64| -> Vec<f64> {
        let value = |q: &[u32; 4]| {
            let [a, b, m, n] = *q;
            potential(a, m) - potential(a, n) - potential(b, m) + potential(b, n)
        };
        quadruples.iter().map(value).collect()
    };
    let frame = frame_of(&potential);
    let found = MeasurementOrder::of_disc(&quadruples, count).unwrap();
    assert_eq!(found.len(), 16);
    for (symmetry, order) in found {
        let mut old = vec![0; count as usize];
        (0..count).for_each(|l| old[symmetry.new_electrode(l, count) as usize] = l);
        let wanted = frame_of(&|i, j| potential(old[i as usize], old[j as usize]));
        let mut turned = vec![0.0; frame.len()];
        order.apply_into(&frame, &mut turned).unwrap();
        for (turned, wanted) in turned.iter().zip(&wanted) {
            // the same four numbers in another order of addition
            assert!((turned - wanted).abs() < 1e-14, "{symmetry:?}");
        }
        assert_eq!(symmetry == DiscSymmetry { steps: 0, mirrored: false }, turned == frame);
    }
}

#[test]
fn the_matrix_moves_electrodes_as_the_order_does() {
    let (count, first) = (16, 0.3);
    for clockwise in [false, true] {
        let place = |l: u32| {
            let step = std::f64::consts::TAU * f64::from(l) / f64::from(count);
            let angle = if clockwise { first - step } else { first + step };
            [angle.cos(), angle.sin()]
        };
        for mirrored in [false, true] {
            for steps in 0..count {
                let symmetry = DiscSymmetry { steps, mirrored };
                let m = symmetry.matrix(count, first, clockwise);
                for l in 0..count {
                    let [x, y] = place(l);
                    let wanted = place(symmetry.new_electrode(l, count));
                    let off = [0, 1].map(|i| (m[i][0] * x + m[i][1] * y - wanted[i]).abs());
                    assert!(off[0] < 1e-14 && off[1] < 1e-14, "{off:?}");
                }
            }
        }
    }
}

#[test]
fn protocols_without_the_symmetry_have_only_what_they_have() {
    // opposite drive of electrodes 0 and 4 alone: half turn and two mirrors remain
    let one: Vec<[u32; 4]> = (0..8).map(|m| [0, 4, m, (m + 1) % 8]).collect();
    let found = MeasurementOrder::of_disc(&one, 8).unwrap();
    let steps: Vec<_> = found.iter().map(|(s, _)| (s.mirrored, s.steps)).collect();
    assert_eq!(steps, [(false, 0), (false, 4), (true, 0), (true, 4)]);
    let error = MeasurementOrder::new(&[[0, 1, 2, 9]], &[0, 1, 2, 3]).unwrap_err().to_string();
    assert_eq!(error, "electrode is 9: it must be below the number of electrodes");
    assert!(MeasurementOrder::new(&[[0, 1, 2, 3]], &[0, 1, 1, 3]).is_err());
    let (_, order) = MeasurementOrder::of_disc(&one, 8).unwrap().remove(0);
    let error = order.apply_into(&[0.0; 7], &mut [0.0; 8]).unwrap_err().to_string();
    assert_eq!(error, "7 measurements where 8 are wanted");
}
