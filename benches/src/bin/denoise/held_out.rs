//! Sequences that no network was trained on, with their truth, and frames unlike any in training.

use benches::Result;
use benches::recording::{Finger as Press, Recording, Simulator};
use eit_fem::fabric::{
    FabricSettings, Finger, Interpolation, Key, PlayCircle, Random, Tip, TouchScript,
};
use eit_skin::{Progress, Skin};
use ndarray::{Array2, Array3, Axis};
use std::f64::consts::TAU;

/// Number of frames before the first touch.
pub(crate) const QUIET_FRAMES: usize = 20;
/// Nodes of the simulation mesh, different from those of training (4 000) and reconstruction (2
/// 000).
pub(crate) const NODES: usize = 7000;
/// Frames per second.
pub(crate) const RATE_HZ: f64 = 10.0;

/// A recording to denoise.
pub(crate) struct HeldOutSequence {
    pub name: &'static str,
    /// Voltages [frame, measurement], volts.
    pub values: Array2<f64>,
    /// True change of conductivity [frame, row, column]; `None` if only false touches are counted.
    pub truth: Option<Array3<f64>>,
    /// The fingers in each frame, `[frame]`.
    pub touches: Vec<Vec<Press>>,
}

/// A built-in script, changed, on a fabric.
struct Scripted {
    name: &'static str,
    script: &'static str,
    seed: u64,
    /// Maximum number of frames in a full run, and with `--quick`.
    frames: [usize; 2],
    fabric: fn(&mut FabricSettings),
    touch: fn(&mut TouchScript, &PlayCircle),
    /// Noise in decibel below the root mean square of the voltages, instead of the fabric's.
    noise_db: Option<f64>,
    /// An electrode (from 1) that is lost with the first touch.
    lost: Option<u32>,
}

const fn scripted(name: &'static str, script: &'static str, seed: u64, most: usize) -> Scripted {
    Scripted {
        name,
        script,
        seed,
        frames: [most, 45],
        fabric: |_| (),
        touch: |_, _| (),
        noise_db: None,
        lost: None,
    }
}

/// One finger of the paper with another tip.
const fn tips(name: &'static str, seed: u64, touch: fn(&mut TouchScript, &PlayCircle)) -> Scripted {
    Scripted { touch, ..scripted(name, "one-finger", seed, 140) }
}

const fn noisy(name: &'static str, script: &'static str, seed: u64, noise_db: f64) -> Scripted {
    Scripted { noise_db: Some(noise_db), ..scripted(name, script, seed, 140) }
}

const ONE: &str = "one-finger";
const TWO: &str = "two-fingers";

/// The cases of `weights/README.md`: inside the training's range, at its edges and beyond.
const SCRIPTED: [Scripted; 26] = [
    scripted("one finger (paper)", ONE, 101, 397),
    scripted("two fingers (paper)", TWO, 102, 252),
    scripted("tapping", "tapping", 103, 150),
    scripted("stroking", "stroking", 104, 150),
    scripted("three at random", "random", 105, 300),
    scripted("two close in", "closing-in", 106, 200),
    Scripted {
        fabric: |fabric| {
            fabric.rim.compliance = 0.95;
            fabric.rim.contact_gain = 4.0;
        },
        ..scripted("one finger, electrodes move more", ONE, 107, 200)
    },
    Scripted {
        fabric: |fabric| {
            fabric.rim.compliance = 0.0;
            fabric.rim.contact_gain = 0.0;
        },
        ..scripted("one finger, rigid rim", ONE, 108, 200)
    },
    tips("tips of 5 mm", 109, |script, _| each_key(script, |key| resize(key, 0.5, 0.7))),
    tips("tips of 20 mm", 110, |script, _| each_key(script, |key| resize(key, 2.0, 1.0))),
    Scripted {
        touch: |script, _| each_key(script, |key| resize(key, 2.0, 1.0)),
        ..scripted("two fingers, tips of 20 mm", TWO, 111, 140)
    },
    tips("rim at 0.95 R", 112, |script, circle| {
        each_key(script, |key| move_out(key, circle, 0.95 / 0.8));
    }),
    Scripted { touch: side_by_side, ..scripted("two fingers 25 mm apart", ONE, 113, 140) },
    Scripted { fabric: foam, ..scripted("foundation 1e6", ONE, 114, 140) },
    Scripted { fabric: foam, ..scripted("foundation 1e6, two fingers", TWO, 115, 140) },
    noisy("70 dB", ONE, 116, 70.0),
    noisy("70 dB, two fingers", TWO, 117, 70.0),
    noisy("60 dB", ONE, 118, 60.0),
    noisy("60 dB, two fingers", TWO, 119, 60.0),
    noisy("50 dB", ONE, 120, 50.0),
    noisy("40 dB", ONE, 121, 40.0),
    Scripted {
        touch: |script, circle| star(script, circle, 5),
        ..scripted("five fingers", TWO, 122, 140)
    },
    Scripted {
        touch: |script, circle| star(script, circle, 6),
        ..scripted("six fingers", TWO, 123, 140)
    },
    Scripted { lost: Some(5), ..scripted("electrode 5 lost", ONE, 124, 140) },
    Scripted { lost: Some(11), ..scripted("electrode 11 lost, two fingers", TWO, 125, 140) },
    Scripted {
        fabric: |fabric| fabric.piezo.strain_gain = 0.4,
        ..scripted("weak touches", ONE, 126, 140)
    },
];

