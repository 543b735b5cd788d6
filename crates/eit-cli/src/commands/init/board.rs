//! What a board tells: its protocol by what it prints, the numbering of the electrodes by presses.

use super::ask::Questions;
use super::{CLEAR, Found, UNLIKE};
use crate::cli::InitArgs;
use crate::error::CliError;
use crate::progress;
use eit_fem::PairProtocol;
use eit_hw::Endpoint;
use eit_hw::driver::{Event, Heard, Overflow, Session, listen};
use eit_skin::connect;
use eit_skin::first_scene::{
    FirstScene, FittingProtocol, KnownPress, PressState, PressWatch, find_numbering,
    fitting_protocols,
};
use eit_skin::scene::{Direction, TouchSign};
use std::time::{Duration, Instant};

/// Frames of the untouched skin, at least and over this time.
const UNTOUCHED_FRAMES: usize = 20;
const UNTOUCHED_S: f64 = 2.0;
/// How long a press must be held, seconds.
const HOLD_S: f64 = 0.5;
/// Longest wait for the first frames.
const FRAMES_WAIT: Duration = Duration::from_secs(20);
/// More of this in the bytes is no text.
const BINARY: f64 = 0.1;

/// Listens, finds what fits, and asks for presses.
pub(super) fn find(
    args: &InitArgs,
    port: &str,
    first: &mut FirstScene,
    questions: &Questions,
) -> Result<Found, CliError> {
    let mut found = Found::default();
    let endpoint = Endpoint::parse(port, args.baud)?;
    questions.say(&format!("listening to {port} for {} s: touch nothing", args.listen_s));
    let mut progress = progress::terminal();
    let heard =
        progress.stage("listen", || listen(&endpoint, Duration::from_secs_f64(args.listen_s)));
    let heard = heard?;
    let mut rivals = Vec::new();
    if heard.frame_lines >= 2 {
        rivals = text_board(&heard, first, &mut found)?;
    } else {
        other_board(port, &heard, first, &mut found)?;
    }
    found.lines.iter().for_each(|line| questions.say(line));
    if !args.no_presses {
        numbering(args, first, &rivals, &mut found, questions)?;
    } else if let Some(rival) = rivals.first() {
        found.warnings.push(format!("as likely is {}", words(rival)));
    }
    Ok(found)
}

/// A board that prints lines of numbers: which protocol has so many, in which order. The others that fit
/// as well.
fn text_board(
    heard: &Heard,
    first: &mut FirstScene,
    found: &mut Found,
) -> Result<Vec<FittingProtocol>, CliError> {
    found.values = Some(heard.values);
    found.rate_hz = heard.rate_hz;
    let rate = heard.rate_hz.map_or(String::new(), |rate| format!(" at {rate:.1} a second"));
    let step = heard.step().map_or(String::new(), |step| format!(", smallest change {step:.2e}"));
    found.lines.push(format!("The board prints lines of {} numbers{rate}{step}.", heard.values));
    if heard.other_lines > 0 {
        let example = heard.other_line.as_deref().unwrap_or_default();
        let message = format!(
            "{} of {} lines were no frames, such as \"{example}\"",
            heard.other_lines,
            heard.other_lines + heard.frame_lines
        );
        found.warnings.push(message);
    }
    let count = heard.frames.len().max(1) as f64;
    let mean: Vec<f64> = (0..heard.values)
        .map(|i| heard.frames.iter().map(|frame| frame[i]).sum::<f64>() / count)
        .collect();
    let fitting = fitting_protocols(&mean, first.outline, Some(first.electrodes))?;
    let Some(best) = fitting.first() else {
        return Err(no_protocol(heard.values, &mean, first));
    };
    first.protocol = best.protocol.clone();
    found.reciprocity = best.reciprocity;
    found.correlation = Some(best.correlation);
    found.lines.push(format!("What fits best: {}.", words(best)));
    if best.is_doubted() || best.correlation < UNLIKE {
        found.warnings.push(
            "no protocol fits well: a contact may be open (`eit check`), the order of the values may be \
             one of the board's own ([protocol] quadruples_file), or the electrodes are not equally spaced"
                .to_owned(),
        );
    }
    let is_rival = |next: &&FittingProtocol| {
        next.is_doubted() == best.is_doubted() && best.correlation - next.correlation < CLEAR
    };
    Ok(fitting[1..].iter().filter(is_rival).cloned().collect())
}

