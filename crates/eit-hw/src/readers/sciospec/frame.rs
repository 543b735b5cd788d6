//! The content of one `.eit` file.

use std::path::Path;

use super::header::Header;
use crate::error::{HwError, Place};
use crate::readers::{text, wrong_field};

/// Most lines in a file: those of 1 024 drives at 256 frequencies.
const MOST_LINES: usize = 1 << 18;
/// Most values in a line: real and imaginary parts of more channels than any device has.
const MOST_PARTS: usize = 1 << 14;

/// Potentials of one frame at one frequency.
#[derive(Debug)]
pub(super) struct EitFrame {
    /// Electrodes (from 0) where current enters and leaves.
    pub(super) drives: Vec<[u32; 2]>,
    pub(super) electrodes: usize,
    /// Potentials in volts, [drive, electrode].
    pub(super) real: Vec<f64>,
    pub(super) imaginary: Vec<f64>,
    pub(super) time_ms: Option<i64>,
    pub(super) frequency_hz: f64,
    pub(super) current_a: f64,
}

impl EitFrame {
    pub(super) fn parse(bytes: &[u8], path: &Path, frequency_row: usize) -> Result<Self, HwError> {
        refuse_other_makers(bytes, path)?;
        let content = text::decode(bytes, path)?;
        let found = text::lines(content).count();
        if found > MOST_LINES {
            return Err(HwError::count(
                Place::file(path),
                "lines",
                [found, MOST_LINES],
                "is the most in a file, which has one frame: it is damaged or not one of these",
            ));
        }
        let lines: Vec<_> = text::lines(content).collect();
        let header = Header::parse(&lines, path)?;
        let rows = header.frequencies;
        if frequency_row >= rows {
            let (place, row) = (Place::file(path), frequency_row);
            return Err(HwError::FrequencyRow { place, row, rows });
        }
        let mut body = &lines[header.lines..];
        while let [rest @ .., (_, last)] = body
            && last.trim().is_empty()
        {
            body = rest;
        }
        if body.is_empty() {
            return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 });
        }
        let mut channels = Channels { list: header.channels.clone(), device: None };
        let mut frame = Self {
            drives: Vec::new(),
            electrodes: 0,
            real: Vec::new(),
            imaginary: Vec::new(),
            time_ms: header.time_ms,
            frequency_hz: header.frequency_hz(frequency_row),
            current_a: header.current_a,
        };
        for block in body.chunks(rows.saturating_add(1)) {
            let (drive_number, drive_line) = block[0];
            let lines = &block[1..];
            if lines.len() < rows {
                return Err(HwError::count(
                    Place::line(path, drive_number),
                    "lines of potentials after this drive",
                    [lines.len(), rows],
                    "the file is truncated: copy it again or remove it",
                ));
            }
            let (number, line) = lines[frequency_row];
            frame.push_potentials(line, number, path, &mut channels)?;
            frame.drives.push(drive(drive_line, drive_number, path, &channels)?);
        }
        text::require_end(content, path)?;
        frame.electrodes = channels.count();
        Ok(frame)
    }

    /// Appends the potentials of the channels that are electrodes.
    fn push_potentials(
        &mut self,
        line: &str,
        number: usize,
        path: &Path,
        channels: &mut Channels,
    ) -> Result<(), HwError> {
        let place = || Place::line(path, number);
        let parts = parts(line, number, path, channels)?;
        let device = parts.len() / 2;
        for electrode in 0..channels.count() {
            let channel =
                channels.list.as_ref().map_or(electrode, |list| list[electrode] as usize - 1);
            if channel >= device {
                return Err(HwError::count(
                    place(),
                    "channels",
                    [device, channel + 1],
                    "as in the header's `MeasurementChannels`: the file is damaged",
                ));
            }
            for (value, list) in [
                (parts[2 * channel], &mut self.real),
                (parts[2 * channel + 1], &mut self.imaginary),
            ] {
                if !value.is_finite() {
                    let measurement = self.drives.len() * channels.count() + electrode;
                    return Err(HwError::NonFinite {
                        place: place(),
                        frame: 0,
                        measurement,
                        value,
                    });
                }
                list.push(value);
            }
        }
        Ok(())
    }
}

/// Parses real and imaginary parts of all channels of the device, as many as in the first line.
fn parts(
    line: &str,
    number: usize,
    path: &Path,
    channels: &mut Channels,
) -> Result<Vec<f64>, HwError> {
    let place = || Place::line(path, number);
    let fields = line.split_whitespace().zip(1..);
    let parts: Vec<f64> = fields
        .take(MOST_PARTS + 1)
        .map(|(field, index)| text::number(field, index, place))
        .collect::<Result<_, _>>()?;
    let device = *channels.device.get_or_insert((parts.len() / 2).min(MOST_PARTS / 2));
    if parts.len() == 2 * device && device > 0 {
        return Ok(parts);
    }
    Err(HwError::count(
        place(),
        "real and imaginary parts",
        [parts.len(), 2 * device.max(1)],
        "every line must have as many as the first: the file is truncated or damaged",
    ))
}

/// The channels of the device that are electrodes.
struct Channels {
    /// From the header, counted from 1; `None` for all channels of the device.
    list: Option<Vec<u32>>,
    /// Number of channels of the device, known from the first line of potentials.
    device: Option<usize>,
}

impl Channels {
    fn count(&self) -> usize {
        self.list.as_ref().map_or(self.device.unwrap_or_default(), Vec::len)
    }

    /// Returns the electrode (from 0) of a channel (from 1).
    fn electrode(&self, channel: u32) -> Option<u32> {
        let index = match &self.list {
            Some(list) => list.iter().position(|&other| other == channel)?,
            None => {
                let index = (channel as usize).checked_sub(1)?;
                (index < self.count()).then_some(index)?
            }
        };
        u32::try_from(index).ok()
    }
}

/// Parses the electrodes of a line `a b`.
fn drive(line: &str, number: usize, path: &Path, channels: &Channels) -> Result<[u32; 2], HwError> {
    let mut fields = line.split_whitespace();
    let mut next = || channels.electrode(fields.next()?.parse().ok()?);
    match (next(), next(), fields.next()) {
        (Some(a), Some(b), None) if a != b => Ok([a, b]),
        _ => {
            let wanted = "two different numbers of measurement channels";
            let mend = "the file is truncated or damaged: copy it again or remove it";
            Err(wrong_field(Place::line(path, number), "drive", line, wanted, mend))
        }
    }
}

/// Rejects `.eit` files of other manufacturers' instruments.
fn refuse_other_makers(bytes: &[u8], path: &Path) -> Result<(), HwError> {
    let start = &bytes[..bytes.len().min(80)];
    let format = if start.windows(10).any(|text| text == b"---Draeger") {
        "Draeger"
    } else if start.starts_with(b"\xFF\xFE") {
        "Carefusion"
    } else if start.starts_with(b"\x00\x00\x00\x02")
        || start.starts_with(b"\x00\x00\x00\x03")
        || start.starts_with(b"\x00\x00\x00\x04")
        || start.starts_with(b"\x04\x00\x00\x00")
    {
        "Swisstom"
    } else {
        return Ok(());
    };
    Err(HwError::Unsupported { place: Place::file(path), format })
}
