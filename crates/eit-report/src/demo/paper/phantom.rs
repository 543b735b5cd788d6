//! A phantom: the same disc with an inclusion, whose electrodes do not move, measured by the same instrument.

use super::{SEED, Shown};
use crate::error::ReportError;
use eit_fem::fabric::{Finger, LinearResponse, SimulationSettings, Tip};
use eit_skin::scene::Scene;
use eit_skin::{Progress, Skin};
use ndarray::{Array2, Axis};

/// Number of frames of the phantom with its inclusion.
const FRAMES: usize = 3;
/// Change of the inclusion's conductivity, relative: that of a touch of 1.5 N on the fabric.
const CHANGE: f64 = 0.3;

/// Returns the image by equation (7) of an inclusion where the finger is in the second snapshot.
pub(super) fn image(
    scene: &Scene,
    skin: &Skin,
    shown: &Shown,
    progress: &mut Progress,
) -> Result<Array2<f64>, ReportError> {
    let of_fabric = &shown.recording;
    let mut fabric = scene.fabric.clone().unwrap_or_default();
    let (mut script, quiet) = (of_fabric.script.clone(), of_fabric.script.quiet_frames);
    let frame = shown.snapshots.get(1).copied().unwrap_or(quiet);
    let touches = script.touches(frame);
    let Some(touch) = touches.first() else {
        return Err(ReportError::Failure("no finger in the second snapshot".to_owned()));
    };
    fabric.linear = Some(LinearResponse { change_per_newton: CHANGE / touch.force_n });
    // a flat tip is a disc with a sharp edge
    script.fingers.truncate(1);
    for Finger { tip, keys, .. } in &mut script.fingers {
        *tip = Tip::Flat;
        keys.iter_mut().for_each(|key| key.position_m = touch.position_m);
    }
    script.frames = frame + FRAMES;
    let simulating = &of_fabric.skin;
    let how = SimulationSettings { seed: SEED, threads: 1, keep_elements: false };
    let made = progress.steps("phantom", script.frames, |bar| {
        let fabric = simulating.fabric_with(&fabric)?;
        let mut tick = |done| bar.set_position(done);
        Ok::<_, ReportError>(fabric.simulate(&script, &of_fabric.raster, &how, &mut tick)?)
    })?;
    let skin = of_fabric.described(skin.clone());
    let frames = skin.frames_of_values(&made.frames_v)?;
    let images = skin.reconstruct(frames, None, progress)?.images.values;
    Ok(images.index_axis(Axis(0), frame).to_owned())
}
