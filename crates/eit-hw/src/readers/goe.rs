//! Goe-MF II (also MCEIT, Viasys) `.get`: 16 electrodes, adjacent drive and measurement.
//!
//! No header; a frame is 256 little-endian f32. The first 208 are voltages: drive d = (d, d+1),
//! then the measured pairs (d+2+k, d+3+k) mod 16 for k = 0 to 12 ("rotated" order). The other 48
//! (drive voltages and currents, offsets) are ignored: sources disagree on their order and scale.
//! The voltages therefore have no known scale, and their unit is [`Unit::Arbitrary`].
//!
//! Some instruments measure only one of each reciprocal pair and leave the other 0; the zeros are
//! filled in.

use std::path::Path;

use crate::error::{At, HwError, Place};
use crate::recording::{Contents, Format, Layout, Note, Recording, SkipReason, Skipped, Unit};

const ELECTRODES: usize = 16;
/// Measured pairs per drive: those without a driven electrode.
const PAIRS: usize = ELECTRODES - 3;
const MEASUREMENTS: usize = ELECTRODES * PAIRS;
const FRAME_BYTES: usize = 256 * 4;
/// Largest plausible magnitude of a voltage in any unit; larger values indicate another file
/// format.
const LARGEST: f64 = 1e6;

/// Parses the content of a `.get` file; `path` is used in messages only.
///
/// The layout is [`Layout::ProtocolOrder`] with 208 values. Bytes after the last complete frame
/// count as one skipped frame.
///
/// # Errors
/// [`HwError`] for an empty or text file, a Draeger file, less than one frame, and a value that is
/// NaN, infinite or implausible as a voltage.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Recording, HwError> {
    if bytes.is_empty() {
        return Err(HwError::Empty { place: Place::file(path) });
    }
    if bytes.starts_with(b"---Draeger") {
        return Err(HwError::Unsupported { place: Place::file(path), format: "Draeger" });
    }
    let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t' | b'\n' | b'\r');
    if bytes.iter().take(FRAME_BYTES).all(is_text) {
        let format = Format::Goe.name();
        return Err(HwError::NotBinary { place: Place::file(path), format });
    }
    let (frames, rest) = bytes.as_chunks::<FRAME_BYTES>();
    let mut skipped = Skipped::default();
    if !rest.is_empty() {
        let reason = SkipReason::Bytes { found: rest.len(), wanted: FRAME_BYTES };
        skipped.add(1, At::Byte(frames.len() * FRAME_BYTES), reason);
    }
    let filled = is_half(frames);
    let mut real = Vec::with_capacity(frames.len() * MEASUREMENTS);
    for (frame, bytes) in frames.iter().enumerate() {
        let mut measured = [0.0; MEASUREMENTS];
        for (measurement, slot) in measured.iter_mut().enumerate() {
            *slot = value_of(bytes, measurement);
            let (value, place) =
                (*slot, || Place::byte(path, frame * FRAME_BYTES + measurement * 4));
            if !value.is_finite() {
                return Err(HwError::NonFinite { place: place(), frame, measurement, value });
            }
            if value.abs() > LARGEST {
                return Err(HwError::Implausible { place: place(), value, format: "Goe-MF II" });
            }
        }
        if filled {
            fill_by_reciprocity(&mut measured);
        }
        real.extend(measured);
    }
    let value_count = MEASUREMENTS;
    let contents = Contents { real, value_count, skipped, ..Contents::default() };
    let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
    let mut recording = Recording::new(contents, layout, unit, Format::Goe, path)?;
    if filled {
        recording.notes.push(Note::FilledByReciprocity { values: MEASUREMENTS / 2 });
    }
    Ok(recording)
}

/// Returns a value of a stored frame.
fn value_of(frame: &[u8; FRAME_BYTES], measurement: usize) -> f64 {
    let (floats, _) = frame.as_chunks::<4>();
    floats.get(measurement).map_or(0.0, |float| f64::from(f32::from_le_bytes(*float)))
}

/// Returns the measured pair of a place in the frame.
const fn pair_of(slot: usize) -> usize {
    (slot / PAIRS + 2 + slot % PAIRS) % ELECTRODES
}

/// Returns whether a position belongs to the half that some instruments leave empty: measured pairs
/// that start before the drive.
const fn is_empty(slot: usize) -> bool {
    pair_of(slot) < slot / PAIRS
}

/// Returns whether that half, and not everything, is 0 in all frames.
fn is_half(frames: &[[u8; FRAME_BYTES]]) -> bool {
    let zero = |slot: usize| frames.iter().all(|frame| value_of(frame, slot) == 0.0);
    (0..MEASUREMENTS).all(|slot| !is_empty(slot) || zero(slot)) && !(0..MEASUREMENTS).all(zero)
}

/// Fills the empty half of a frame.
fn fill_by_reciprocity(frame: &mut [f64; MEASUREMENTS]) {
    for slot in (0..MEASUREMENTS).filter(|&slot| is_empty(slot)) {
        // take drive s and measured pair d instead of drive d and measured pair s = d + 2 + k:
        // d = s + 2 + (12 - k) mod 16
        frame[slot] = frame[PAIRS * pair_of(slot) + PAIRS - 1 - slot % PAIRS];
    }
}
