//! Fingers and fabrics of a learning base: everything that a net should not rely on is drawn anew.

use eit_fem::fabric::{FabricSettings, Finger, Interpolation, Key, PlayCircle, Tip, TouchScript};
use rand_distr::{Distribution as _, StandardUniform};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Frames a second, as in the built-in scripts.
const RATE_HZ: f64 = 10.0;
/// Frames before the first touch: reference and noise.
pub(super) const QUIET: usize = 20;
/// Time to press and to lift, seconds.
const PRESS_S: f64 = 0.3;

/// Random numbers of one sequence and attempt.
pub(super) struct Random(Pcg64);

impl Random {
    pub fn new(seed: u64, sequence: usize, attempt: usize) -> Self {
        Self(Pcg64::new(u128::from(seed), (sequence as u128) << 16 | attempt as u128))
    }

    /// Uniform.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        let unit: f64 = StandardUniform.sample(&mut self.0);
        low + (high - low) * unit
    }

    /// Uniform in the logarithm.
    fn factor(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// One of so many.
    pub fn choice(&mut self, count: usize) -> usize {
        (self.between(0.0, count as f64) as usize).min(count.saturating_sub(1))
    }
}

/// One to three fingers, each in a sector of its own so that they never meet, which press, rest,
/// slide from place to place up to 85 % of the radius, and lift.
pub(super) fn script(random: &mut Random, circle: &PlayCircle, frames: usize) -> TouchScript {
    let count = 1 + random.choice(3);
    let turn = random.between(0.0, TAU);
    let quiet_s = QUIET as f64 / RATE_HZ;
    let end_s = frames as f64 / RATE_HZ;
    let fingers = (0..count)
        .map(|k| {
            let sector = turn + TAU * k as f64 / count as f64;
            // alone it goes everywhere; between neighbours a gap stays
            let reach = if count == 1 { TAU / 2.0 } else { 0.65 * TAU / (2.0 * count as f64) };
            let inner: f64 = if count == 1 { 0.0 } else { 0.35 };
            finger(random, circle, (k as u32 + 1, sector, reach, inner), [quiet_s, end_s])
        })
        .collect();
    TouchScript {
        name: "training".to_owned(),
        frame_rate_hz: RATE_HZ,
        frames,
        quiet_frames: QUIET,
        fingers,
    }
}

fn finger(
    random: &mut Random,
    circle: &PlayCircle,
    (id, sector, reach, inner): (u32, f64, f64, f64),
    [quiet_s, end_s]: [f64; 2],
) -> Finger {
    let mut keys = Vec::new();
    let mut now_s = quiet_s + random.between(0.0, 0.8);
    while now_s + 2.0 * PRESS_S < end_s {
        let tip = 0.01_f64.min(0.15 * circle.radius_m);
        let (radius_m, force_n) = (tip * random.between(0.8, 1.2), random.between(0.4, 2.0));
        let places = 1 + random.choice(4);
        for k in 0..=places {
            // equal areas are equally likely
            let part = random.between(inner * inner, 0.85 * 0.85).sqrt();
            let angle = sector + random.between(-reach, reach);
            let r = part * circle.radius_m;
            let position_m =
                [circle.centre_m[0] + r * angle.cos(), circle.centre_m[1] + r * angle.sin()];
            let mut key =
                |time_s, force_n| keys.push(Key { time_s, position_m, force_n, radius_m });
            if k == 0 {
                key(now_s, 0.0);
                now_s += PRESS_S;
            }
            key(now_s, force_n);
            let rest_s = random.between(0.0, 1.0);
            now_s += rest_s;
            key(now_s, force_n);
            if k == places {
                now_s += PRESS_S;
                key(now_s, 0.0);
            } else {
                now_s += random.between(0.5, 2.5);
            }
        }
        now_s += random.between(0.1, 1.0);
    }
    Finger { id, tip: Tip::Round, interpolation: Interpolation::Linear, keys }
}

/// The scene's fabric with electrodes that give way more or less, and another weave, gain, noise
/// and drift.
pub(super) fn fabric(random: &mut Random, scene: &FabricSettings) -> FabricSettings {
    let mut fabric = scene.clone();
    fabric.rim.compliance = (scene.rim.compliance * random.between(0.3, 1.3)).min(0.95);
    fabric.rim.contact_gain *= random.between(0.0, 2.0);
    fabric.membrane.friction *= random.between(0.2, 1.5);
    fabric.piezo.strain_gain *= random.between(0.7, 1.3);
    fabric.piezo.hysteresis = (scene.piezo.hysteresis * random.between(0.0, 2.0)).min(0.5);
    fabric.weave.amplitude *= random.between(0.2, 1.5);
    let drift = random.factor(0.3, 3.0);
    fabric.drift.conductivity *= drift;
    fabric.drift.contact *= drift;
    let noise = random.factor(0.5, 10.0);
    fabric.instrument.noise_v = scene.instrument.noise_v.map(|v| noise * v);
    fabric.instrument.gain_error *= random.factor(0.3, 3.0);
    fabric
}

/// What the numbers above mean for a base: changes when they change.
pub(super) const RECIPE: &str = "scripts 1, fabrics 1";
