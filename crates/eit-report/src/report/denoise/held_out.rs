//! Sequences that no network was trained on, with their truth, and frames unlike any in training.

use crate::error::ReportError;
use eit_fem::fabric::{
    FabricSettings, Finger, Interpolation, Key, PlayCircle, Random, Simulation, SimulationSettings,
    Tip, TouchScript,
};
use eit_mesh::Raster;
use eit_skin::{Progress, Skin};
use ndarray::{Array2, Array3};
use std::f64::consts::TAU;

/// Number of frames before the first touch.
pub(super) const QUIET_FRAMES: usize = 20;
/// Nodes of the simulation mesh, different from those of training (4 000) and reconstruction (2
/// 000).
pub(super) const NODES: usize = 7000;
/// Frames per second.
const RATE_HZ: f64 = 10.0;

/// A recording to denoise.
pub(super) struct HeldOutSequence {
    pub name: &'static str,
    /// Voltages [frame, measurement], volts.
    pub values: Array2<f64>,
    /// True change of conductivity [frame, row, column]; `None` if only false touches are counted.
    pub truth: Option<Array3<f64>>,
    /// The fingers in each frame, `[frame]`.
    pub touches: Vec<Vec<Press>>,
}

/// A finger in a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Press {
    /// Position, metres.
    pub position_m: [f64; 2],
    /// Force, newtons.
    pub force_n: f64,
}

/// A built-in script on a fabric.
struct Scripted {
    name: &'static str,
    script: &'static str,
    seed: u64,
    /// Maximum number of frames in a full run, and with `--quick`.
    frames: [usize; 2],
    fabric: fn(&mut FabricSettings),
}

const fn scripted(name: &'static str, script: &'static str, seed: u64, most: usize) -> Scripted {
    Scripted { name, script, seed, frames: [most, 45], fabric: |_| () }
}

const SCRIPTED: [Scripted; 8] = [
    scripted("one finger (paper)", "paper-one-finger", 101, 397),
    scripted("two fingers (paper)", "paper-two-fingers", 102, 252),
    scripted("tapping", "tapping", 103, 150),
    scripted("stroking", "stroking", 104, 150),
    scripted("three at random", "random", 105, 300),
    scripted("two close in", "closing-in", 106, 200),
    Scripted {
        fabric: |fabric| {
            fabric.rim.compliance = 0.95;
            fabric.rim.contact_gain = 4.0;
        },
        ..scripted("one finger, electrodes move more", "paper-one-finger", 107, 200)
    },
    Scripted {
        fabric: |fabric| {
            fabric.rim.compliance = 0.0;
            fabric.rim.contact_gain = 0.0;
        },
        ..scripted("one finger, rigid rim", "paper-one-finger", 108, 200)
    },
];

/// Returns all cases of the report.
pub(super) fn sequences(
    skin: &Skin,
    quick: bool,
    progress: &mut Progress,
) -> Result<Vec<HeldOutSequence>, ReportError> {
    let skin = skin.with_nodes(NODES, progress)?;
    let raster = Raster::new(skin.mesh.surface(), skin.pixels())?;
    let simulator = Simulator { skin, raster };
    let circle = PlayCircle::of(&simulator.skin.mesh);
    progress.steps("simulate", SCRIPTED.len() + 4, |bar| {
        let mut made = Vec::new();
        for case in &SCRIPTED {
            let mut script = TouchScript::built_in(case.script, &circle, case.seed)?;
            script.frames = script.frames.min(case.frames[usize::from(quick)]);
            let mut settings = FabricSettings::default();
            (case.fabric)(&mut settings);
            let simulated = simulator.run(&script, &settings, case.seed)?;
            made.push(HeldOutSequence {
                name: case.name,
                ..sequence(simulated, script.frames, true)
            });
            bar.inc();
        }
        let count = if quick { 30 } else { 150 };
        let quiet = silence(count);
        let settings = FabricSettings::default();
        let simulated = simulator.run(&quiet, &settings, 201)?;
        made.push(HeldOutSequence { name: "quiet skin", ..sequence(simulated, count, false) });
        bar.inc();
        let mut loose = FabricSettings::default();
        loose.instrument.loose = vec![6];
        loose.instrument.loose_rate_hz = 2.0;
        loose.instrument.loose_time_s = 0.5;
        loose.instrument.open_factor = 3.0;
        let simulated = simulator.run(&quiet, &loose, 202)?;
        made.push(HeldOutSequence { name: "loose electrode", ..sequence(simulated, count, false) });
        bar.inc();
        let script = palm(&circle, count);
        let simulated = simulator.run(&script, &settings, 203)?;
        made.push(HeldOutSequence { name: "palm", ..sequence(simulated, count, false) });
        bar.inc();
        let simulated = simulator.run(&cuts(&circle, count), &cut_skin(), 302)?;
        made.push(HeldOutSequence {
            name: "cut",
            // no finger, so every touch detected is false
            touches: vec![Vec::new(); count],
            ..sequence(simulated, count, false)
        });
        bar.inc();
        Ok(made)
    })
}

/// The simulation model, and the pixels of its truth.
struct Simulator {
    skin: Skin,
    raster: Raster,
}

impl Simulator {
    fn run(
        &self,
        script: &TouchScript,
        settings: &FabricSettings,
        seed: u64,
    ) -> Result<Simulation, ReportError> {
        let skin = &self.skin;
        let fabric = skin.fabric_with(settings)?;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let how = SimulationSettings { seed, threads, keep_elements: false };
        Ok(fabric.simulate(script, &self.raster, &how, &mut |_| {})?)
    }
}

/// Converts a simulated recording to a sequence without a name.
fn sequence(made: Simulation, frames: usize, with_truth: bool) -> HeldOutSequence {
    let mut touches = vec![Vec::new(); frames];
    for touch in &made.truth.touches {
        let (position_m, force_n) = (touch.position_m, touch.force_n);
        touches[touch.frame].push(Press { position_m, force_n });
    }
    let truth = with_truth.then_some(made.truth.conductivity_change_s);
    HeldOutSequence { name: "", values: made.frames_v, truth, touches }
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
