//! Sessions with emulated instruments.

use std::time::{Duration, Instant};

use eit_hw::Frame;
use eit_hw::driver::{Backoff, Event, Session, SessionSettings};
use eit_hw::emulator::{Device, Emulator, FaultPlan, Listen};

use super::own_port;

/// Time limit for anything that must arrive.
pub const LIMIT: Duration = Duration::from_secs(30);

/// Settings that reconnect quickly, with a queue so large that nothing is dropped while other tests
/// use the processor.
pub fn quick() -> SessionSettings {
    let reconnect = Some(Backoff { initial_s: 0.01, max_s: 0.1, give_up_s: 25.0 });
    SessionSettings { capacity: 4096, reconnect, ..SessionSettings::default() }
}

/// A pseudo-terminal in the folder where available, otherwise TCP.
pub fn line(folder: &tempfile::TempDir) -> Listen {
    #[cfg(unix)]
    return Listen::PseudoTerminal(folder.path().join("skin"));
    #[cfg(not(unix))]
    {
        let _ = folder;
        own_port()
    }
}

/// Starts an instrument behind a TCP port.
pub fn start(device: impl Device + 'static, faults: FaultPlan) -> Emulator {
    Emulator::start(Box::new(device), &own_port(), faults).expect("an emulator")
}

/// Iterates over the events of a session; fails once a test has waited too long.
pub fn events(session: &Session) -> impl Iterator<Item = Event> + '_ {
    let start = Instant::now();
    std::iter::from_fn(move || {
        loop {
            assert!(start.elapsed() < LIMIT, "{:?}", session.statistics());
            let event = session.next_event(Duration::from_millis(200));
            if let Some(event) = event.expect("the session goes on") {
                return Some(event);
            }
        }
    })
}

/// Iterates over the frames of a session, like [`events`].
pub fn frames(session: &Session) -> impl Iterator<Item = Frame> + '_ {
    events(session).filter_map(|event| match event {
        Event::Frame(frame) => Some(frame),
        _ => None,
    })
}
