//! Logs of the skin board `black_sensor` as its own program writes them: the computer's time, a load cell,
//! then what came over the serial line, in commas.
//!
//! A frame is a line `A` and 16 lines of the board's time in milliseconds and 16 counts, driven electrodes
//! included. Boot banners, colour codes and cut lines between and within frames are passed over, and the
//! frame with them. Source: github.com/richgumy/black_sensor.

use std::path::Path;

use super::{table, text};
use crate::codec::text::{Decoder, Event, Fault, TextFormat};
use crate::error::{At, HwError};
use crate::recording::{Format, Layout, Recording, SkipReason, Skipped, Unit};

/// Columns that the computer adds before those of the board.
const ADDED: usize = 2;
/// What the second line of every log begins with.
const HEADER: &[u8] = b"time_pc [s],";

/// Whether the first lines are those of such a log.
pub(super) fn is_log(bytes: &[u8]) -> bool {
    bytes.split(|&byte| byte == b'\n').take(4).any(|line| line.starts_with(HEADER))
}

/// Frames of such a log; `path` is for messages.
///
/// The layout is [`Layout::ProtocolOrder`] of 256 values, the unit [`Unit::Arbitrary`].
///
/// # Errors
/// [`HwError::NoFrames`] without one whole frame.
pub fn parse(bytes: &[u8], path: &Path) -> Result<Recording, HwError> {
    let format = TextFormat::black_sensor();
    let count = format.measurements();
    let mut decoder = Decoder::new(format)?;
    // in step: the start of the first line is there
    decoder.reset(true);
    let (mut values, mut qualities, mut skipped) = (Vec::new(), Vec::new(), Skipped::default());
    let content = String::from_utf8_lossy(bytes);
    for (line, row) in text::lines(&content) {
        decoder.push(serial(row).as_bytes(), &mut |event| match event {
            Event::Frame { values: frame, quality, .. } => {
                values.extend_from_slice(frame);
                qualities.extend_from_slice(quality);
            }
            Event::Skipped(fault) => skipped.add(1, At::Line(line), reason(fault)),
            Event::Line(_) => {}
        });
    }
    let real = table::frames(values, count, path, skipped.frames)?;
    let shape = real.dim();
    let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
    let mut recording = Recording::new(real, None, layout, unit, Format::BlackSensor, path);
    if let Ok(quality) = ndarray::Array2::from_shape_vec(shape, qualities) {
        recording.quality = quality;
    }
    recording.skipped = skipped;
    Ok(recording)
}

/// What came over the line: a mark, or the counts behind the board's time.
fn serial(row: &str) -> String {
    let row = row.trim_end_matches(',');
    let mut fields = row.splitn(ADDED + 2, ',').skip(ADDED);
    match (fields.next(), fields.next()) {
        (Some(mark), None) => format!("{mark}\n"),
        (Some(_), Some(counts)) => format!("{counts}\n"),
        (None, _) => "\n".into(),
    }
}

fn reason(fault: Fault) -> SkipReason {
    match fault {
        Fault::Values { found, wanted } => SkipReason::Values { found, wanted },
        Fault::Lines { found, wanted } => SkipReason::Lines { found, wanted },
        _ => SkipReason::NotANumber,
    }
}
