//! Opens an instrument, streams frames, counts their flags, records them and reads them back.
//!
//! Run with `cargo run --release -p eit-hw --features mcap --example instrument [FILE.mcap]`. The
//! instrument is emulated behind a TCP connection; one electrode comes off after a while.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_hw::capture::{self, CaptureSettings, CaptureWriter, SessionRecord};
use eit_hw::codec::eits1::Information;
use eit_hw::driver::{Eits1, Event, Overflow, Session, SessionSettings};
use eit_hw::emulator::{Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Quadruple, Quality, Unit};
use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::time::Duration;

const ELECTRODES: u32 = 16;
const RATE_HZ: f32 = 200.0;
/// From this frame on the last electrode is off: its measurements exceed the converter's range.
const LOOSE_FROM: u64 = 40;

/// Result of the example.
#[derive(Debug, Default)]
pub struct Outcome {
    pub frames: usize,
    /// Number of flagged measurements in all frames, by flags.
    pub flagged: BTreeMap<String, usize>,
    /// Number of frames read back from the recording, and whether their values are bit-identical.
    pub recorded: usize,
    pub same: bool,
}

/// Returns the quadruples of adjacent drive and measurement without driven electrodes.
fn quadruples() -> Vec<Quadruple> {
    let one = |d: u32| (2..ELECTRODES - 1).map(move |k| [d, d + 1, d + k, d + k + 1]);
    (0..ELECTRODES).flat_map(one).map(|q| q.map(|e| e % ELECTRODES)).collect()
}

/// Starts the emulated instrument.
fn skin() -> Result<Emulator, Box<dyn Error>> {
    let information = Information {
        electrodes: ELECTRODES as u16,
        max_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: 1.0,
        unit: Unit::Volt,
        complex: false,
        name: "emulated skin".to_owned(),
        serial: "1".to_owned(),
    };
    let source = |number: u64, quadruples: &[Quadruple], values: &mut [f64]| {
        for (value, [_, _, m, n]) in values.iter_mut().zip(quadruples) {
            let loose = number >= LOOSE_FROM && (*m == ELECTRODES - 1 || *n == ELECTRODES - 1);
            *value = if loose { 1.0 } else { 0.1 + 0.001 * f64::from(*m) };
        }
    };
    let device = Box::new(Eits1Device::new(information, Box::new(source)));
    Ok(Emulator::start(device, &Listen::Tcp("127.0.0.1:0".to_owned()), FaultPlan::default())?)
}

/// Streams and records this many frames.
pub fn run(path: &Path, frames: usize) -> Result<Outcome, Box<dyn Error>> {
    let skin = skin()?;
    let quadruples = quadruples();
    let driver = Eits1::new(&quadruples, RATE_HZ, 1e-4, 0.0)?;
    // a recorder must not lose a frame: it ends with an error instead
    let settings =
        SessionSettings { capacity: 4096, overflow: Overflow::Fail, ..Default::default() };
    let mut session = Session::open(Box::new(driver), skin.endpoint(), settings)?;
    println!("{}: {} values per frame", session.setup().identity, session.setup().value_count);

    let record = SessionRecord::of(session.setup(), &quadruples);
    let mut recording = CaptureWriter::create(path, &record, CaptureSettings::default())?;
    let (mut outcome, mut sums) = (Outcome::default(), Vec::new());
    while outcome.frames < frames {
        match session.next_event(Duration::from_secs(5))? {
            Some(Event::Frame(frame)) => {
                recording.frame(&frame)?;
                for quality in frame.quality.iter().filter(|quality| !quality.is_good()) {
                    *outcome.flagged.entry(quality.to_string()).or_default() += 1;
                }
                let is_good = |&i: &usize| frame.quality[i] == Quality::GOOD;
                let good = (0..frame.values.len()).filter(is_good);
                sums.push(good.map(|i| frame.values[i]).sum::<f64>().to_bits());
                outcome.frames += 1;
                session.recycle(frame);
            }
            // gaps, notices, a reconnection
            Some(other) => println!("{other:?}"),
            None => return Err("no frame for five seconds".into()),
        }
    }
    session.stop();
    recording.finish()?;
    let back = capture::read(path)?;
    let good = |frame: &eit_hw::Frame| {
        let values = frame.values.iter().zip(&frame.quality).filter(|(_, q)| q.is_good());
        values.map(|(value, _)| value).sum::<f64>().to_bits()
    };
    outcome.recorded = back.frames().count();
    outcome.same = back.frames().map(good).eq(sums);
    println!("{} frames, flags of their values: {:?}", outcome.frames, outcome.flagged);
    println!("{} of them in {}", outcome.recorded, path.display());
    Ok(outcome)
}

fn main() -> Result<(), Box<dyn Error>> {
    let given = std::env::args_os().nth(1).map(std::path::PathBuf::from);
    let name = format!("eit-hw-stream-{}.mcap", std::process::id());
    run(&given.unwrap_or_else(|| std::env::temp_dir().join(name)), 100).map(|_| ())
}
