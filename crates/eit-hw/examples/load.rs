//! Load test: a skin of 208 complex values at 1000 frames per second over a serial line. Measures
//! losses, memory and processor time. Emulator, line and session run in this program, each on its
//! own thread.
//!
//! ```text
//! cargo run --release -p eit-hw --features serial --example load -- 600
//! ```
//!
//! Argument: seconds of streaming [600]. Then follow a consumer that stalls for five seconds, and a
//! day of frames as fast as they can be taken. docs/performance/live.md has the results.

#![allow(
    missing_docs,
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::panic,
    reason = "an example prints its result, and stops if something is wrong"
)]

use std::time::{Duration, Instant};

use eit_hw::codec::eits1::{Information, Kind, Message, encode, flags};
use eit_hw::driver::{
    Decoded, Driver, Eits1, Event, FrameSource, Overflow, Pace, Replay, Session, SessionSettings,
    Statistics,
};
use eit_hw::emulator::{Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Frame, Quadruple, Unit};

const RATE_HZ: f32 = 1000.0;
const MEASUREMENTS: usize = 208;

fn main() {
    let seconds = std::env::args().nth(1).map_or(600.0, |text| text.parse().unwrap());
    let folder = std::env::temp_dir().join(format!("eit-load-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let report = stream(&folder, RATE_HZ, Duration::from_secs_f64(seconds), true);
    println!("{report:#?}");
    println!(
        "stalled consumer, latest kept: {:?}",
        stall(&folder, RATE_HZ, Overflow::KeepLatest, 5.0)
    );
    println!("stalled consumer, recorder: {:?}", stall(&folder, RATE_HZ, Overflow::Fail, 5.0));
    println!("a day through the driver: {:?}", day_through_driver(24 * 3600 * 25));
    println!("a day through a replay: {:?}", day_through_replay(24 * 3600 * 25));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Result of a stream.
#[derive(Debug)]
#[allow(dead_code, reason = "printed")]
pub struct Report {
    pub frames: u64,
    pub statistics: Statistics,
    pub seconds: f64,
    /// Number of frames with values other than those sent.
    pub wrong: u64,
    /// Fraction of one processor core used by each thread.
    pub cpu_share: Vec<(String, f64)>,
    /// Resident memory after a tenth of the time and at the end, in MB.
    pub memory_mb: [f64; 2],
}

/// Returns the quadruples of adjacent drive and measurement on 16 electrodes.
fn quadruples() -> Vec<Quadruple> {
    (0..16_u32)
        .flat_map(|d| (2..15).map(move |k| [d, d + 1, d + k, d + k + 1].map(|e| e % 16)))
        .collect()
}

/// Starts the instrument; its values encode frame and position.
fn emulator(folder: &std::path::Path) -> Emulator {
    let information = Information {
        electrodes: 16,
        max_measurements: 256,
        max_frame_rate_hz: 2.0 * RATE_HZ,
        full_scale: f32::INFINITY,
        unit: Unit::Volt,
        complex: true,
        name: "emulated skin".into(),
        serial: "load".into(),
    };
    let source = |number: u64, _: &[Quadruple], values: &mut [f64]| {
        for (index, slot) in values.iter_mut().enumerate() {
            *slot = value(number, index);
        }
    };
    let device = Box::new(Eits1Device::new(information, Box::new(source)));
    #[cfg(unix)]
    let listen = Listen::PseudoTerminal(folder.join("skin"));
    #[cfg(not(unix))]
    let listen = Listen::Tcp("127.0.0.1:0".into());
    let _ = folder;
    Emulator::start(device, &listen, FaultPlan::default()).unwrap()
}

/// Returns a value that is exact in 32 bits.
fn value(number: u64, index: usize) -> f64 {
    (number % 4096) as f64 + index as f64 / 512.0
}

fn open(emulator: &Emulator, rate_hz: f32, capacity: usize, overflow: Overflow) -> Session {
    let driver = Eits1::new(&quadruples(), rate_hz, 1e-4, 1e4).unwrap();
    let settings = SessionSettings { capacity, overflow, ..SessionSettings::default() };
    Session::open(Box::new(driver), emulator.endpoint(), settings).unwrap()
}

/// Streams for this time and checks each frame.
pub fn stream(folder: &std::path::Path, rate_hz: f32, time: Duration, is_reported: bool) -> Report {
    let emulator = emulator(folder);
    let mut session = open(&emulator, rate_hz, 4096, Overflow::Fail);
    let (start, mut frames, mut wrong) = (Instant::now(), 0, 0);
    let cpu_before = cpu_s();
    let (mut early_mb, mut reported) = (None, 0);
    while start.elapsed() < time {
        if start.elapsed() > time / 10 {
            early_mb.get_or_insert_with(memory_mb);
        }
        if let Some(Event::Frame(frame)) = session.next_event(Duration::from_millis(100)).unwrap() {
            frames += 1;
            wrong += u64::from(!is_right(&frame));
            session.recycle(frame);
        }
        let minutes = start.elapsed().as_secs() / 60;
        if is_reported && minutes > reported {
            reported = minutes;
            println!("{minutes} min: {frames} frames, {:.1} MB", memory_mb());
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    let cpu_share = cpu_s()
        .into_iter()
        .map(|(name, after)| {
            let before = cpu_before.iter().find(|(other, _)| *other == name).map_or(0.0, |c| c.1);
            (name, (after - before) / seconds)
        })
        .collect();
    let memory_mb = [early_mb.unwrap_or_default(), memory_mb()];
    session.stop();
    Report { frames, statistics: session.statistics(), seconds, wrong, cpu_share, memory_mb }
}

fn is_right(frame: &Frame) -> bool {
    let number = frame.values[0] as u64;
    let imaginary = frame.imaginary.as_deref().unwrap_or_default();
    imaginary.len() == frame.values.len()
        && frame.values.iter().enumerate().all(|(i, v)| *v == value(number, 2 * i))
        && imaginary.iter().enumerate().all(|(i, v)| *v == value(number, 2 * i + 1))
}

/// Runs a consumer that takes nothing for some seconds; returns what it finds then.
pub fn stall(
    folder: &std::path::Path,
    rate_hz: f32,
    overflow: Overflow,
    stall_s: f64,
) -> (Statistics, u64) {
    let emulator = emulator(folder);
    // a recorder's queue holds more frames than the stall lasts
    let capacity = if overflow == Overflow::Fail { 16_384 } else { 64 };
    let mut session = open(&emulator, rate_hz, capacity, overflow);
    std::thread::sleep(Duration::from_secs_f64(stall_s));
    let (start, mut taken) = (Instant::now(), 0);
    while start.elapsed() < Duration::from_secs(1) {
        if let Some(Event::Frame(frame)) = session.next_event(Duration::from_millis(20)).unwrap() {
            assert!(is_right(&frame));
            taken += 1;
            session.recycle(frame);
        }
    }
    session.stop();
    (session.statistics(), taken)
}

/// Passes frames through codec and driver; returns their number, frames per second, and memory
/// early and at the end in MB.
pub fn day_through_driver(count: u32) -> (u64, f64, [f64; 2]) {
    let mut driver = Eits1::new(&quadruples(), 25.0, 1e-4, 0.0).unwrap();
    let payload: Vec<u8> =
        (0..MEASUREMENTS).flat_map(|index| (index as f32).to_le_bytes()).collect();
    let (mut wire, mut frames, mut early_mb) = (Vec::new(), 0_u64, 0.0);
    let start = Instant::now();
    for sequence in 0..count {
        wire.clear();
        let message = Message {
            kind: Kind::Frame,
            sequence,
            device_time_us: 40_000 * u64::from(sequence),
            flags: flags::CALIBRATED,
            count: MEASUREMENTS as u16,
            payload: &payload,
        };
        encode(&message, &mut wire).unwrap();
        driver.receive(&wire, &mut |decoded| {
            frames += u64::from(matches!(decoded, Decoded::Frame(_)))
        });
        if sequence == count / 10 {
            early_mb = memory_mb();
        }
    }
    (frames, frames as f64 / start.elapsed().as_secs_f64(), [early_mb, memory_mb()])
}

/// Passes frames through a replay that reorders the values; returns the same as
/// [`day_through_driver`].
pub fn day_through_replay(count: u64) -> (u64, f64, [f64; 2]) {
    let emulated = quadruples();
    let setup = eit_hw::driver::Setup {
        identity: eit_hw::driver::Identity {
            driver: "replay",
            name: "a day".into(),
            serial: String::new(),
        },
        layout: eit_hw::Layout::Quadruples(emulated.clone()),
        value_count: MEASUREMENTS,
        complex: false,
        unit: Unit::Volt,
        frame_rate_hz: Some(25.0),
        limits: Default::default(),
    };
    let frames = (0..count).map(|sequence| Frame {
        device_time_s: Some(sequence as f64 / 25.0),
        ..Frame::new(sequence, (0..MEASUREMENTS).map(|index| value(sequence, index)).collect())
    });
    let mut wanted = emulated;
    wanted.reverse();
    let mut replay = Replay::of_frames(setup, frames, Some(&wanted), Pace::OnDemand).unwrap();
    let (start, mut taken, mut early_mb) = (Instant::now(), 0, 0.0);
    while let Some(event) = replay.next_event(Duration::ZERO).unwrap() {
        if let Event::Frame(frame) = event {
            assert_eq!(frame.values[MEASUREMENTS - 1], value(frame.sequence, 0));
            taken += 1;
            replay.recycle(frame);
        }
        if taken == count / 10 {
            early_mb = memory_mb();
        }
    }
    (taken, taken as f64 / start.elapsed().as_secs_f64(), [early_mb, memory_mb()])
}

/// Returns the processor time of each thread in seconds, by name; empty if the system does not
/// provide it.
fn cpu_s() -> Vec<(String, f64)> {
    /// Ticks per second on every Linux.
    const TICKS_HZ: f64 = 100.0;
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return Vec::new() };
    let times = tasks.filter_map(|task| {
        let text = std::fs::read_to_string(task.ok()?.path().join("stat")).ok()?;
        // number (name) state ...; user and system time are 11 fields after the state
        let (head, rest) = text.rsplit_once(')')?;
        let name = head.split_once('(')?.1.to_owned();
        let fields: Vec<&str> = rest.split_whitespace().collect();
        let ticks: f64 =
            fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?;
        Some((name, ticks / TICKS_HZ))
    });
    times.collect()
}

/// Returns the resident memory in MB; 0 if the system does not provide it.
fn memory_mb() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find(|line| line.starts_with("VmRSS:"));
    let kb = line.and_then(|line| line.split_whitespace().nth(1)).and_then(|kb| kb.parse().ok());
    kb.map_or(0.0, |kb: f64| 1e-3 * kb)
}
