//! Determines a board's protocol from what it prints.

use super::ask::say;
use super::{CLEAR, Found, UNLIKE, presses};
use crate::cli::InitArgs;
use crate::commands::prelude::*;
use eit_fem::PairProtocol;
use eit_hw::Endpoint;
use eit_hw::driver::{Heard, listen};
use eit_skin::first_scene::{FirstScene, FittingProtocol, fitting_protocols};
use eit_skin::scene::ValueKind;
use std::collections::BTreeSet;

/// Fraction of binary bytes above which the output is not text.
const BINARY: f64 = 0.1;
/// Correlation with the model from which values are voltages without doubt, as for frames of a recording, ...
const ALIKE: f64 = 0.9;
/// ... and from which they are something else instead: that of electrodes up to 0.3 of their spacing off is 0.955.
const CLEARLY: f64 = 0.95;

/// Listens to the board, finds a matching protocol, and asks for presses.
pub(super) fn find(args: &InitArgs, port: &str, first: &mut FirstScene) -> Result<Found, CliError> {
    let mut found = Found::default();
    let endpoint = Endpoint::parse(port, args.baud)?;
    say(&format!("listening to {port} for {} s: do not touch the skin", args.listen_s));
    let mut progress = progress::terminal();
    let time = Duration::from_secs_f64(args.listen_s);
    let mut heard = progress.stage("listen", || listen(&endpoint, time))?;
    let is_heard = |heard: &Heard| heard.frame_lines >= 2 || heard.joined.is_some();
    if !is_heard(&heard) && heard.bytes > 0 && heard.binary_share <= BINARY {
        // a line may take a second or more
        say("a slow board: listening for 15 s more");
        heard = progress.stage("listen", || listen(&endpoint, Duration::from_secs(15)))?;
    }
    let mut rivals = Vec::new();
    if is_heard(&heard) {
        rivals = progress.stage("patterns that fit", || text_board(&heard, first, &mut found))?;
    } else {
        other_board(port, &heard, first, &mut found)?;
    }
    if !args.no_presses {
        // before the presses, which may take a while; the answer has them again, with what the presses tell
        found.lines.iter().for_each(|line| say(line));
        presses::find(args, first, &rivals, &mut found)?;
    } else if let Some(rival) =
        rivals.iter().find(|rival| Some(rival.correlation) >= found.correlation)
    {
        // one that is as good, and less usual
        found.warnings.push(format!("as likely, but less usual, is {}", description(rival)));
    }
    if let Some([one, other]) = found.swapped.map(|pair| pair.map(|electrode| electrode + 1)) {
        found.warnings.push(format!(
            "the wires of electrodes {one} and {other} look exchanged: exchange them, and run this again"
        ));
    }
    Ok(found)
}

/// Finds the protocol and order for a board that prints lines of numbers; returns the other protocols that
/// match as well.
fn text_board(
    heard: &Heard,
    first: &mut FirstScene,
    found: &mut Found,
) -> Result<Vec<FittingProtocol>, CliError> {
    // lines are frames if a protocol has as many values
    let is_frame = |values| eit_skin::first_scene::is_frame(values, first.electrodes);
    let joined =
        heard.joined.as_deref().filter(|joined| !is_frame(heard.values) && is_frame(joined.values));
    let (heard, of_lines) = match joined {
        Some(joined) => (joined, "in several lines frames of"),
        None => (heard, "lines of"),
    };
    tell_heard(heard, of_lines, found);
    let count = heard.frames.len().max(1) as f64;
    let mean: Vec<f64> = (0..heard.values)
        .map(|i| heard.frames.iter().map(|frame| frame[i]).sum::<f64>() / count)
        .collect();
    let (kind, mean, fitting) = fitting_values(mean, first)?;
    if kind != ValueKind::Voltage {
        found.lines.push(format!("Its values are not voltages V but {}.", kind.name().1));
    }
    first.values = kind;
    let Some(best) = fitting.first() else { return Err(no_protocol(&mean, first)) };
    (first.protocol, first.ground) = (best.protocol.clone(), best.ground);
    found.reciprocity = best.reciprocity;
    found.correlation = Some(best.correlation);
    found.swapped = best.swapped;
    found.lines.push(format!("Best match: {}.", description(best)));
    judge(best, first, found)?;
    let is_rival = |next: &&FittingProtocol| {
        next.ground == best.ground
            && next.violates_reciprocity() == best.violates_reciprocity()
            && best.correlation - next.correlation < CLEAR
    };
    Ok(fitting[1..].iter().filter(is_rival).cloned().collect())
}

