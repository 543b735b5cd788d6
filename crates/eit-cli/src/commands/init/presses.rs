//! Determines the electrode numbering from two presses.

use super::ask::say;
use super::board::description;
use super::{CLEAR, Found, UNLIKE};
use crate::cli::InitArgs;
use crate::commands::prelude::*;
use eit_hw::driver::{Event, Session};
use eit_skin::connect::{self, Backlog};
use eit_skin::first_scene::{
    FirstScene, FittingProtocol, KnownPress, Numbering, PressState, PressWatch, find_numbering,
};
use eit_skin::scene::ValueKind;
use eit_skin::scene::{ChangeSign, Direction};

/// Determines from two presses which electrode is the first.
pub(super) fn find(
    args: &InitArgs,
    first: &mut FirstScene,
    rivals: &[FittingProtocol],
    found: &mut Found,
) -> Result<(), CliError> {
    let (reference, presses) = collect(args, first)?;
    let mut numbering = find_numbering(first, &reference, &presses)?;
    // the presses distinguish protocols that the untouched skin does not
    for rival in rivals {
        let other =
            FirstScene { protocol: rival.protocol.clone(), ground: rival.ground, ..first.clone() };
        let mut of_other = find_numbering(&other, &reference, &presses)?;
        if of_other.likeness > numbering.likeness {
            found.lines.push(format!("The presses match better: {}.", description(rival)));
            std::mem::swap(&mut numbering, &mut of_other);
            (first.protocol, first.ground) = (other.protocol, other.ground);
        }
        numbering.next_likeness = numbering.next_likeness.max(of_other.likeness);
    }
    first.first_angle_deg = numbering.first_angle_deg;
    first.direction = numbering.direction;
    first.sign = numbering.sign;
    let Numbering { likeness, next_likeness, .. } = numbering;
    let worst_mm = 1e3 * numbering.errors_m.iter().copied().fold(0.0, f64::max);
    let counted = match numbering.direction {
        Direction::Counterclockwise => "counter-clockwise",
        Direction::Clockwise => "clockwise",
    };
    let changes = match numbering.sign {
        ChangeSign::Increase => "raises",
        ChangeSign::Decrease => "lowers",
    };
    found.lines.push(format!(
        "Two presses: electrode 1 is at {:.1} degrees, counted {counted}; a touch {changes} the conductivity \
         (likeness to the model {likeness:.2}, next best numbering {next_likeness:.2}; presses are located within \
         {worst_mm:.0} mm).",
        numbering.first_angle_deg
    ));
    if likeness < UNLIKE || likeness - next_likeness < CLEAR {
        let warning = "the presses do not determine the numbering with certainty: press with one fingertip exactly at \
                       the places, or set first_angle_deg and direction by hand";
        found.warnings.push(warning.to_owned());
    }
    // presses that fit nothing tell nothing about wires
    found.swapped = numbering.swapped.filter(|_| likeness >= UNLIKE);
    found.numbering = Some(numbering);
    Ok(())
}

/// Measures the untouched skin, and asks for both presses; returns the former's frame and the latter's changes.
fn collect(args: &InitArgs, first: &FirstScene) -> Result<(Vec<f64>, Vec<KnownPress>), CliError> {
    let scene = first.scene()?;
    let instrument = scene.instrument()?;
    let mut session = connect::open(&instrument, args.port.as_deref(), Backlog::Recorded)?;
    say("measuring the untouched skin: do not touch it");
    let ((untouched, rate_hz), hold_s) = (untouched(&session, first.values)?, 0.5);
    let window = ((hold_s * rate_hz) as usize).clamp(4, 1000);
    let mut watch = PressWatch::new(&untouched, window)?;
    let reference = watch.reference().to_vec();
    let mut presses = Vec::new();
    let (wait_s, wait) = (args.press_wait_s, Duration::from_secs_f64(args.press_wait_s));
    for (at, place_m) in first.outline.press_places_m().into_iter().enumerate() {
        let [x, y] = place_m.map(|m| m * 1e3);
        let (from, side) = if at == 0 { (x, "right") } else { (y, "top") };
        say(&format!(
            "press {} of 2: {from:.0} mm from the centre towards the {side}, with a finger; hold it",
            at + 1
        ));
        let held = until(&session, first.values, wait, |frame| match watch.push(&frame) {
            PressState::Held(change) => Some(change),
            _ => None,
        })?;
        let change = held.ok_or_else(|| {
            CliError::failure(format!(
                "no press was held within {wait_s} s at ({x:.0}, {y:.0}) mm: press harder and hold still, or give \
                 --no-presses"
            ))
        })?;
        say("detected; release it");
        let released =
            |frame: Vec<f64>| (watch.push(&frame) == PressState::Untouched).then_some(());
        until(&session, first.values, wait, released)?.ok_or_else(|| {
            CliError::failure(format!("the press did not end within {} s", wait.as_secs_f64()))
        })?;
        presses.push(KnownPress { place_m, change });
    }
    session.stop();
    Ok((reference, presses))
}

/// Takes frames of the untouched skin; returns them with their rate in hertz.
fn untouched(session: &Session, kind: ValueKind) -> Result<(Vec<Vec<f64>>, f64), CliError> {
    // a slow board takes two seconds per frame
    let (least, wait_s) = (8, 30);
    let (mut frames, mut first) = (Vec::new(), None::<Instant>);
    let elapsed_s = until(session, kind, Duration::from_secs(wait_s), |frame| {
        frames.push(frame);
        let elapsed_s = first.get_or_insert_with(Instant::now).elapsed().as_secs_f64();
        (frames.len() >= least && elapsed_s >= 2.0).then_some(elapsed_s)
    })?;
    let elapsed_s = elapsed_s.ok_or_else(|| {
        let found = frames.len();
        CliError::silent(format!(
            "{found} frames of the untouched skin within {wait_s} s, but {least} are needed"
        ))
    })?;
    let rate_hz = frames.len() as f64 / elapsed_s;
    Ok((frames, rate_hz))
}

/// Passes voltages of frames to `take` until it returns something; `None` if it did not in time.
fn until<T>(
    session: &Session,
    kind: ValueKind,
    wait: Duration,
    mut take: impl FnMut(Vec<f64>) -> Option<T>,
) -> Result<Option<T>, CliError> {
    let start = Instant::now();
    while start.elapsed() < wait {
        let Some(Event::Frame(frame)) = session.next_event(Duration::from_millis(100))? else {
            continue;
        };
        let values = frame.values.iter().map(|value| kind.voltage(*value)).collect();
        session.recycle(frame);
        if let Some(found) = take(values) {
            return Ok(Some(found));
        }
    }
    Ok(None)
}
