//! A robot that feels: an instrument's frames to touches, and which came too late.
//!
//! `cargo run --release -p eit-cli --example robot_loop [PORT]`; PORT is a serial port or
//! `tcp://host:port` of an instrument that speaks EITS-1. Without one, an emulated skin is touched.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

mod emulated;
mod touch_sense;

use eit_hw::Endpoint;
use eit_hw::driver::{Eits1, Event, Overflow, Session, SessionSettings};
use std::error::Error;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use touch_sense::TouchSense;

const RATE_HZ: f64 = 50.0;
/// From the last byte of a frame to what the robot does about it.
const DEADLINE: Duration = Duration::from_millis(20);
/// Frames before anybody touches: reference and noise.
const QUIET: usize = 30;

/// Runs for so many frames; touches seen and deadlines missed.
pub fn run(port: Option<&str>, frames: usize) -> Result<(usize, usize), Box<dyn Error>> {
    let skin = port.is_none().then(|| emulated::skin(QUIET as u64)).transpose()?;
    let endpoint = match (port, &skin) {
        (Some(port), _) => Endpoint::parse(port, 921_600)?,
        (None, skin) => skin.as_ref().ok_or("no skin")?.endpoint().clone(),
    };
    let mut sense = TouchSense::new()?;
    let driver = Eits1::new(sense.quadruples(), RATE_HZ as f32, sense.current_a(), 0.0)?;
    // a robot wants the present: what it cannot keep up with is dropped
    let settings = SessionSettings { overflow: Overflow::KeepLatest, ..Default::default() };
    let mut session = Session::open(Box::new(driver), &endpoint, settings)?;
    let (mut seen, mut late, mut count) = (0, 0, 0);
    while count < frames {
        match session.next_event(2 * DEADLINE)? {
            Some(Event::Frame(frame)) => {
                let touches = sense.feel(&frame.values, (count, RATE_HZ), QUIET)?;
                for touch in touches {
                    // here the robot draws back, grasps harder, or says hello
                    let [x, y, _] = touch.position_m.map(|v| 1e3 * v);
                    println!("frame {count}: touch {} at {x:.1}, {y:.1} mm", touch.id);
                }
                seen += usize::from(!touches.is_empty());
                let now_s = SystemTime::now().duration_since(UNIX_EPOCH)?.as_secs_f64();
                let passed_s = frame.host_time_s.map_or(0.0, |came_s| now_s - came_s);
                late += usize::from(passed_s > DEADLINE.as_secs_f64());
                count += 1;
                session.recycle(frame);
            }
            Some(Event::Reconnected { .. }) => {
                (sense, seen, late, count) = (TouchSense::new()?, 0, 0, 0);
            }
            Some(other) => println!("{other:?}: the robot slows down"),
            None => println!("no frame in time: the robot slows down"),
        }
    }
    session.stop();
    Ok((seen, late))
}

fn main() -> Result<(), Box<dyn Error>> {
    let (seen, late) = run(std::env::args().nth(1).as_deref(), 150)?;
    println!("touched in {seen} of 150 frames, {late} of them too late");
    Ok(())
}
