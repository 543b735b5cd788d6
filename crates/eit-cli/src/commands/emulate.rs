//! `eit emulate`: emulates the scene's instrument, to try everything without hardware.

use super::{Answer, record};
use crate::cli::EmulateArgs;
use crate::error::CliError;
use crate::interrupt;
use crate::progress;
use eit_hw::emulator::{Emulator, FaultPlan, Listen};
use eit_skin::emulate::{self, Content, PlayedFrames};
use eit_skin::scene::from_toml;
use eit_skin::{MeshOverride, Scene, Skin};
use serde::Deserialize;
use serde_json::json;
use std::io::Write as _;
use std::time::{Duration, Instant};

/// `--fault KEY=VALUE`, see [`FaultPlan`].
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct FaultKeys {
    spared_bytes: u64,
    drop_byte: f64,
    flip_bit: f64,
    insert_byte: f64,
    pause: f64,
    pause_s: f64,
    unplug_after_bytes: Vec<u64>,
    unplugged_s: f64,
    line_baud: Option<u32>,
}

/// Runs the instrument until Ctrl-C or the end of `--seconds`.
pub(crate) fn run(args: &EmulateArgs, is_json: bool) -> Result<Answer, CliError> {
    let limit = record::duration(args.seconds)?;
    let faults = faults(args)?;
    let listen = listen(&args.port)?;
    let scene = Scene::load(&args.scene)?;
    let mut instrument = scene.instrument()?;
    if let Some(rate_hz) = args.rate_hz {
        if !(rate_hz > 0.0 && rate_hz.is_finite()) {
            return Err(CliError::input(format!("--rate-hz {rate_hz}: it must be above 0")));
        }
        instrument.frame_rate_hz = rate_hz;
    }
    let frames = args.frames.as_deref().map_or(PlayedFrames::Untouched, PlayedFrames::File);
    let content = Content { frames, serial: &args.serial, seed: args.seed };
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let device = emulate::device(&skin, &instrument, &content, &mut progress)?;
    let interrupt = interrupt::listen()?;
    let mut emulator = Emulator::start(device, &listen, faults)?;
    let place = emulator.endpoint().to_string();
    let driver = instrument.driver_name().to_owned();
    if !is_json {
        // flush at once: other programs wait for it
        let mut out = std::io::stdout().lock();
        // a reader that has gone away is not an error
        let _ = writeln!(out, "{driver} at {place}; Ctrl-C stops it").and_then(|()| out.flush());
    }
    let start = Instant::now();
    while !interrupt.is_set() && limit.is_none_or(|limit| start.elapsed() < limit) {
        std::thread::sleep(Duration::from_millis(20));
    }
    emulator.stop();
    let statistics = emulator.statistics();
    Ok(Answer {
        text: format!(
            "{} bytes sent, {} received, {} faults simulated, {:.1} s",
            statistics.sent,
            statistics.received,
            statistics.faults,
            start.elapsed().as_secs_f64()
        ),
        json: json!({
            "driver": driver,
            "port": place,
            "sent_bytes": statistics.sent,
            "received_bytes": statistics.received,
            "faults": statistics.faults,
            "time_s": start.elapsed().as_secs_f64(),
        }),
    })
}

fn listen(port: &str) -> Result<Listen, CliError> {
    if let Some(address) = port.strip_prefix("tcp:") {
        return Ok(Listen::Tcp(address.to_owned()));
    }
    #[cfg(unix)]
    {
        let path = std::path::PathBuf::from(port);
        // a link left by a killed emulator points nowhere
        let led = std::fs::read_link(&path).is_ok_and(|to| to.starts_with("/dev/pts"));
        if led && !path.exists() {
            std::fs::remove_file(&path).map_err(|e| CliError::at(&path, e))?;
        }
        if path.symlink_metadata().is_ok() {
            return Err(CliError::input(format!(
                "--port {port}: exists; name a path that does not exist, or tcp:127.0.0.1:PORT"
            )));
        }
        Ok(Listen::PseudoTerminal(path))
    }
    #[cfg(not(unix))]
    Err(CliError::input(format!("--port {port}: only tcp:127.0.0.1:PORT on this system")))
}

fn faults(args: &EmulateArgs) -> Result<FaultPlan, CliError> {
    let keys: FaultKeys = from_toml(&args.fault.join("\n"), "--fault")?;
    let plan = FaultPlan {
        seed: args.seed,
        spared_bytes: keys.spared_bytes,
        drop_byte: keys.drop_byte,
        flip_bit: keys.flip_bit,
        insert_byte: keys.insert_byte,
        pause: keys.pause,
        pause_s: keys.pause_s,
        unplug_after_bytes: keys.unplug_after_bytes,
        unplugged_s: keys.unplugged_s,
        line_baud: keys.line_baud,
    };
    plan.validate().map_err(|error| CliError::from(error).within("--fault"))?;
    Ok(plan)
}
