//! Parts of the simulated fabric against closed forms and properties: contact, piezoresistive law.

use eit_fem::fabric::{Indentation, Membrane, PiezoLaw, Piezoresistance, Tip};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

const BOTH: [Tip; 2] = [Tip::Round, Tip::Flat];

/// Soft foam, with dents of 10 mm.
fn membrane() -> Membrane {
    Membrane { tension_n_per_m: 100.0, foundation_pa_per_m: 1e6, ..Default::default() }
}

/// Integral of `2 pi r f(r)` by Simpson's rule on both sides of the contact edge.
fn over_plane(dent: &Indentation, far_m: f64, f: impl Fn(f64) -> f64) -> f64 {
    let at = |r: f64| TAU * r * f(r);
    let simpson = |from: f64, to: f64| -> f64 {
        let h = (to - from) / 2000.0;
        let lower = (0..2000).map(|k| from + h * f64::from(k));
        lower.map(|r| (at(r) + 4.0 * at(r + 0.5 * h) + at(r + h)) * h / 6.0).sum()
    };
    let a = dent.contact_radius_m;
    // evaluate the first outside value just beyond the edge
    simpson(0.0, a) + simpson(a * (1.0 + 1e-12), far_m)
}

/// The foundation pressure and the contact pressure both integrate to the force.
#[test]
fn forces_balance() {
    for tip in BOTH {
        for force_n in [0.01, 0.5, 2.0, 4.0] {
            let dent = Indentation::new(&membrane(), tip, 0.01, force_n).unwrap();
            let k = membrane().foundation_pa_per_m;
            // K0 falls to 1e-17 at 0.4 m, which is forty membrane lengths
            let carried = over_plane(&dent, 0.4, |r| k * dent.at(r).deflection_m);
            let pressed = over_plane(&dent, 0.02, |r| dent.at(r).pressure_pa);
            // Simpson's rule on 4000 steps: error of 1e-9 measured by halving them
            assert!((carried / force_n - 1.0).abs() < 1e-7, "{tip:?} {force_n}: {carried}");
            assert!((pressed / force_n - 1.0).abs() < 1e-7, "{tip:?} {force_n}: {pressed}");
        }
    }
}

/// `k w - T laplacian(w) = p` away from the edge, by central differences; value and slope are
/// continuous at the edge, and the slope is the derivative of the deflection.
#[test]
fn deflection_solves_the_membrane_equation() {
    let Membrane { tension_n_per_m: t, foundation_pa_per_m: k, .. } = membrane();
    for tip in BOTH {
        let dent = Indentation::new(&membrane(), tip, 0.01, 2.0).unwrap();
        let a = dent.contact_radius_m;
        for r in [0.3 * a, 0.8 * a, 1.3 * a, 3.0 * a, 8.0 * a] {
            let h = 1e-6;
            let slope = |r: f64| dent.at(r).slope;
            let w = dent.at(r);
            let laplacian = (slope(r + h) - slope(r - h)) / (2.0 * h) + slope(r) / r;
            let p = k * w.deflection_m - t * laplacian;
            // rounding of the difference: 1e-16 / 1e-6, relative to the curvature
            let scale = dent.at(0.0).pressure_pa;
            assert!((p - w.pressure_pa).abs() < 1e-6 * scale, "{tip:?} {r}: {p}");
            let found = (dent.at(r + h).deflection_m - dent.at(r - h).deflection_m) / (2.0 * h);
            assert!((found - w.slope).abs() < 1e-8, "{tip:?} {r}");
        }
        let (inside, outside) = (dent.at(a), dent.at(a * (1.0 + 1e-12)));
        // the step beside the edge is 1e-12
        assert!((inside.deflection_m - outside.deflection_m).abs() < 1e-10 * dent.depth_m);
        assert!((inside.slope - outside.slope).abs() < 1e-10);
        assert!((inside.displacement_m - outside.displacement_m).abs() < 1e-10 * dent.depth_m);
        assert!((inside.areal_strain - outside.areal_strain).abs() < 1e-10);
        assert!((dent.slope + inside.slope).abs() < 1e-14);
        assert_eq!(dent.at(0.0).deflection_m, dent.depth_m);
    }
}