fn words(fit: &FittingProtocol) -> String {
    let reciprocity = match fit.reciprocity {
        Some(error) => format!("reciprocity error {error:.3}"),
        None => "no reciprocal pairs".to_owned(),
    };
    let PairProtocol { drive, measure, driven_electrodes, order, .. } = &fit.protocol;
    let pattern = format!(
        "drive {drive:?}, measured {measure:?}, driven electrodes {driven_electrodes:?}, order {order:?}"
    );
    format!(
        "{} ({reciprocity}, correlation with the model {:.3})",
        pattern.to_lowercase(),
        fit.correlation
    )
}

/// Why no protocol fits, with the numbers of electrodes that would.
fn no_protocol(values: usize, mean: &[f64], first: &FirstScene) -> CliError {
    let others = fitting_protocols(mean, first.outline, None).unwrap_or_default();
    let mut counts: Vec<usize> = others.iter().map(|fit| fit.protocol.electrodes).collect();
    counts.sort_unstable();
    counts.dedup();
    let advice = match counts[..] {
        [] => "no pair protocol has so many; is a line a whole frame? The order can be told by \
               [protocol] quadruples_file"
            .to_owned(),
        _ => format!("it fits {counts:?} electrodes: give --electrodes"),
    };
    CliError::input(format!(
        "the board prints lines of {values} numbers, which no pair protocol of {} electrodes has: {advice}",
        first.electrodes
    ))
}

/// A board that prints no lines of numbers: one that waits to be asked, by EITS-1, or none.
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
    match eit_hw::driver::identify(&mut *instrument.driver()?, &endpoint) {
        Ok(setup) => {
            found.values = Some(setup.value_count);
            found.rate_hz = setup.frame_rate_hz;
            found.lines.push(format!(
                "{} answers by EITS-1 and measures what it is told: adjacent drive and measurement, {} \
                 values a frame.",
                setup.identity, setup.value_count
            ));
            Ok(())
        }
        Err(error) => {
            let what = match (heard.bytes, heard.binary_share > BINARY) {
                (0, _) => "nothing came".to_owned(),
                (bytes, true) => format!(
                    "{bytes} bytes came, {:.0} % of them no text (a binary protocol, or another --baud)",
                    100.0 * heard.binary_share
                ),
                (bytes, false) => format!(
                    "{bytes} bytes of text came, no two lines of 4 or more numbers; such as \"{}\"",
                    heard.other_line.as_deref().unwrap_or_default()
                ),
            };
            Err(CliError::Silent(format!(
                "{port}: {what}; asked by EITS-1: {error}. A board of another kind is named in the scene: \
                 [instrument] driver (docs/SCENE.md)"
            )))
        }
    }
}

