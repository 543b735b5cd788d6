//! One file per command. A command returns its result as text and as JSON.

#[cfg(feature = "zenoh")]
mod body;
mod calibrate;
mod check;
mod demo;
mod electrode_watch;
mod emulate;
mod frame_rate;
mod init;
mod learn;
mod live;
mod mesh;
mod net;
mod network;
mod plan;
mod publish;
mod record;
mod recorder;
mod replay;
mod shell;
mod silence;
#[cfg(feature = "train")]
mod train;
mod view;
mod viewer;

use crate::cli::{
    Command, ConvertArgs, ReconstructArgs, ReportArgs, SimulateArgs, SolveArgs, WatchArgs,
};
use eit_report::output::ending;
use eit_report::settings::{
    ConvertSettings, ReconstructSettings, ReportSettings, SimulationFiles, Solution, SolveSettings,
};
use eit_skin::simulate::SimulateSettings;
use prelude::*;
use serde::Serialize;

pub(crate) use eit_report::Answer;

/// What most commands use.
mod prelude {
    pub(super) use super::{
        Answer, Ended, SHUTDOWN_WAIT, Until, check_ending, check_option, joined,
    };
    pub(super) use crate::error::{CliError, Exit};
    pub(super) use crate::{interrupt, progress, terminal};
    pub(super) use eit_report::output::OutFile;
    pub(super) use eit_skin::{MeshOverride, Progress, Scene, Skin, StopFlag};
    pub(super) use serde_json::{Value, json};
    pub(super) use std::path::{Path, PathBuf};
    pub(super) use std::sync::Arc;
    pub(super) use std::time::{Duration, Instant};
}

/// How often to check for shutdown.
const SHUTDOWN_WAIT: Duration = Duration::from_millis(50);

/// A command's result, and the exit code.
pub(crate) struct Ended {
    pub(crate) answer: Answer,
    pub(crate) exit: Exit,
}

impl From<Answer> for Ended {
    fn from(answer: Answer) -> Self {
        Self { answer, exit: Exit::Done }
    }
}

/// Runs a command.
pub(crate) fn run(command: Command) -> Result<Ended, CliError> {
    Ok(match command {
        Command::Demo(args) => demo::run(&args)?.into(),
        Command::Plan(args) => plan::run(&args)?.into(),
        Command::Mesh(args) => mesh::run(&args)?.into(),
        Command::Forward(args) => args.run(Solution::Voltages, &["npy", "csv"])?.into(),
        Command::Jacobian(args) => args.run(Solution::Jacobian, &["npy"])?.into(),
        Command::Calibrate(args) => calibrate::run(&args)?.into(),
        Command::Init(args) => init::run(&args)?.into(),
        Command::Learn(args) => learn::run(&args)?,
        Command::Simulate(SimulateArgs { scene, script, seed, frames, nodes, threads, out }) => {
            let simulation = SimulateSettings { script, seed, frames, nodes, threads };
            let settings = SimulationFiles { scene, simulation, out };
            eit_report::simulated::run(&settings, &mut progress::terminal())?.into()
        }
        Command::Reconstruct(ReconstructArgs { scene, frames, reference, method, out }) => {
            let settings = ReconstructSettings { scene, frames, reference, method, out };
            eit_report::reconstruct::run(&settings, &mut progress::terminal())?.into()
        }
        Command::Net(command) => net::run(command)?.into(),
        Command::Report(ReportArgs { out, full, scenes, forward, images, weights }) => {
            let stop = interrupt::listen()?;
            let settings = ReportSettings { out, full, scenes, forward, images, weights };
            eit_report::report::run(&settings, &stop, &mut progress::terminal())?.into()
        }
        Command::Check(args) => check::run(&args)?,
        Command::Record(args) => record::run(&args)?,
        Command::Live(args) => live::run(&args)?,
        #[cfg(feature = "zenoh")]
        Command::Body(args) => body::run(&args)?.into(),
        #[cfg(not(feature = "zenoh"))]
        Command::Body(_) => return Err(built_without("zenoh", "zenoh")),
        Command::Replay(args) => replay::run(&args)?.into(),
        Command::Convert(ConvertArgs { input, out, scene, complex, recover }) => {
            check_ending(&out, if recover { &["mcap"] } else { &["mcap", "csv", "npy"] })?;
            let settings = ConvertSettings { input, out, scene, complex, recover };
            eit_report::convert::run(&settings)?.into()
        }
        Command::Emulate(args) => emulate::run(&args)?.into(),
        Command::Completions(args) => shell::completions(&args).into(),
        Command::Man(args) => shell::man(&args)?.into(),
    })
}

