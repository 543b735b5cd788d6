//! Position error of a held touch, beside the Cramer-Rao bound of a single frame.

use crate::Result;
use crate::recording::{Simulator, WITHIN_M, distance_m, valid_touches};
use crate::table::{Cell, Table, quantile};
use eit_fem::fabric::{
    FabricSettings, Finger, Interpolation, Key, LinearResponse, Random, Tip, Touch, TouchScript,
};
use eit_skin::Skin;
use eit_skin::method::Method;
use faer::linalg::solvers::DenseSolveCore as _;
use std::f64::consts::TAU;

/// The touch: a bell of 10 mm that raises the conductivity by 30 %.
const RADIUS_M: f64 = 0.010;
const AMPLITUDE: f64 = 0.3;
/// Frames per second, of the quiet start, and of the touch.
const RATE_HZ: f64 = 10.0;
const QUIET: usize = 20;
const HELD: usize = 20;

/// Simulates held touches on rings at noise levels and compares the places of the listed ones.
pub(super) fn table(simulator: &Simulator, quick: bool) -> Result<Table> {
    let (levels, places): (&[f64], usize) =
        if quick { (&[60.0], 2) } else { (&[40.0, 50.0, 60.0, 70.0], 5) };
    let skin = &simulator.finer;
    let voltages = skin.model.forward(&skin.background_s())?;
    let rms_v = (voltages.dot(&voltages) / voltages.len() as f64).sqrt();
    let radius_m = skin.mesh.surface().nodes().iter().map(|n| n[0].hypot(n[1])).fold(0.0, f64::max);
    let chain = simulator.chain(&held([0.0; 2]), Method::GaussNewton, None)?;
    let mut rows = Vec::new();
    for &noise_db in levels {
        let noise_v = rms_v * 10_f64.powf(-noise_db / 20.0);
        for ring in [0.0, 0.5, 0.8] {
            let (mut errors_m, mut listed, mut elsewhere, mut squares) = (Vec::new(), 0, 0, 0.0);
            for place in on_ring(ring, places, radius_m) {
                let mut fabric = FabricSettings::linear(AMPLITUDE);
                fabric.instrument.noise_v = [noise_v; 2];
                let seed = (1000.0 * ring + noise_db) as u64;
                let recording = simulator.run(held(place), seed, &fabric)?;
                for touches in valid_touches(&recording.reconstruct(&chain)?)?.iter().skip(QUIET) {
                    listed += usize::from(!touches.is_empty());
                    for touch in touches {
                        match distance_m(touch.position_m, place) {
                            error_m if error_m <= WITHIN_M => errors_m.push(error_m),
                            _ => elsewhere += 1,
                        }
                    }
                }
                squares += bound_m(skin, place, noise_v)?.powi(2);
            }
            let frames = (places * HELD) as f64;
            rows.push(vec![
                Cell::text(ring),
                Cell::text(noise_db),
                Cell::Number(listed as f64 / frames, 2),
                Cell::Number(f64::from(elsewhere) / frames, 3),
                Cell::Number(1e3 * quantile(&errors_m, 0.5), 2),
                Cell::Number(1e3 * quantile(&errors_m, 0.95), 2),
                Cell::Number(1e3 * (squares / places as f64).sqrt(), 3),
            ]);
        }
    }
    Ok(Table {
        title: "Position error of a held touch",
        note: format!(
            "A bell of 10 mm and 30 % held for {HELD} frames at {places} places on each ring (seeded), \
             on a linear skin; reference and noise from {QUIET} quiet frames. Ring: fraction of the \
             radius. Noise: standard deviation of a voltage, in decibels below the root mean square. \
             Listed: fraction of the frames with a valid touch; elsewhere: valid touches a frame that \
             are farther than {:.0} mm. Bound: Cramer-Rao of a single frame, root mean square distance, \
             amplitude and radius unknown; the detector averages over frames.",
            1e3 * WITHIN_M
        ),
        columns: vec![
            "ring",
            "noise, dB",
            "listed",
            "elsewhere",
            "median, mm",
            "95 %, mm",
            "bound, mm",
        ],
        rows,
    })
}

/// Positions at equal steps of the angle from a seeded start, each also a step further between two
/// electrodes, so that symmetry favours none.
fn on_ring(ring: f64, count: usize, radius_m: f64) -> impl Iterator<Item = [f64; 2]> {
    let first = TAU * Random::named(17, "places of a ring", (100.0 * ring) as u64).uniform();
    (0..count).map(move |k| {
        let part = k as f64 / count as f64;
        let angle = first + TAU * part + TAU / 16.0 * part;
        [ring * radius_m * angle.cos(), ring * radius_m * angle.sin()]
    })
}

/// A finger that presses with 1 N after the quiet frames.
fn held(position_m: [f64; 2]) -> TouchScript {
    let key = |frame: f64, force_n| Key {
        time_s: frame / RATE_HZ,
        position_m,
        force_n,
        radius_m: RADIUS_M,
    };
    let start = QUIET as f64;
    let keys = vec![key(start - 0.5, 0.0), key(start - 0.1, 1.0), key(start + HELD as f64, 1.0)];
    let finger = Finger { id: 1, tip: Tip::Round, interpolation: Interpolation::Linear, keys };
    TouchScript {
        name: "held".to_owned(),
        frame_rate_hz: RATE_HZ,
        frames: QUIET + HELD,
        quiet_frames: QUIET,
        fingers: vec![finger],
    }
}

/// Cramer-Rao bound on the root mean square distance of any unbiased estimate of a bell's position
/// from one frame, metres: amplitude and radius are unknown too. The inverse of the Fisher
/// information `A' A`, `A = dv/dtheta / noise`, by central differences of the forward solution.
///
/// Source: Kay, *Fundamentals of Statistical Signal Processing: Estimation Theory* (1993), chapter 3.
fn bound_m(skin: &Skin, place: [f64; 2], noise_v: f64) -> Result<f64> {
    let centroids = skin.mesh.surface().centroids();
    let voltages = |[x, y, amplitude, radius_m]: [f64; 4]| {
        let touch = Touch {
            finger: 1,
            tip: Tip::Round,
            position_m: [x, y],
            force_n: 1.0,
            radius_m,
            direction: [0.0; 2],
        };
        let response = LinearResponse { change_per_newton: amplitude };
        let sigma = response.conductivity_s(skin.conductivity_s, &[touch], &centroids);
        skin.model.forward(&sigma)
    };
    let steps = [1e-4, 1e-4, 1e-3, 1e-4];
    let mut columns = Vec::new();
    for (k, step) in steps.into_iter().enumerate() {
        let at = |sign: f64| {
            let mut theta = [place[0], place[1], AMPLITUDE, RADIUS_M];
            theta[k] += sign * step;
            voltages(theta)
        };
        columns.push((at(1.0)? - at(-1.0)?) / (2.0 * step * noise_v));
    }
    let information = faer::Mat::from_fn(4, 4, |i, j| columns[i].dot(&columns[j]));
    let covariance = information.partial_piv_lu().inverse();
    Ok((covariance[(0, 0)] + covariance[(1, 1)]).sqrt())
}