/// Dense foam beneath the fabric.
fn foam(fabric: &mut FabricSettings) {
    fabric.membrane.foundation_pa_per_m = 1e6;
}

fn each_key(script: &mut TouchScript, mut change: impl FnMut(&mut Key)) {
    script.fingers.iter_mut().flat_map(|finger| &mut finger.keys).for_each(&mut change);
}

fn resize(key: &mut Key, tip: f64, force: f64) {
    key.radius_m *= tip;
    key.force_n *= force;
}

fn move_out(key: &mut Key, circle: &PlayCircle, factor: f64) {
    let off = [0, 1].map(|i| key.position_m[i] - circle.centre_m[i]);
    key.position_m = [0, 1].map(|i| circle.centre_m[i] + factor * off[i]);
}

/// The finger at half the radius, and a second one 25 mm away that circles around it.
fn side_by_side(script: &mut TouchScript, circle: &PlayCircle) {
    each_key(script, |key| move_out(key, circle, 0.5 / 0.8));
    let Some(mut second) = script.fingers.first().cloned() else { return };
    second.id = 2;
    for (k, key) in second.keys.iter_mut().enumerate() {
        let angle = TAU * k as f64 / 30.0;
        let places = key.position_m;
        key.position_m = [places[0] + 0.025 * angle.cos(), places[1] + 0.025 * angle.sin()];
    }
    script.fingers.push(second);
}

/// Copies of the first finger, turned about the middle.
fn star(script: &mut TouchScript, circle: &PlayCircle, count: u32) {
    let Some(first) = script.fingers.first().cloned() else { return };
    let turned = |id: u32| {
        let (sin, cos) = (TAU * f64::from(id) / f64::from(count)).sin_cos();
        let mut finger = Finger { id: id + 1, ..first.clone() };
        for key in &mut finger.keys {
            let [x, y] = [0, 1].map(|i| key.position_m[i] - circle.centre_m[i]);
            let places = [cos * x - sin * y, sin * x + cos * y];
            key.position_m = [0, 1].map(|i| circle.centre_m[i] + places[i]);
        }
        finger
    };
    script.fingers = (0..count).map(turned).collect();
}

/// Simulates all cases. `seed` is added to that of each: fresh noise, weave and drift.
pub(crate) fn sequences(
    simulator: &Simulator,
    quick: bool,
    seed: u64,
) -> Result<Vec<HeldOutSequence>> {
    let skin = &simulator.finer;
    let voltages = skin.linearise(&mut Progress::silent())?.voltages;
    let rms_v = (voltages.dot(&voltages) / voltages.len() as f64).sqrt();
    let circle = PlayCircle::of(&skin.mesh);
    let mut made = Vec::new();
    for case in &SCRIPTED {
        let mut script = TouchScript::built_in(case.script, &circle, case.seed + seed)?;
        (case.touch)(&mut script, &circle);
        script.frames = script.frames.min(case.frames[usize::from(quick)]);
        let mut settings = FabricSettings::default();
        (case.fabric)(&mut settings);
        if let Some(below) = case.noise_db {
            settings.instrument.noise_v = [rms_v * 10.0_f64.powf(-below / 20.0); 2];
        }
        let mut recording = simulator.run(script, case.seed + seed, &settings)?;
        if let Some(lost) = case.lost {
            lose(&mut recording.simulation.frames_v, skin, lost - 1);
        }
        made.push(sequence(case.name, recording, true));
    }
    let count = if quick { 30 } else { 150 };
    let settings = FabricSettings::default();
    let quiet = simulator.run(silence(count), 201 + seed, &settings)?;
    made.push(sequence("quiet skin", quiet, false));
    let mut loose = FabricSettings::default();
    loose.instrument.loose = vec![6];
    loose.instrument.loose_rate_hz = 2.0;
    loose.instrument.loose_time_s = 0.5;
    loose.instrument.open_factor = 3.0;
    let loose = simulator.run(silence(count), 202 + seed, &loose)?;
    made.push(sequence("loose electrode", loose, false));
    let palm = simulator.run(palm(&circle, count), 203 + seed, &settings)?;
    made.push(sequence("palm", palm, false));
    // in both no blob is a finger: each one found is false
    let cut = simulator.run(cuts(&circle, count), 302 + seed, &cut_skin())?;
    let mut script = TouchScript::built_in(ONE, &circle, 303)?;
    script.frames = count;
    let mut inverted = simulator.run(script, 303 + seed, &settings)?;
    invert(&mut inverted.simulation.frames_v);
    for (name, recording) in [("cut", cut), ("wrong sign", inverted)] {
        made.push(HeldOutSequence {
            touches: vec![Vec::new(); count],
            ..sequence(name, recording, false)
        });
    }
    Ok(made)
}

