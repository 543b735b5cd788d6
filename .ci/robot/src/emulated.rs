//! An emulated instrument that plays a simulated finger.
use eit_skin::eit_fem::fabric::{PlayCircle, SimulationSettings, TouchScript};
use eit_skin::eit_hw::emulator::{Emulator, FaultPlan, Listen};
use eit_skin::emulate::{Content, PlayedFrames, device};
use eit_skin::{Progress, Skin};
use std::error::Error;

/// Number of frames before the first touch: at least those of the reference.
pub const QUIET: usize = 60;

/// Simulates a repeated press in the middle of the skin, and starts the instrument that sends its frames.
pub fn start(skin: &Skin) -> Result<Emulator, Box<dyn Error>> {
    let finer = skin.with_nodes(4000, &mut Progress::silent())?;
    let circle = PlayCircle::of(&finer.mesh);
    let mut script = TouchScript::built_in("press-and-hold", &circle, 1)?;
    let more = QUIET.saturating_sub(script.quiet_frames);
    script.quiet_frames += more;
    script.frames += more;
    let shift_s = more as f64 / script.frame_rate_hz;
    let keys = script.fingers.iter_mut().flat_map(|finger| &mut finger.keys);
    keys.for_each(|key| key.time_s += shift_s);
    let how = SimulationSettings { seed: 1, threads: 2, keep_elements: false };
    let raster = finer.raster(&mut Progress::silent())?;
    let made = finer.simulated_fabric()?.simulate(&script, &raster, &how, &mut |_| {})?;
    let frames = PlayedFrames::Values(&made.frames_v);
    let content = Content { frames, serial: "1", seed: 1, scan_share: 0.0, hold: None };
    let instrument = skin.instrument()?;
    let device = device(skin, &instrument, &content, &mut Progress::silent())?;
    let anywhere = Listen::Tcp("127.0.0.1:0".to_owned());
    Ok(Emulator::start(device, &anywhere, FaultPlan::default())?)
}
