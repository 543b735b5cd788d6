//! `eit emulate`: emulates the scene's instrument, to try everything without hardware.

use crate::cli::EmulateArgs;
use crate::commands::prelude::*;
use eit_hw::emulator::{Emulator, FaultPlan, Listen};
use eit_skin::emulate::{self, Content, PlayedFrames};
use eit_skin::scene::from_toml;
use std::io::Write as _;

/// Runs the instrument until Ctrl-C or the end of `--seconds`.
pub(super) fn run(args: &EmulateArgs) -> Result<Answer, CliError> {
    let mut until = Until::new(args.seconds)?;
    let faults = faults(args)?;
    let listen = listen(&args.port)?;
    let scene = Scene::load(&args.scene)?;
    let mut instrument = scene.instrument()?;
    if let Some(rate_hz) = args.rate_hz {
        check_option("--rate-hz", rate_hz, rate_hz > 0.0 && rate_hz.is_finite(), "above 0")?;
        instrument.frame_rate_hz = rate_hz;
    }
    let frames = args.frames.as_deref().map_or(PlayedFrames::Untouched, PlayedFrames::File);
    let (serial, seed, scan_share) = (args.serial.as_str(), args.seed, args.scan_share);
    let content = Content { frames, serial, seed, scan_share, hold: None };
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let device = emulate::device(&skin, &instrument, &content, &mut progress)?;
    let mut emulator = Emulator::start(device, &listen, faults)?;
    let (port, driver) = (emulator.endpoint().to_string(), instrument.driver_name());
    if !terminal::flags().is_json {
        // flush at once: other programs wait for it
        let mut out = std::io::stdout().lock();
        // a reader that has gone away is not an error
        let _ = writeln!(out, "{driver} at {port}; Ctrl-C stops it").and_then(|()| out.flush());
    }
    until.restart();
    while !until.is_over() {
        std::thread::sleep(Duration::from_millis(20));
    }
    emulator.stop();
    let (statistics, time_s) = (emulator.statistics(), until.start.elapsed().as_secs_f64());
    let (sent, received, faults) = (statistics.sent, statistics.received, statistics.faults);
    Ok(Answer {
        text: format!(
            "{sent} bytes sent, {received} received, {faults} faults simulated, {time_s:.1} s"
        ),
        json: json!({
            "driver": driver,
            "port": port,
            "sent_bytes": sent,
            "received_bytes": received,
            "faults": faults,
            "time_s": time_s,
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

/// The faults of `--fault KEY=VALUE`; the seed is that of the noise.
fn faults(args: &EmulateArgs) -> Result<FaultPlan, CliError> {
    let plan: FaultPlan = from_toml(&args.fault.join("\n"), "--fault")?;
    let plan = FaultPlan { seed: args.seed, ..plan };
    plan.validate().map_err(|error| CliError::from(error).within("--fault"))?;
    Ok(plan)
}