/// Which electrode is the first, from two presses.
fn numbering(
    args: &InitArgs,
    first: &mut FirstScene,
    rivals: &[FittingProtocol],
    found: &mut Found,
    questions: &Questions,
) -> Result<(), CliError> {
    let scene = first.scene()?;
    let instrument = scene.instrument()?;
    let mut session = connect::open(&instrument, args.port.as_deref(), Overflow::Fail)?;
    questions.say("taking the untouched skin: touch nothing");
    let untouched = untouched(&mut session)?;
    let rate_hz = untouched.len() as f64 / UNTOUCHED_S;
    let window = ((HOLD_S * rate_hz) as usize).clamp(4, 1000);
    let mut watch = PressWatch::new(&untouched, window)?;
    let reference = watch.reference().to_vec();
    let mut presses = Vec::new();
    for (at, place_m) in first.outline.press_places_m().into_iter().enumerate() {
        let [x, y] = place_m.map(|m| m * 1e3);
        let (from, side) = if at == 0 { (x, "right") } else { (y, "top") };
        questions.say(&format!(
            "press {} of 2: {from:.0} mm from the centre towards the {side}, with a finger; hold it",
            at + 1
        ));
        let wait = Duration::from_secs_f64(args.press_wait_s);
        let change = held(&mut session, &mut watch, wait)?.ok_or_else(|| {
            CliError::Failure(format!(
                "no press was held within {} s at ({x:.0}, {y:.0}) mm: press harder and hold still, or give \
                 --no-presses",
                args.press_wait_s
            ))
        })?;
        questions.say("seen; let go");
        released(&mut session, &mut watch, wait)?;
        presses.push(KnownPress { place_m, change });
    }
    session.stop();
    let mut numbering = find_numbering(first, &reference, &presses)?;
    // protocols that the untouched skin does not tell apart: the presses do
    for rival in rivals {
        let other = FirstScene { protocol: rival.protocol.clone(), ..first.clone() };
        let of_other = find_numbering(&other, &reference, &presses)?;
        let is_better = of_other.likeness > numbering.likeness;
        let (likeness, next) = match is_better {
            true => (of_other.likeness, numbering.likeness),
            false => (numbering.likeness, of_other.likeness),
        };
        if is_better {
            found.lines.push(format!("The presses are more like {}.", words(rival)));
            (numbering, first.protocol) = (of_other, other.protocol);
        }
        (numbering.likeness, numbering.next_likeness) =
            (likeness, numbering.next_likeness.max(next));
    }
    first.first_angle_deg = numbering.first_angle_deg;
    first.direction = numbering.direction;
    first.sign = numbering.sign;
    let worst_m = numbering.errors_m.iter().copied().fold(0.0, f64::max);
    let counted = match numbering.direction {
        Direction::Counterclockwise => "counter-clockwise",
        Direction::Clockwise => "clockwise",
    };
    let changes = match numbering.sign {
        TouchSign::Increase => "raises",
        TouchSign::Decrease => "lowers",
    };
    found.lines.push(format!(
        "Two presses: electrode 1 is at {:.1} degrees, counted {counted}; a touch {changes} the \
         conductivity (likeness to the model {:.2}, next best numbering {:.2}; presses are found up to \
         {:.0} mm off).",
        numbering.first_angle_deg,
        numbering.likeness,
        numbering.next_likeness,
        worst_m * 1e3
    ));
    if numbering.likeness < UNLIKE || numbering.likeness - numbering.next_likeness < CLEAR {
        found.warnings.push(
            "the presses do not tell the numbering for certain: press with one fingertip exactly at the \
             places, or set first_angle_deg and direction by hand"
                .to_owned(),
        );
    }
    found.numbering = Some(numbering);
    Ok(())
}

/// Frames of the untouched skin.
fn untouched(session: &mut Session) -> Result<Vec<Vec<f64>>, CliError> {
    let (start, mut frames, mut first) = (Instant::now(), Vec::new(), None::<Instant>);
    while first.is_none_or(|first| {
        frames.len() < UNTOUCHED_FRAMES || first.elapsed().as_secs_f64() < UNTOUCHED_S
    }) {
        if start.elapsed() > FRAMES_WAIT {
            let message = format!(
                "{} frames of the untouched skin came within {} s, {UNTOUCHED_FRAMES} are needed",
                frames.len(),
                FRAMES_WAIT.as_secs()
            );
            return Err(CliError::Silent(message));
        }
        if let Some(frame) = next(session)? {
            first.get_or_insert_with(Instant::now);
            frames.push(frame);
        }
    }
    Ok(frames)
}

/// The change of the next press that is held; `None` where none came in time.
fn held(
    session: &mut Session,
    watch: &mut PressWatch,
    wait: Duration,
) -> Result<Option<Vec<f64>>, CliError> {
    let start = Instant::now();
    while start.elapsed() < wait {
        if let Some(frame) = next(session)?
            && let PressState::Held(change) = watch.push(&frame)
        {
            return Ok(Some(change));
        }
    }
    Ok(None)
}

/// Waits until nothing touches the skin.
fn released(session: &mut Session, watch: &mut PressWatch, wait: Duration) -> Result<(), CliError> {
    let start = Instant::now();
    while start.elapsed() < wait {
        if let Some(frame) = next(session)?
            && watch.push(&frame) == PressState::Untouched
        {
            return Ok(());
        }
    }
    let message = format!("the press did not end within {} s", wait.as_secs_f64());
    Err(CliError::Failure(message))
}

/// The next frame, where one came.
fn next(session: &mut Session) -> Result<Option<Vec<f64>>, CliError> {
    match session.next_event(Duration::from_millis(100))? {
        Some(Event::Frame(frame)) => {
            let values = frame.values.clone();
            session.recycle(frame);
            Ok(Some(values))
        }
        _ => Ok(None),
    }
}
