//! The example of a whole robot runs, feels what it should, and keeps its own time.
#![allow(clippy::unwrap_used, missing_docs, reason = "tests")]

#[path = "../examples/robot_loop/main.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod robot_loop;

use robot_loop::{TICK, emulated, run};
use std::collections::BTreeSet;
use std::time::Instant;

/// However long a busy computer takes: until the finger has come and gone twice, and no longer than
/// 2000 ticks. Presses are 25 frames long, so two of them need a second.
#[test]
fn the_robot_feels_the_emulated_finger() {
    let skin = emulated::skin().unwrap();
    let (mut named, mut begun, mut ticks) = (BTreeSet::new(), false, 0);
    run(skin.endpoint(), |touches| {
        ticks += 1;
        begun |= touches.is_some();
        for touch in touches.unwrap_or_default() {
            let [x, y] = emulated::FINGER_M;
            let off_m = (touch.position_m[0] - x).hypot(touch.position_m[1] - y);
            // a tenth of the radius
            assert!(off_m < 0.01, "{off_m}");
            named.insert(touch.id);
        }
        let over = named.len() >= 2 && touches.is_some_and(<[_]>::is_empty);
        !over && ticks < 2000
    })
    .unwrap();
    assert!(begun && named.len() >= 2, "{named:?} after {ticks} ticks");
}

/// An instrument that goes away does not stop the loop: ticks go on at their rate, and say that
/// there is no sense. A callback that takes too long is counted, and not made up for.
#[test]
fn ticks_go_on_whatever_the_instrument_does() {
    let mut skin = Some(emulated::skin().unwrap());
    let endpoint = skin.as_ref().unwrap().endpoint().clone();
    let (mut silent, mut ticks, mut start) = (0, 0_u32, None);
    let missed = run(&endpoint, |touches| {
        if touches.is_some() {
            // it lives: pull its plug
            skin = None;
        }
        if skin.is_some() {
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
    assert!(missed >= 1);
    // never faster than its rate (the first tick may have come late), also after one that took three
    assert!(start.unwrap().elapsed() + TICK >= TICK * (ticks - 1));
}