impl SolveArgs {
    fn run(self, wanted: Solution, endings: &[&str]) -> Result<Answer, CliError> {
        let Self { scene, mesh, conductivity, accuracy, out } = self;
        check_ending(&out, endings)?;
        let settings = SolveSettings { scene, mesh, conductivity, accuracy, wanted, out };
        Ok(eit_report::solve::run(&settings, &mut progress::terminal())?)
    }
}

/// The error of what this program was built without, before any work.
#[cfg(not(all(feature = "train", feature = "zenoh", feature = "foxglove")))]
fn built_without(what: &str, feature: &str) -> CliError {
    CliError::input(format!(
        "this eit was built without {what}: build it with cargo install --path crates/eit-cli --features {feature}"
    ))
}

/// Rejects a value of an option that is not `wanted`.
fn check_option(
    option: &str,
    value: impl std::fmt::Display,
    is_valid: bool,
    wanted: &str,
) -> Result<(), CliError> {
    match is_valid {
        true => Ok(()),
        false => Err(CliError::input(format!("{option} {value}: it must be {wanted}"))),
    }
}

/// Rejects `--frames 0`, which could not be told from a silent instrument.
fn check_frames(frames: Option<u64>) -> Result<(), CliError> {
    let wanted = "above 0; leave it out for no limit";
    check_option("--frames", 0, frames != Some(0), wanted)
}

/// When a live command ends: after `--seconds`, or with Ctrl-C.
#[derive(Debug, Clone)]
struct Until {
    start: Instant,
    limit: Option<Duration>,
    stop: StopFlag,
}

impl Until {
    /// The time counts from now on, or from [`restart`](Self::restart).
    fn new(seconds: Option<f64>) -> Result<Self, CliError> {
        let limit = seconds.map(|s| Duration::try_from_secs_f64(s).unwrap_or_default());
        let is_valid = limit.is_none_or(|limit| !limit.is_zero());
        check_option("--seconds", seconds.unwrap_or_default(), is_valid, "above 0")?;
        Ok(Self { start: Instant::now(), limit, stop: interrupt::listen()? })
    }

    fn restart(&mut self) {
        self.start = Instant::now();
    }

    fn is_over(&self) -> bool {
        self.stop.is_set() || self.limit.is_some_and(|limit| self.start.elapsed() >= limit)
    }
}

/// Rejects a file name extension of `--out` that the command does not write.
fn check_ending(path: &Path, known: &[&str]) -> Result<String, CliError> {
    check_ending_of("--out", path, known)
}

/// Rejects a file name extension of an option that the command does not write.
fn check_ending_of(option: &str, path: &Path, known: &[&str]) -> Result<String, CliError> {
    let found = ending(path);
    if known.contains(&found.as_str()) {
        return Ok(found);
    }
    let message = format!("{}: {option} must end in .{}", path.display(), known.join(" or ."));
    Err(CliError::input(message))
}

/// Rejects arguments of `eit live` and `eit replay` that need no scene, before any work.
fn check_watch(args: &WatchArgs) -> Result<(), CliError> {
    check_frames(args.frames)?;
    // the picture is always PNG, which another name would hide
    args.picture
        .iter()
        .try_for_each(|picture| check_ending_of("--picture", picture, &["png"]).map(|_format| ()))
}

/// Returns a JSON object with further fields.
fn joined(mut json: Value, more: impl Serialize) -> Value {
    if let (Some(fields), Ok(Value::Object(more))) =
        (json.as_object_mut(), serde_json::to_value(more))
    {
        fields.extend(more);
    }
    json
}
