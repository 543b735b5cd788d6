//! Determines the electrode numbering from two presses.

use super::ask::Questions;
use super::board::words;
use super::{CLEAR, Found, UNLIKE};
use crate::cli::InitArgs;
use crate::error::CliError;
use eit_hw::driver::{Event, Session};
use eit_skin::connect::{self, Backlog};
use eit_skin::first_scene::{
    FirstScene, FittingProtocol, KnownPress, PressState, PressWatch, find_numbering,
};
use eit_skin::scene::{ChangeSign, Direction};
use std::time::{Duration, Instant};

/// Minimum number of frames of the untouched skin, and minimum time.
const UNTOUCHED_FRAMES: usize = 8;
const UNTOUCHED_S: f64 = 2.0;
/// Time for which a press must be held, seconds.
const HOLD_S: f64 = 0.5;
/// Maximum wait for those frames: a slow board takes two seconds per frame.
const FRAMES_WAIT: Duration = Duration::from_secs(30);

/// Determines from two presses which electrode is the first.
pub(super) fn find(
    args: &InitArgs,
    first: &mut FirstScene,
    rivals: &[FittingProtocol],
    found: &mut Found,
    questions: &Questions,
) -> Result<(), CliError> {
    let scene = first.scene()?;
    let instrument = scene.instrument()?;
    let mut session = connect::open(&instrument, args.port.as_deref(), Backlog::Recorded)?;
    questions.say("measuring the untouched skin: do not touch it");
    let (untouched, rate_hz) = untouched(&mut session)?;
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
        questions.say("detected; release it");
        released(&mut session, &mut watch, wait)?;
        presses.push(KnownPress { place_m, change });
    }
    session.stop();
    let mut numbering = find_numbering(first, &reference, &presses)?;
    // the presses distinguish protocols that the untouched skin does not
    for rival in rivals {
        let other = FirstScene { protocol: rival.protocol.clone(), ..first.clone() };
        let of_other = find_numbering(&other, &reference, &presses)?;
        let is_better = of_other.likeness > numbering.likeness;
        let (likeness, next) = match is_better {
            true => (of_other.likeness, numbering.likeness),
            false => (numbering.likeness, of_other.likeness),
        };
        if is_better {
            found.lines.push(format!("The presses match better: {}.", words(rival)));
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
        ChangeSign::Increase => "raises",
        ChangeSign::Decrease => "lowers",
    };
    found.lines.push(format!(
        "Two presses: electrode 1 is at {:.1} degrees, counted {counted}; a touch {changes} the \
         conductivity (likeness to the model {:.2}, next best numbering {:.2}; presses are located within \
         {:.0} mm).",
        numbering.first_angle_deg,
        numbering.likeness,
        numbering.next_likeness,
        worst_m * 1e3
    ));
    if numbering.likeness < UNLIKE || numbering.likeness - numbering.next_likeness < CLEAR {
        found.warnings.push(
            "the presses do not determine the numbering with certainty: press with one fingertip \
             exactly at the \
             places, or set first_angle_deg and direction by hand"
                .to_owned(),
        );
    }
    // presses that fit nothing tell nothing about wires
    found.swapped = numbering.swapped.filter(|_| numbering.likeness >= UNLIKE);
    found.numbering = Some(numbering);
    Ok(())
}

/// Takes frames of the untouched skin; returns them with their rate in hertz.
fn untouched(session: &mut Session) -> Result<(Vec<Vec<f64>>, f64), CliError> {
    let (start, mut frames, mut first) = (Instant::now(), Vec::new(), None::<Instant>);
    while first.is_none_or(|first| {
        frames.len() < UNTOUCHED_FRAMES || first.elapsed().as_secs_f64() < UNTOUCHED_S
    }) {
        if start.elapsed() > FRAMES_WAIT {
            let message = format!(
                "{} frames of the untouched skin within {} s, but {UNTOUCHED_FRAMES} are needed",
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
    let elapsed_s = first.map_or(UNTOUCHED_S, |first| first.elapsed().as_secs_f64());
    let rate_hz = frames.len() as f64 / elapsed_s.max(UNTOUCHED_S);
    Ok((frames, rate_hz))
}

/// Waits for the next press that is held and returns its change; `None` if there was none in time.
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

/// Returns the next frame, if one arrived.
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