/// Differences from the quiet frames with the other sign: a skin whose touches lower the conductivity.
fn invert(values: &mut Array2<f64>) {
    let quiet =
        values.slice_axis(Axis(0), (..QUIET_FRAMES).into()).sum_axis(Axis(0)) / QUIET_FRAMES as f64;
    for mut frame in values.rows_mut() {
        frame.zip_mut_with(&quiet, |value, quiet| *value = 2.0 * quiet - *value);
    }
}

/// Takes the measurements of an electrode out of all frames after the quiet ones.
fn lose(values: &mut Array2<f64>, skin: &Skin, electrode: u32) {
    let quadruples = skin.protocol.quadruples().unwrap_or_default();
    for (i, _) in quadruples.iter().enumerate().filter(|(_, q)| q.contains(&electrode)) {
        values.column_mut(i).slice_axis_mut(Axis(0), (QUIET_FRAMES..).into()).fill(f64::NAN);
    }
}

fn sequence(name: &'static str, recording: Recording, with_truth: bool) -> HeldOutSequence {
    let touches = (0..recording.script.frames).map(|frame| recording.fingers(frame)).collect();
    let truth = with_truth.then_some(recording.simulation.truth.conductivity_change_s);
    HeldOutSequence { name, values: recording.simulation.frames_v, truth, touches }
}

/// A script without fingers.
fn silence(frames: usize) -> TouchScript {
    TouchScript {
        name: "silence".to_owned(),
        frame_rate_hz: RATE_HZ,
        frames,
        quiet_frames: QUIET_FRAMES,
        fingers: Vec::new(),
    }
}

/// A palm: three times as large as a fingertip, pressing at random positions.
fn palm(circle: &PlayCircle, frames: usize) -> TouchScript {
    let mut random = Random::new(301);
    let mut keys = Vec::new();
    let mut now_s = QUIET_FRAMES as f64 / RATE_HZ;
    while now_s < frames as f64 / RATE_HZ {
        let (r, angle) = (0.5 * circle.radius_m * random.uniform().sqrt(), TAU * random.uniform());
        let position_m =
            [circle.centre_m[0] + r * angle.cos(), circle.centre_m[1] + r * angle.sin()];
        for (after_s, force_n) in [(0.0, 0.0), (0.3, 4.0), (0.7, 4.0), (0.9, 0.0)] {
            keys.push(Key { time_s: now_s + after_s, position_m, force_n, radius_m: 0.03 });
        }
        now_s += 1.0;
    }
    let finger = Finger { id: 1, tip: Tip::Round, interpolation: Interpolation::Linear, keys };
    TouchScript { name: "palm".to_owned(), fingers: vec![finger], ..silence(frames) }
}

/// Discs in which the conductivity drops by four fifths, at a new random position in each frame.
fn cuts(circle: &PlayCircle, frames: usize) -> TouchScript {
    let mut random = Random::new(302);
    let key = |frame: usize| {
        let (r, angle) = (0.7 * circle.radius_m * random.uniform().sqrt(), TAU * random.uniform());
        let position_m =
            [circle.centre_m[0] + r * angle.cos(), circle.centre_m[1] + r * angle.sin()];
        let time_s = frame as f64 / RATE_HZ;
        Key { time_s, position_m, force_n: 1.0, radius_m: 0.012 }
    };
    let keys = (QUIET_FRAMES..frames).map(key).collect();
    let finger = Finger { id: 1, tip: Tip::Flat, interpolation: Interpolation::Linear, keys };
    TouchScript { name: "cuts".to_owned(), fingers: vec![finger], ..silence(frames) }
}

/// A skin whose conductivity drops by four fifths where it is cut, with the largest noise of the
/// default instrument.
fn cut_skin() -> FabricSettings {
    let mut settings = FabricSettings::linear(-0.8);
    settings.instrument.noise_v = [FabricSettings::default().instrument.noise_v[1]; 2];
    settings
}
