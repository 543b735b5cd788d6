//! Forces learnt from a dozen presses of known force on the same fabric.

use super::SEED;
use crate::error::ReportError;
use eit_fem::fabric::{
    Finger, Interpolation, Key, PlayCircle, SimulationSettings, Tip, TouchScript,
};
use eit_skin::learn::{Frame, LearnedSkin, Press, PressFrames, PressTable};
use eit_skin::{Progress, Skin};
use std::sync::Arc;

/// Number of presses; the tutorial asks for a dozen.
const PRESSES: usize = 12;
/// Smallest and largest force, newtons; the experiments press with 1.5 N.
const FORCES_N: [f64; 2] = [0.5, 2.5];
/// Radius of the fingertip, metres, and the share of the skin's radius within which it presses.
const TIP_M: f64 = 0.01;
const WITHIN: f64 = 0.8;
/// Seconds, and frames, from one press to the next: reached after 2, held until 8, lifted after 10.
const PERIOD_S: usize = 14;
/// Frames of the untouched skin before the first press.
const QUIET: usize = 20;
/// Angle between presses that fill a disc evenly, radian (Vogel, Math. Biosci. 44:179, 1979).
const GOLDEN_RAD: f64 = 2.399_963_229_728_653;

/// Presses the fabric of a recording and returns the bytes of the file of what is learnt from it.
pub(super) fn learn(
    skin: &Skin,
    simulating: &Skin,
    progress: &mut Progress,
) -> Result<Vec<u8>, ReportError> {
    let circle = PlayCircle::of(&simulating.mesh);
    let (mut keys, mut presses) = (Vec::new(), Vec::new());
    for press in 0..PRESSES {
        let (part, angle) = ((press as f64 + 0.5) / PRESSES as f64, GOLDEN_RAD * press as f64);
        let reach_m = WITHIN * circle.radius_m * part.sqrt();
        let [x_m, y_m] = [
            circle.centre_m[0] + reach_m * angle.cos(),
            circle.centre_m[1] + reach_m * angle.sin(),
        ];
        // in an order that does not follow the places
        let share = ((5 * press) % PRESSES) as f64 / (PRESSES - 1) as f64;
        let force = FORCES_N[0] * (FORCES_N[1] / FORCES_N[0]).powf(share);
        let first = QUIET + PERIOD_S * press;
        for (after_s, force_n) in [(0.0, 0.0), (2.0, force), (8.0, force), (10.0, 0.0)] {
            let time_s = first as f64 + after_s;
            keys.push(Key { time_s, position_m: [x_m, y_m], force_n, radius_m: TIP_M });
        }
        presses.push(Press {
            x_m,
            y_m,
            force_n: Some(force),
            first_frame: Some(first + 4),
            last_frame: Some(first + 7),
            before_first: Some(first - 2),
            before_last: Some(first),
            ..Default::default()
        });
    }
    let (tip, interpolation) = (Tip::Round, Interpolation::Linear);
    let script = TouchScript {
        name: "presses".to_owned(),
        frame_rate_hz: 1.0,
        frames: QUIET + PERIOD_S * PRESSES,
        quiet_frames: QUIET,
        fingers: vec![Finger { id: 1, tip, interpolation, keys }],
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let how = SimulationSettings { seed: SEED, threads, keep_elements: false };
    let (fabric, raster) = (simulating.simulated_fabric()?, simulating.raster(progress)?);
    let made = progress.steps("simulate presses", script.frames, |bar| {
        fabric.simulate(&script, &raster, &how, &mut |done| bar.set_position(done))
    })?;
    let frames = skin.frames_of_values(&made.frames_v)?;
    let fitted = Arc::new(skin.linearise(progress)?).fit(frames)?;
    let pressed = PressFrames::new(&PressTable::new(presses, "presses")?, &fitted.frames)?;
    let learning = LearnedSkin::learn(&fitted, &pressed, Frame::Scene, None, progress)?;
    Ok(learning.skin.to_bytes()?)
}