/// Tells what the board prints.
fn tell_heard(heard: &Heard, of_lines: &str, found: &mut Found) {
    let values = heard.values;
    (found.values, found.rate_hz) = (Some(values), heard.rate_hz);
    let rate = heard.rate_hz.map_or(String::new(), |rate| format!(" at {rate:.1} a second"));
    let step = heard.step().map_or(String::new(), |step| format!(", smallest change {step:.2e}"));
    found.lines.push(format!("The board prints {of_lines} {values} numbers{rate}{step}."));
    let around = heard.stripped.iter();
    found.lines.extend(around.map(|what| format!("Left out around the numbers: {what}.")));
    if let Some(example) = heard.other_line.as_deref().filter(|_| heard.other_lines > 0) {
        let (other, all) = (heard.other_lines, heard.other_lines + heard.frame_lines);
        let warning = format!("{other} of {all} lines were not frames, such as \"{example}\"");
        found.warnings.push(warning);
    }
}

/// Tells how well the best protocol fits, and what the fabric's weave is if the contacts do not hide it.
fn judge(best: &FittingProtocol, first: &FirstScene, found: &mut Found) -> Result<(), CliError> {
    if let Some(off) = best.off {
        found.warnings.push(format!(
            "value {} of every drive is off: without these the reciprocity error is {:.3}. The board may measure before its \
             switches have settled",
            off.place + 1,
            off.reciprocity
        ));
    }
    let is_poor = best.violates_reciprocity() || best.correlation < UNLIKE;
    let weave = match is_poor || best.swapped.is_some() {
        true => None,
        false => Skin::from_scene(first.scene()?)?
            .find_weave(&best.values, &vec![true; best.values.len()])?,
    };
    found.lines.extend(weave.map(|weave| format!("The fabric {}.", weave.weave.description())));
    if is_poor {
        let warning = "no protocol fits well: a contact may be open (`eit check`), the board may use its own order of \
                       the values ([protocol] quadruples_file), or the electrodes may not be equally spaced";
        found.warnings.push(warning.to_owned());
    } else if best.correlation < 0.97 && weave.is_none() && best.off.is_none() {
        // places on a rectangle that are off by up to 0.3 of the spacing give 0.955, equally spaced ones 0.99 and more
        found.warnings.push(format!(
            "the untouched skin matches equally spaced electrodes only to {:.2}: if yours are not equally spaced, measure \
             where they are and give [electrodes] positions_m (docs/SCENE.md)",
            best.correlation
        ));
    }
    Ok(())
}

/// What the values are, the voltages, and the protocols that fit them: voltages, unless another reading fits well and they do not.
fn fitting_values(
    mean: Vec<f64>,
    first: &FirstScene,
) -> Result<(ValueKind, Vec<f64>, Vec<FittingProtocol>), CliError> {
    let fit = |voltages: &[f64]| fitting_protocols(voltages, first.outline, Some(first.electrodes));
    let is_good = |fitting: &[FittingProtocol], least: f64| {
        fitting
            .first()
            .is_some_and(|best| !best.violates_reciprocity() && best.correlation >= least)
    };
    let fitting = fit(&mean)?;
    if fitting.is_empty() || is_good(&fitting, ALIKE) {
        return Ok((ValueKind::Voltage, mean, fitting));
    }
    for kind in ValueKind::ALL.into_iter().filter(|kind| *kind != ValueKind::Voltage) {
        let voltages: Vec<f64> = mean.iter().map(|value| kind.voltage(*value)).collect();
        if voltages.iter().any(|v| !v.is_finite()) {
            continue;
        }
        let other = fit(&voltages)?;
        if is_good(&other, CLEARLY) {
            return Ok((kind, voltages, other));
        }
    }
    Ok((ValueKind::Voltage, mean, fitting))
}

