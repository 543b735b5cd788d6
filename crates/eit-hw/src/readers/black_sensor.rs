//! Logs of the skin board `black_sensor` as its own program writes them: the computer's time and a
//! load cell, then what was received over the serial line, separated by commas.
//!
//! A frame is a line `A` and 16 lines of the board's time in milliseconds and 16 counts, driven
//! electrodes included. The header calls the counts millivolts, but they are the converter's own. A
//! frame with boot banners, colour codes or truncated lines between its rows is skipped; between
//! frames they do no harm. Source: github.com/richgumy/black_sensor.

use std::path::Path;

use crate::codec::text::{Decoder, Event, Fault, TextFormat};
use crate::error::{At, HwError};
use crate::frame::Quality;
use crate::recording::{Contents, Format, Layout, Recording, SkipReason, Skipped, Unit};

/// Number of columns that the computer adds before those of the board.
const ADDED: usize = 2;
/// Start of the second line of every log.
const HEADER: &[u8] = b"time_pc [s],";

/// Most bytes used of a line; those of a frame have about 110.
const MOST_LINE: usize = 4096;

/// Returns whether the first lines are those of such a log.
pub(super) fn is_log(bytes: &[u8]) -> bool {
    bytes.split(|&byte| byte == b'\n').take(4).any(|line| line.starts_with(HEADER))
}

/// Parses such a log; `path` is used in messages only.
///
/// The layout is [`Layout::ProtocolOrder`] of 256 values, the unit [`Unit::Arbitrary`].
///
/// # Errors
/// [`HwError::NoFrames`] if there is no complete frame.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Recording, HwError> {
    let format = TextFormat::black_sensor();
    let (count, full_scale) = (format.measurements(), format.saturated_from);
    let mut decoder = Decoder::new(format)?;
    // the file starts at the start of a line
    decoder.reset(true);
    // at most one value per two bytes, so that the lists need not grow
    let most = bytes.len() / 2;
    let (mut values, mut qualities) = (Vec::with_capacity(most), Vec::with_capacity(most));
    let mut skipped = Skipped::default();
    for (row, line) in lines(bytes).zip(1..) {
        // a line at a time: the replacements of wrong bytes are longer than these
        let row = String::from_utf8_lossy(row.get(..MOST_LINE).unwrap_or(row));
        decoder.push(serial(&row).as_bytes(), &mut |event| match event {
            Event::Frame { values: frame, quality, .. } => {
                values.extend(frame);
                qualities.extend(quality);
            }
            Event::Skipped(fault) => skipped.add(1, At::Line(line), reason(fault)),
            Event::Line(_) => {}
        });
    }
    // counts beyond the largest of 16 bits are those of a wider converter, whose largest is not known
    let is_wider = values.iter().any(|count| Some(*count) > full_scale);
    if is_wider {
        qualities.fill(Quality::GOOD);
    }
    let contents = Contents {
        real: values,
        quality: Some(qualities),
        value_count: count,
        skipped,
        ..Contents::default()
    };
    let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
    Recording::new(contents, layout, unit, Format::BlackSensor, path)
}

/// Iterates over lines, which end with LF, CR LF or CR.
fn lines(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    bytes
        .split(|&byte| byte == b'\n')
        .map(|line| line.strip_suffix(b"\r").unwrap_or(line))
        .flat_map(|line| line.split(|&byte| byte == b'\r'))
}

/// Returns what was received over the line: a mark, or the counts after the board's time.
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is a failed test")]
mod tests {
    use super::*;

    /// Returns 16 rows as the logs have them: the board's time first, a comma at the end.
    fn block(counts: impl Fn(usize, usize) -> u32) -> String {
        let row = |row: usize| {
            let row: Vec<String> = (0..16).map(|column| counts(row, column).to_string()).collect();
            format!("1.5,0,17560,{},\n", row.join(","))
        };
        (0..16).map(row).collect()
    }

    #[test]
    fn frames_without_a_banner_are_whole_and_only_the_rail_is_flagged() {
        let sound = |row: usize, column: usize| (1000 * row + column) as u32 + 24_000;
        let railed =
            |row, column| if (row, column) == (3, 5) { 65_535 } else { sound(row, column) };
        let banner = "1.5,0,\u{1b}[0;31mE (20317) task_wdt: Task watchdog got triggered.\n1.5,0,\n";
        let mut broken = block(sound);
        broken.insert_str(broken.find('\n').unwrap() + 1, banner);
        let head =
            "UTC:,2022-04-12 04:28:07.127463\ntime_pc [s],Mass [g],time_mcu[ms],data [mV]:\n";
        // no mark, complete, banner between frames, banner within a frame, complete
        let mark = "1.5,0,A\n";
        let text =
            [head, &block(sound), mark, &block(sound), banner, mark, &broken, mark, &block(railed)]
                .concat();
        assert!(is_log(text.as_bytes()));
        let recording = parse(text.as_bytes(), Path::new("log.csv")).unwrap();
        assert_eq!((recording.real.dim(), recording.skipped.frames), ((2, 256), 1));
        let quality = recording.quality.unwrap();
        // of another converter no count is the largest
        let wide = |row, column| if row == 3 { 65_535 + column as u32 } else { sound(row, column) };
        let text = [head, mark, &block(wide)].concat();
        assert_eq!(parse(text.as_bytes(), Path::new("log.csv")).unwrap().quality, None);
        for (frame, counts) in [&sound as &dyn Fn(usize, usize) -> u32, &railed].iter().enumerate()
        {
            for index in 0..256 {
                let count = counts(index / 16, index % 16);
                assert_eq!(recording.real[[frame, index]], f64::from(count));
                let wanted = if count == 65_535 { Quality::SATURATED } else { Quality::GOOD };
                assert_eq!(quality[[frame, index]], wanted, "{count}");
            }
        }
    }
}
