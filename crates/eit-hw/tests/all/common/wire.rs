//! Bytes as instruments send them, and what codecs decode from them.

use eit_hw::codec::{eits1, sciospec, text};
use text::{Framing, TextFormat};

/// Decodes pieces to events as text: events borrow, and only their equality matters.
pub fn eits1_events(pieces: &[&[u8]]) -> Vec<String> {
    let (mut decoder, mut events) = (eits1::Decoder::new(), Vec::new());
    pieces.iter().for_each(|piece| decoder.push(piece, &mut |e| events.push(format!("{e:?}"))));
    events
}

pub fn sciospec_events(pieces: &[&[u8]]) -> Vec<String> {
    let mut decoder = sciospec::Decoder::new(sciospec::Output::default());
    let mut events = Vec::new();
    pieces.iter().for_each(|piece| decoder.push(piece, &mut |e| events.push(format!("{e:?}"))));
    events
}

pub fn text_events(format: &TextFormat, pieces: &[&[u8]]) -> Vec<String> {
    let mut decoder = text::Decoder::new(format.clone()).unwrap();
    let mut events = Vec::new();
    pieces.iter().for_each(|piece| decoder.push(piece, &mut |e| events.push(format!("{e:?}"))));
    events
}

pub fn eits1_frame(sequence: u32, device_time_us: u64, values: &[f32]) -> Vec<u8> {
    let payload: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let mut wire = Vec::new();
    let (kind, count, payload) = (eits1::Kind::Frame, values.len() as u16, &payload[..]);
    let message = eits1::Message { kind, sequence, device_time_us, flags: 0, count, payload };
    eits1::encode(&message, &mut wire).unwrap();
    wire
}

/// Returns a data frame of 16 channels as sent, whose values encode its drive and time.
pub fn sciospec_frame(group: u8, drive: [u8; 2], row: u16, time_ms: u32) -> Vec<u8> {
    let mut potentials_v = [[0.0; 2]; 16];
    for (k, potential) in potentials_v.iter_mut().enumerate() {
        *potential = [(f32::from(drive[0]) + 16.0 * k as f32) / 1024.0, f32::from(group) / 8.0];
    }
    let (drive, frequency_row, time_ms) = (Some(drive), Some(row), Some(time_ms));
    let data = sciospec::DataFrame { group, drive, frequency_row, time_ms, potentials_v };
    let mut wire = Vec::new();
    sciospec::encode_data(&data, &mut wire);
    wire
}

/// Returns a frame as a board sends it: value `index` is `step * index + first`.
pub fn board_frame(format: &TextFormat, first: usize, step: usize) -> Vec<u8> {
    let mut values = (0..).map(|index| format.number.write((index * step + first) as f64));
    let mut bytes = Vec::new();
    if let Framing::StartLine(mark) = &format.framing {
        bytes.extend(format!("{mark}\n").bytes());
    }
    for _ in 0..format.lines_per_frame {
        if let Framing::Prefix(mark) = &format.framing {
            let colon = if mark.starts_with('!') { "" } else { ":" };
            bytes.extend(format!("{mark}{colon} ").bytes());
        }
        let line: Vec<_> = values.by_ref().take(format.values_per_line).collect();
        bytes.extend(format!("{}\r\n", line.join(",")).bytes());
    }
    if let Framing::EndLine(mark) = &format.framing {
        bytes.extend(format!("{mark}\r\n").bytes());
    }
    bytes
}