pub(super) fn description(fit: &FittingProtocol) -> String {
    let reciprocity = match fit.reciprocity {
        Some(error) => format!("reciprocity error {error:.3}"),
        None => "no reciprocal pairs".to_owned(),
    };
    let PairProtocol { drive, measure, driven_electrodes, order, .. } = &fit.protocol;
    let pattern = match fit.ground {
        Some(driven) => {
            format!("drive {drive:?}, measured against the sink, driven electrodes {driven:?}")
        }
        None => format!(
            "drive {drive:?}, measured {measure:?}, driven electrodes {driven_electrodes:?}, order {order:?}"
        ),
    };
    let exchanged = fit.swapped.map_or(String::new(), |[one, other]| {
        format!(" once the wires of {} and {} are exchanged", one + 1, other + 1)
    });
    let (pattern, correlation) = (pattern.to_lowercase(), fit.correlation);
    format!("{pattern} ({reciprocity}, correlation with the model {correlation:.3}{exchanged})")
}

/// Explains why no protocol matches, with the numbers of electrodes that would.
fn no_protocol(mean: &[f64], first: &FirstScene) -> CliError {
    let others = fitting_protocols(mean, first.outline, None).unwrap_or_default();
    let counts: BTreeSet<usize> = others.iter().map(|fit| fit.protocol.electrodes).collect();
    let advice = match counts.is_empty() {
        true => "no pair protocol has this number; is each line a whole frame? The order can be given by \
                 [protocol] quadruples_file"
            .to_owned(),
        false => format!("it matches {:?} electrodes: give --electrodes", Vec::from_iter(counts)),
    };
    let (values, electrodes) = (mean.len(), first.electrodes);
    CliError::input(format!(
        "the board prints lines of {values} numbers, which no pair protocol of {electrodes} electrodes has: {advice}"
    ))
}

/// Handles a board that prints no lines of numbers: it may be waiting for a request by EITS-1.
fn other_board(
    port: &str,
    heard: &Heard,
    first: &mut FirstScene,
    found: &mut Found,
) -> Result<(), CliError> {
    "eits1".clone_into(&mut first.driver);
    let scene = first.scene()?;
    let instrument = scene.instrument()?;
    let endpoint = instrument.endpoint(Some(port))?;
    let setup = eit_hw::driver::identify(&mut *instrument.driver()?, &endpoint).map_err(|error| {
        let bytes = heard.bytes;
        let what = match (bytes, heard.binary_share > BINARY) {
            (0, _) => "nothing was received".to_owned(),
            (_, true) => format!(
                "{bytes} bytes were received, {:.0} % of them not text (a binary protocol, or another --baud)",
                100.0 * heard.binary_share
            ),
            (_, false) => {
                let such_as = |line: &String| format!("; such as \"{line}\"");
                let example = heard.other_line.as_ref().map_or(String::new(), such_as);
                format!("{bytes} bytes of text were received, but no two lines of 4 or more numbers{example}")
            }
        };
        CliError::silent(format!(
            "{port}: {what}; request by EITS-1: {error}. For another kind of board, set [instrument] driver in the \
             scene (docs/SCENE.md)"
        ))
    })?;
    (found.values, found.rate_hz) = (Some(setup.value_count), setup.frame_rate_hz);
    found.lines.push(format!(
        "{} answers by EITS-1 and measures what the host sets: adjacent drive and measurement, {} values a frame.",
        setup.identity, setup.value_count
    ));
    Ok(())
}
