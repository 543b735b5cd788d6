//! A robot that feels: its loop ticks at its own rate, whatever the instrument does.
//! `cargo run --release -p eit-cli --example robot_loop [PORT]`; PORT is a serial port or
//! `tcp://host:port` that speaks EITS-1. Without one, an emulated skin is touched.
#![allow(missing_docs, clippy::print_stdout, reason = "an example is read, and shows its result")]

pub mod emulated;
mod touch_sense;

use eit_hw::{Endpoint, driver::Event, driver::Session, driver::SessionSettings};
use eit_inverse::touch::Touch;
use std::{error::Error, time::Duration, time::Instant};
use touch_sense::TouchSense;

pub const TICK: Duration = Duration::from_millis(10);
/// What is not done so long after its tick was due came too late.
const DEADLINE: Duration = Duration::from_millis(5);

/// At every tick `control` gets the newest touches, `None` where the skin is silent or still learns
/// what untouched is, and says whether to go on. Returns how many ticks missed their deadline.
pub fn run(
    endpoint: &Endpoint,
    mut control: impl FnMut(Option<&[Touch]>) -> bool,
) -> Result<usize, Box<dyn Error>> {
    let mut sense = TouchSense::new()?;
    // of the frames that wait only the newest
    let settings = SessionSettings { capacity: 1, ..Default::default() };
    let session = Session::open(Box::new(sense.driver()?), endpoint, settings)?;
    let (mut due, mut missed, mut goes_on) = (Instant::now(), 0, true);
    while goes_on {
        due += TICK;
        while let Some(left) = due.checked_duration_since(Instant::now()) {
            match session.next_event(left)? {
                Some(Event::Frame(frame)) => session.recycle(sense.feel(frame)?),
                Some(Event::Reconnected { .. }) => sense.forget(),
                Some(other) => println!("{other:?}"),
                None => break,
            }
        }
        goes_on = control(sense.touches());
        if due.elapsed() > DEADLINE {
            (missed, due) = (missed + 1, Instant::now()); // lost ticks are not made up for
        }
    }
    Ok(missed)
}

fn main() -> Result<(), Box<dyn Error>> {
    let (endpoint, _skin) = emulated::endpoint(std::env::args().nth(1).as_deref())?;
    let mut ticks = 0..500;
    let missed = run(&endpoint, |touches| {
        // here the robot draws back, grasps harder, or says hello; without a sense it slows down
        for touch in touches.unwrap_or_default() {
            println!("touch {} at {:.3?} m", touch.id, touch.position_m);
        }
        ticks.next().is_some()
    })?;
    println!("{missed} ticks came too late");
    Ok(())
}
