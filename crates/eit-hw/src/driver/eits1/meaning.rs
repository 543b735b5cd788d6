//! What the messages of an EITS-1 instrument mean.

use crate::codec::eits1::{Message, Refusal, flags};
use crate::error::shortened;
use crate::frame::Quality;

/// Why a command was refused, in words.
pub(super) fn reason(payload: &[u8]) -> String {
    let (code, text) = match payload {
        [_, code, text @ ..] => (*code, String::from_utf8_lossy(text)),
        _ => return "no reason given".into(),
    };
    let known = [
        (Refusal::UnknownKind, "unknown command"),
        (Refusal::Length, "wrong length"),
        (Refusal::Value, "value cannot be set"),
        (Refusal::Busy, "busy"),
        (Refusal::Hardware, "hardware failure"),
    ];
    let why = known.iter().find(|(refusal, _)| *refusal as u8 == code);
    let why = why.map_or_else(|| format!("code {code}"), |(_, why)| (*why).to_owned());
    let text = shortened(&text.replace(char::is_control, "?"));
    if text.is_empty() { why } else { format!("{why} ({text})") }
}

/// The count without wrapping; `None` where it does not go forward.
pub(super) fn unwrapped(last: &mut Option<(u32, u64)>, sequence: u32) -> Option<u64> {
    let count = match *last {
        None => u64::from(sequence),
        Some((before, count)) => {
            let step = sequence.wrapping_sub(before);
            if step == 0 || step > u32::MAX / 2 {
                return None;
            }
            count + u64::from(step)
        }
    };
    *last = Some((sequence, count));
    Some(count)
}

/// Takes values and flags out of a frame.
pub(super) fn fill(
    message: &Message<'_>,
    values: &mut [f64],
    imaginary: &mut [f64],
    flags_of: &mut [Quality],
) {
    let step = if message.is_complex() { 2 } else { 1 };
    for (index, value) in message.values().map(f64::from).enumerate() {
        let slot = if index % step == 0 {
            values.get_mut(index / step)
        } else {
            imaginary.get_mut(index / step)
        };
        if let Some(slot) = slot {
            *slot = value;
        }
    }
    let mut all = Quality::GOOD;
    if message.flags & flags::VALUE_FLAGS == 0 {
        if message.flags & flags::SATURATED != 0 {
            all |= Quality::SATURATED;
        }
        if message.flags & flags::ELECTRODE_OFF != 0 {
            all |= Quality::OPEN;
        }
    }
    for (slot, quality) in flags_of.iter_mut().zip(message.qualities()) {
        *slot = quality | all;
    }
}

/// Text for people, without control characters.
pub(super) fn text(payload: &[u8]) -> String {
    String::from_utf8_lossy(payload).replace(char::is_control, "?")
}

#[cfg(test)]
mod tests {
    use super::unwrapped;

    #[test]
    fn the_count_goes_on_where_the_sequence_wraps() {
        let mut last = None;
        assert_eq!(unwrapped(&mut last, u32::MAX), Some(u64::from(u32::MAX)));
        assert_eq!(unwrapped(&mut last, u32::MAX), None);
        assert_eq!(unwrapped(&mut last, 1), Some((1 << 32) + 1));
        assert_eq!(unwrapped(&mut last, 0), None);
        assert_eq!(unwrapped(&mut last, 2), Some((1 << 32) + 2));
    }
}