/// Limits for a sphere: foundation only (no tension) and membrane only (no foundation).
#[test]
fn limits_of_a_round_tip() {
    let (radius_m, force_n) = (0.01, 0.3);
    let soft = Membrane { tension_n_per_m: 1e-6, foundation_pa_per_m: 1e8, ..membrane() };
    let dent = Indentation::new(&soft, Tip::Round, radius_m, force_n).unwrap();
    let a = (4.0 * radius_m * force_n / (PI * soft.foundation_pa_per_m)).powf(0.25);
    // the error is first order in membrane length / contact radius, 1e-7 m / 2.5 mm
    assert!((dent.contact_radius_m / a - 1.0).abs() < 1e-4, "{} {a}", dent.contact_radius_m);
    assert!((dent.depth_m / (a * a / (2.0 * radius_m)) - 1.0).abs() < 2e-4);

    let hung = Membrane { tension_n_per_m: 100.0, foundation_pa_per_m: 1e-3, ..membrane() };
    let dent = Indentation::new(&hung, Tip::Round, radius_m, force_n).unwrap();
    let a = (force_n * radius_m / (TAU * hung.tension_n_per_m)).sqrt();
    assert!((dent.contact_radius_m / a - 1.0).abs() < 1e-6, "{} {a}", dent.contact_radius_m);
}

/// At the centre of a wide flat tip only the foundation matters. A narrow tip makes the dent of a
/// point load, `F / (2 pi T) K0(r/l)`, whose slope for r much smaller than `l` is `F / (2 pi T r)`.
#[test]
fn limits_of_a_flat_tip() {
    let wide = Indentation::new(&membrane(), Tip::Flat, 0.2, 20.0).unwrap();
    let wanted = 20.0 / (PI * 0.04) / membrane().foundation_pa_per_m;
    // the effect of the tip's edge falls as exp(-a/l) sqrt(a/l): 1e-8
    assert!((wide.depth_m / wanted - 1.0).abs() < 1e-6);
    let narrow = Indentation::new(&membrane(), Tip::Flat, 1e-5, 1e-3).unwrap();
    let r = 1e-4;
    let wanted = 1e-3 / (TAU * membrane().tension_n_per_m * r);
    // (r/l)^2 log(r/l) = 5e-4
    assert!((-narrow.at(r).slope / wanted - 1.0).abs() < 1e-3, "{}", narrow.at(r).slope);
    // too much force is no dent
    assert!(Indentation::new(&membrane(), Tip::Round, 0.01, 100.0).is_none());
    assert!(Indentation::new(&membrane(), Tip::Flat, 0.001, 10.0).is_none());
}

/// In-plane equilibrium `(r N_r)' = N_theta` by central differences, areal strain from its
/// definition, and the far field that falls like 1/r.
#[test]
fn strains_are_in_equilibrium() {
    let nu = membrane().poisson_ratio;
    for tip in BOTH {
        let dent = Indentation::new(&membrane(), tip, 0.01, 2.0).unwrap();
        let a = dent.contact_radius_m;
        let h = 1e-6;
        let strain = |r: f64| {
            let u = |r: f64| dent.at(r).displacement_m;
            let here = dent.at(r);
            let radial = (u(r + h) - u(r - h)) / (2.0 * h) + 0.5 * here.slope * here.slope;
            (radial, here.displacement_m / r)
        };
        for r in [0.4 * a, 0.9 * a, 1.2 * a, 2.5 * a] {
            let (radial, hoop) = strain(r);
            let areal = dent.at(r).areal_strain;
            // differences over 1e-6 m of displacements near 1e-4 m: 1e-10 / 1e-4
            assert!((radial + hoop - areal).abs() < 1e-7, "{tip:?} {r}: {} {areal}", radial + hoop);
            let tension = |r: f64| {
                let (radial, hoop) = strain(r);
                r * (radial + nu * hoop)
            };
            let d = 1e-5;
            let change = (tension(r + d) - tension(r - d)) / (2.0 * d);
            // a second difference: 1e-5 of strains up to 0.1
            assert!((change - (hoop + nu * radial)).abs() < 1e-5, "{tip:?} {r}");
        }
        let far = [0.1, 0.2].map(|r| r * dent.at(r).displacement_m);
        assert!(far[0] < 0.0, "towards the touch");
        // the remaining K1^2 term at ten membrane lengths
        assert!((far[0] / far[1] - 1.0).abs() < 1e-6, "{far:?}");
    }
}

/// Strong hysteresis and no other effect.
fn plays() -> Piezoresistance {
    Piezoresistance {
        hysteresis: 0.6,
        thresholds: vec![0.05, 0.1, 0.2, 0.4],
        relaxing: vec![],
        relaxation_s: vec![],
        ..Default::default()
    }
}

/// Responses to a sequence of drives, from the initial state.
fn responses(settings: &Piezoresistance, drives: &[f64]) -> Vec<f64> {
    let law = PiezoLaw::new(settings, 0.1);
    let mut memory = vec![0.0; law.memory()];
    drives.iter().map(|d| law.step(*d, &mut memory)).collect()
}

