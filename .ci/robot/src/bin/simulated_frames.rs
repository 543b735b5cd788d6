//! Simulates frames of a finger, with ground truth.
use eit_skin::eit_fem::fabric::{PlayCircle, SimulationSettings, TouchScript};
use eit_skin::{Progress, Skin};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let skin = Skin::load("paper-disc")?;
    let script = TouchScript::built_in("tapping", &PlayCircle::of(&skin.mesh), 7)?;
    let raster = skin.raster(&mut Progress::silent())?;
    let how = SimulationSettings { seed: 7, threads: 2, keep_elements: false };
    let made = skin.simulated_fabric()?.simulate(&script, &raster, &how, &mut |_| {})?;
    let (frames, touches) = (made.frames_v.nrows(), made.truth.touches.len());
    println!("{frames} frames of {} voltages, {touches} touches", made.frames_v.ncols());
    assert!(touches > 0, "nobody touched the skin");
    Ok(())
}
