//! Sessions with emulated instruments.

use std::time::{Duration, Instant};

use eit_hw::codec::eits1::Information;
use eit_hw::driver::{
    Backoff, Driver, Eits1, Event, Sciospec, SciospecSettings, Session, SessionSettings,
};
use eit_hw::emulator::{Device, Eits1Device, Emulator, FaultPlan, Listen, SciospecDevice};
use eit_hw::{Frame, Quadruple, Unit};

use super::{own_port, rotated};

/// Time limit for anything that must arrive.
pub const LIMIT: Duration = Duration::from_secs(30);

/// Reconnects quickly; drops nothing while other tests use the processor.
pub fn quick() -> SessionSettings {
    let reconnect = Some(Backoff { initial_s: 0.01, max_s: 0.1, give_up_s: 25.0 });
    SessionSettings { capacity: 4096, reconnect, ..SessionSettings::default() }
}

/// A pseudo-terminal in the folder where available, otherwise TCP.
fn line(folder: &tempfile::TempDir) -> Listen {
    #[cfg(unix)]
    return Listen::PseudoTerminal(folder.path().join("skin"));
    #[cfg(not(unix))]
    return (folder, own_port()).1;
}

/// Starts an instrument behind a line in a folder of its own.
pub fn on_line(device: impl Device + 'static, plan: FaultPlan) -> (tempfile::TempDir, Emulator) {
    let folder = tempfile::tempdir().unwrap();
    let emulator = Emulator::start(Box::new(device), &line(&folder), plan).unwrap();
    (folder, emulator)
}

pub fn start(device: impl Device + 'static, faults: FaultPlan) -> Emulator {
    Emulator::start(Box::new(device), &own_port(), faults).unwrap()
}

/// Iterates over the events of a session; fails once a test has waited too long.
pub fn events(session: &Session) -> impl Iterator<Item = Event> + '_ {
    let start = Instant::now();
    std::iter::from_fn(move || {
        loop {
            assert!(start.elapsed() < LIMIT, "{:?}", session.statistics());
            let event = session.next_event(Duration::from_millis(200));
            if let Some(event) = event.unwrap() {
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

/// Takes this many frames, which are checked; also returns the other events.
pub fn take(session: &Session, count: usize, each: impl FnMut(&Frame)) -> (Vec<Frame>, Vec<Event>) {
    let (mut frames, mut others, mut events) = (Vec::new(), Vec::new(), events(session));
    while frames.len() < count {
        match events.next().unwrap() {
            Event::Frame(frame) => frames.push(frame),
            other => others.push(other),
        }
    }
    frames.iter().for_each(each);
    (frames, others)
}

pub fn wait_for(mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < LIMIT);
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until an emulator has sent nothing for 100 ms, many frame periods.
pub fn falls_silent(emulator: &Emulator) {
    let mut before = None;
    wait_for(|| {
        std::thread::sleep(Duration::from_millis(100));
        let sent = Some(emulator.statistics().sent);
        std::mem::replace(&mut before, sent) == sent
    });
}

/// Returns a value that encodes frame and measurement; exact in 32 bits.
pub fn value(sequence: u64, [a, b, m, n]: Quadruple) -> f64 {
    // 5 bits for the frame, 16 for the measurement
    f64::from(((a * 16 + b) * 16 + m) * 16 + n) / 65_536.0 + (sequence % 32) as f64
}

pub fn information(serial: &str, complex: bool) -> Information {
    Information {
        electrodes: 16,
        max_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: 100.0,
        unit: Unit::Volt,
        complex,
        name: "emulated skin".into(),
        serial: serial.into(),
    }
}

/// An EITS-1 instrument that measures [`value`].
pub fn eits1_device(serial: &str) -> Eits1Device {
    let source = |sequence: u64, quadruples: &[Quadruple], values: &mut [f64]| {
        for (slot, &quadruple) in values.iter_mut().zip(quadruples) {
            *slot = value(sequence, quadruple);
        }
    };
    Eits1Device::new(information(serial, false), Box::new(source))
}

pub fn eits1_driver(electrodes: u32, rate: f32) -> Box<dyn Driver> {
    Box::new(Eits1::new(&rotated(electrodes), rate, 1e-4, 0.0).unwrap())
}

/// Opens a session of adjacent patterns at 200 frames per second.
pub fn eits1_session(emulator: &Emulator, electrodes: u32) -> Session {
    Session::open(eits1_driver(electrodes, 200.0), emulator.endpoint(), quick()).unwrap()
}

/// Checks a frame of [`eits1_device`] by itself: all values encode the same frame, whose number modulo 32 is returned.
pub fn check_eits1(frame: &Frame, quadruples: &[Quadruple]) -> u64 {
    let number = (frame.values[0] - value(0, quadruples[0])).round() as u64;
    for (found, &quadruple) in frame.values.iter().zip(quadruples) {
        assert_eq!(*found, value(number, quadruple), "frame {}", frame.sequence);
    }
    number
}

/// Returns potentials that encode drive, electrode and frame, with the current entering at `a`.
fn potential(sequence: u64, [a, b]: [u32; 2], electrode: u32) -> [f64; 2] {
    let driven = f64::from(u8::from(electrode == a)) - f64::from(u8::from(electrode == b));
    let place = f64::from((a * 32 + b) * 32 + electrode + 1) / 131_072.0;
    [0.25 * driven + place, (sequence % 16) as f64 / 64.0]
}

pub fn sciospec_device(electrodes: u32, reversed: bool) -> SciospecDevice {
    let source = |sequence: u64, drive: [u32; 2], potentials: &mut [[f64; 2]]| {
        for (electrode, slot) in (0..).zip(potentials) {
            *slot = potential(sequence, drive, electrode);
        }
    };
    SciospecDevice::new(electrodes, 0x11F, reversed, Box::new(source))
}

pub fn sciospec_driver(electrodes: u32) -> Box<dyn Driver> {
    let settings = SciospecSettings::for_quadruples(electrodes, &rotated(electrodes));
    let settings = SciospecSettings { frame_rate_hz: 100.0, ..settings };
    Box::new(Sciospec::new(settings).unwrap())
}

/// Opens a session of adjacent patterns.
pub fn sciospec_session(emulator: &Emulator, electrodes: u32) -> Session {
    let settings = SessionSettings { quadruples: Some(rotated(electrodes)), ..quick() };
    Session::open(sciospec_driver(electrodes), emulator.endpoint(), settings).unwrap()
}

/// Checks the good values of a frame of [`sciospec_device`].
pub fn check_sciospec(frame: &Frame, quadruples: &[Quadruple]) {
    for (index, &[a, b, m, n]) in quadruples.iter().enumerate() {
        if frame.quality[index].is_good() {
            let difference = potential(0, [a, b], m)[0] - potential(0, [a, b], n)[0];
            assert_eq!(frame.values[index], difference, "{index} of frame {}", frame.sequence);
            assert_eq!(frame.imaginary.as_ref().unwrap()[index], 0.0);
        }
    }
}