/// First loading: each play operator lags by its threshold.
#[test]
fn virgin_curve() {
    let found = responses(&plays(), &[0.03, 0.08, 0.3, 0.5]);
    let curve = |d: f64| {
        let sum: f64 = plays().thresholds.iter().map(|r| (d - r).max(0.0)).sum();
        0.4 * d + 0.15 * sum
    };
    for (c, d) in found.iter().zip([0.03, 0.08, 0.3, 0.5]) {
        assert!((c - curve(d)).abs() < 1e-15, "rounding of four sums: {c}");
    }
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    /// Return-point memory: an excursion that returns to its turning point leaves no trace.
    #[test]
    fn return_point_memory(top in 0.3f64..0.8, low in 0.0f64..0.29, inner in 0.0f64..1.0, after in 0.0f64..1.0) {
        let inner = low + inner * (top - low);
        let plain = responses(&plays(), &[top, low, top, after]);
        let excursion = responses(&plays(), &[top, low, inner, low, top, after]);
        prop_assert!((plain[2] - excursion[4]).abs() < 1e-15);
        prop_assert!((plain[3] - excursion[5]).abs() < 1e-15);
        prop_assert!((plain[1] - excursion[3]).abs() < 1e-15);
    }

    /// Minor loops between the same drives have the same height, independent of the history.
    #[test]
    fn congruency(first in 0.5f64..0.9, second in 0.5f64..0.9, low in 0.0f64..0.2, high in 0.25f64..0.49) {
        let height = |history: [f64; 2]| {
            let c = responses(&plays(), &[history[0], history[1], low, high, low, high]);
            (c[4] - c[3], c[5] - c[4])
        };
        let (one, other) = (height([first, 0.3]), height([second, 0.0]));
        prop_assert!((one.0 - other.0).abs() < 1e-14, "{one:?} {other:?}");
        // both loops close
        prop_assert!((other.0 + other.1).abs() < 1e-14);
    }

    /// Additional points on a monotonic path change nothing.
    #[test]
    fn rate_independence(top in 0.1f64..0.9, low in 0.0f64..0.5, part in 0.0f64..1.0) {
        let between = low + part * (top - low);
        let direct = responses(&plays(), &[top, low]);
        let slow = responses(&plays(), &[between.min(top), top, between.clamp(low.min(top), low.max(top)), low]);
        prop_assert!((direct[1] - slow[3]).abs() < 1e-15);
    }
}

/// A loop dissipates energy, and unloading lies above loading.
#[test]
fn loops_have_area() {
    let c = responses(&plays(), &[0.3, 0.6, 0.3, 0.0]);
    assert!(c[2] > c[0] + 0.01, "{c:?}");
    assert!(c[3] > 0.01, "a rest stays: {c:?}");
}

/// Drive with one Prony term: a ramp over the first step, constant, a ramp back, and nothing. A
/// negative share creeps up, and fades after the lift.
#[test]
fn relaxation_follows_the_exponential() {
    for share in [0.3, -0.2] {
        let (relaxing, relaxation_s) = (vec![share], vec![0.7]);
        let settings =
            Piezoresistance { hysteresis: 0.0, relaxing, relaxation_s, ..Default::default() };
        let drives = [[0.5; 60], [0.0; 60]].concat();
        let (dt, tau) = (0.1, 0.7);
        // y after the ramp: 1 - tau/dt (1 - exp(-dt/tau)) of the step
        let first = 0.5 * (1.0 - tau / dt * (1.0 - f64::exp(-dt / tau)));
        let y = |n: usize| 0.5 + (first - 0.5) * f64::exp(-(n as f64) * dt / tau);
        let found = responses(&settings, &drives);
        for (n, (c, drive)) in found.iter().zip(&drives).enumerate() {
            let y = y(n) - n.checked_sub(60).map_or(0.0, y);
            assert!((c - (drive - share * y)).abs() < 1e-14, "frame {n}: {c}");
        }
        assert!((found[59] - 0.5 * (1.0 - share)).abs() < 1e-4, "settles at the remaining share");
    }
}

/// The update is exact: on a linear ramp, steps of half the length give the same values.
#[test]
fn relaxation_does_not_depend_on_the_step() {
    let settings = Piezoresistance { hysteresis: 0.0, ..Default::default() };
    let run = |steps: usize| {
        let law = PiezoLaw::new(&settings, 2.0 / steps as f64);
        let mut memory = vec![0.0; law.memory()];
        let drives = (1..=steps).map(|k| 0.4 * k as f64 / steps as f64);
        drives.map(|d| law.step(d, &mut memory)).last().unwrap()
    };
    // rounding of sixty-four updates
    assert!((run(4) - run(64)).abs() < 1e-14, "{} {}", run(4), run(64));
}
