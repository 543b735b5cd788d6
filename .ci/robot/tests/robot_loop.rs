//! The robot detects the touches, and its loop keeps its own rate.
use eit_skin::Skin;
use robot::emulated;
use robot::robot_loop::{TICK, run};
use std::collections::BTreeSet;
use std::time::Instant;

fn skin() -> Skin {
    Skin::load(concat!(env!("CARGO_MANIFEST_DIR"), "/skin.toml")).unwrap()
}

/// Runs until the finger has come and gone, for at most 3000 ticks, however slow the computer.
#[test]
fn the_robot_feels_the_emulated_finger() {
    let skin = skin();
    let emulated = emulated::start(&skin).unwrap();
    let (mut ids, mut has_reference, mut ticks) = (BTreeSet::new(), false, 0);
    run(&skin, Some(&emulated.endpoint().to_string()), |touches| {
        ticks += 1;
        has_reference |= touches.is_some();
        ids.extend(touches.unwrap_or_default().iter().filter(|t| t.valid).map(|t| t.id));
        (ids.is_empty() || touches.is_none_or(|touches| !touches.is_empty())) && ticks < 3000
    })
    .unwrap();
    assert!(has_reference && !ids.is_empty(), "{ids:?} after {ticks} ticks");
}

/// An instrument that goes away does not stop the loop: ticks continue at their rate and report that there is
/// no data. A callback that takes too long is counted as late; lost ticks are not made up for.
#[test]
fn ticks_go_on_whatever_the_instrument_does() {
    let skin = skin();
    let mut emulated = Some(emulated::start(&skin).unwrap());
    let port = emulated.as_ref().unwrap().endpoint().to_string();
    let (mut silent, mut ticks, mut start) = (0, 0_u32, None);
    let late = run(&skin, Some(&port), |touches| {
        if touches.is_some() {
            // the first data has arrived: unplug it
            emulated = None;
        }
        if emulated.is_some() {
            return true;
        }
        silent = if touches.is_none() { silent + 1 } else { 0 };
        start.get_or_insert_with(Instant::now);
        ticks += 1;
        if ticks == 10 {
            std::thread::sleep(3 * TICK);
        }
        silent < 30
    })
    .unwrap();
    assert!(late >= 1);
    // never faster than its rate (the first tick may have been late), even after one that took three ticks
    assert!(start.unwrap().elapsed() + TICK >= TICK * (ticks - 1));
}
