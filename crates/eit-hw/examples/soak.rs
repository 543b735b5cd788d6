//! Soak test: a recorder on a bad line for a long time. 208 values at 1000 frames per second; bytes
//! are dropped, flipped and inserted, the line pauses, and the instrument is unplugged and plugged
//! in again. Prints a line for each tenth of the time; at the end the recording is read back and
//! every value checked.
//!
//! ```text
//! cargo run --release -p eit-hw --features mcap --example soak -- 600
//! ```
//!
//! Argument: seconds [600].

#![allow(
    missing_docs,
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "an example prints its result, and stops if something is wrong"
)]

use std::time::{Duration, Instant};

use eit_hw::capture::{CaptureReader, CaptureSettings, CaptureWriter, Entry, SessionRecord};
use eit_hw::codec::eits1::Information;
use eit_hw::driver::{Backoff, Eits1, Event, Overflow, Session, SessionSettings, Statistics};
use eit_hw::emulator::{Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Frame, Quadruple, Unit};

const RATE_HZ: f32 = 1000.0;
/// Bytes per second of such frames.
const BYTES_S: f64 = 860_000.0;

fn main() {
    let seconds = std::env::args().nth(1).map_or(600.0, |text| text.parse().unwrap());
    let report = run(seconds, RATE_HZ);
    println!("{report:#?}");
}

/// Result of a run.
#[derive(Debug)]
pub struct Report {
    pub statistics: Statistics,
    /// Number of faults on the line.
    pub faults: u64,
    /// Number of frames in the recording.
    pub recorded: u64,
    /// Number of recorded frames with values other than those sent.
    pub wrong: u64,
    /// Number of epochs in the recording.
    pub epochs: u32,
    pub file_mb: f64,
}

/// Returns the quadruples of adjacent drive and measurement on 16 electrodes.
fn quadruples() -> Vec<Quadruple> {
    (0..16)
        .flat_map(|d| (2..15).map(move |k| [d, d + 1, d + k, d + k + 1].map(|e| e % 16)))
        .collect()
}

/// Returns a value that encodes frame and measurement; exact in 32 bits.
fn value(frame: u64, [a, b, m, n]: Quadruple) -> f64 {
    f64::from(((a * 16 + b) * 16 + m) * 16 + n) / 65_536.0 + (frame % 32) as f64
}

fn is_right(frame: &Frame, quadruples: &[Quadruple]) -> bool {
    let first = (frame.values[0] - value(0, quadruples[0])).round() as u64;
    frame.values.iter().zip(quadruples).all(|(found, &q)| *found == value(first, q))
}

/// Records for this time and reads the recording back.
pub fn run(seconds: f64, rate_hz: f32) -> Report {
    let quadruples = quadruples();
    let information = Information {
        electrodes: 16,
        max_measurements: 256,
        max_frame_rate_hz: 10_000.0,
        full_scale: f32::INFINITY,
        unit: Unit::Volt,
        complex: false,
        name: "soak".into(),
        serial: "1".into(),
    };
    let source = |frame: u64, quadruples: &[Quadruple], values: &mut [f64]| {
        values.iter_mut().zip(quadruples).for_each(|(slot, &q)| *slot = value(frame, q));
    };
    let bytes = seconds * BYTES_S * f64::from(rate_hz) / 1000.0;
    let plan = FaultPlan {
        seed: 1,
        spared_bytes: 20_000,
        drop_byte: 1e-6,
        flip_bit: 1e-6,
        insert_byte: 1e-6,
        pause: 4.0 / bytes,
        pause_s: 0.7,
        unplug_after_bytes: (1..4).map(|n| (f64::from(n) * bytes / 4.5) as u64).collect(),
        unplugged_s: 0.3,
        line_baud: None,
    };
    let device = Eits1Device::new(information, Box::new(source));
    let listen = Listen::Tcp("127.0.0.1:0".into());
    let mut emulator = Emulator::start(Box::new(device), &listen, plan).unwrap();
    let settings = SessionSettings {
        quadruples: Some(quadruples.clone()),
        capacity: 8192,
        overflow: Overflow::Fail,
        reconnect: Some(Backoff { initial_s: 0.05, max_s: 0.5, give_up_s: 60.0 }),
        ..SessionSettings::default()
    };
    let driver = Box::new(Eits1::new(&quadruples, rate_hz, 1e-4, 0.0).unwrap());
    let mut session = Session::open(driver, emulator.endpoint(), settings).unwrap();
    let folder = std::env::temp_dir().join(format!("eit-soak-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("soak.mcap");
    let record = SessionRecord::of(session.setup(), &quadruples);
    let mut writer = CaptureWriter::create(&path, &record, CaptureSettings::default()).unwrap();
    println!("    time s      frames    lost  damaged B  reconnections  silent s");
    let (start, mut lines) = (Instant::now(), 1.0);
    while start.elapsed().as_secs_f64() < seconds {
        match session.next_event(Duration::from_millis(50)).unwrap() {
            Some(Event::Frame(frame)) => {
                writer.frame(&frame).unwrap();
                session.recycle(frame);
            }
            Some(_) => {}
            None => writer.tick().unwrap(),
        }
        if start.elapsed().as_secs_f64() >= lines * seconds / 10.0 {
            lines += 1.0;
            let Statistics { frames, lost, damaged_bytes, reconnections, silent_s, .. } =
                session.statistics();
            let time_s = start.elapsed().as_secs_f64();
            println!(
                "{time_s:10.1}{frames:12}{lost:8}{damaged_bytes:11}{reconnections:15}{silent_s:10.1}"
            );
        }
    }
    session.stop();
    while let Some(event) = session.next_event(Duration::ZERO).unwrap() {
        if let Event::Frame(frame) = event {
            writer.frame(&frame).unwrap();
        }
    }
    writer.finish().unwrap();
    emulator.stop();
    let (mut reader, mut recorded, mut wrong, mut epochs) =
        (CaptureReader::open(&path).unwrap(), 0, 0, 0);
    while let Some(entry) = reader.next_entry().unwrap() {
        if let Entry::Frame(frame) = entry {
            recorded += 1;
            wrong += u64::from(!is_right(&frame, &quadruples));
            epochs = frame.epoch + 1;
        }
    }
    let file_mb = 1e-6 * std::fs::metadata(&path).unwrap().len() as f64;
    std::fs::remove_dir_all(&folder).unwrap();
    let faults = emulator.statistics().faults;
    Report { statistics: session.statistics(), faults, recorded, wrong, epochs, file_mb }
}
