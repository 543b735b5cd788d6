//! `eit report`

use super::Answer;
use crate::cli::{ReportArgs, TouchPart};
use crate::error::CliError;
use crate::{interrupt, progress};
use eit_report::settings::{self, ReportSettings};

/// Runs the requested report until its end or Ctrl-C.
pub(crate) fn run(args: &ReportArgs) -> Result<Answer, CliError> {
    let part = |part: &TouchPart| match part {
        TouchPart::All => settings::TouchPart::All,
        TouchPart::Reliability => settings::TouchPart::Reliability,
        TouchPart::Position => settings::TouchPart::Position,
        TouchPart::Movement => settings::TouchPart::Movement,
        TouchPart::Electrodes => settings::TouchPart::Electrodes,
        TouchPart::Pairs => settings::TouchPart::Pairs,
        TouchPart::Tracks => settings::TouchPart::Tracks,
        TouchPart::Greit => settings::TouchPart::Greit,
        TouchPart::Latency => settings::TouchPart::Latency,
    };
    let settings = ReportSettings {
        out: args.out.clone(),
        quick: args.quick,
        quality: args.quality,
        touches: args.touches.iter().map(part).collect(),
        denoise: args.denoise,
        scenes: args.scenes.clone(),
        plans: args.plans,
        forward: args.forward,
        images: args.images,
        peers: args.peers.clone(),
        weights: args.weights.clone(),
        method: args.method.clone(),
        seed: args.seed,
    };
    let stop = interrupt::listen()?;
    Ok(eit_report::report::run(&settings, &stop, &mut progress::terminal())?)
}
