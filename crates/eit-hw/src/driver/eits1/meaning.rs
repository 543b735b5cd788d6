//! Interpretation of an EITS-1 instrument's messages.

use crate::codec::eits1::{Message, Refusal, flags};
use crate::error::shortened;
use crate::frame::Quality;

/// Returns the reason for a refusal in words.
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

/// Number of consecutively numbered but unexpected frames after which the counter is taken as
/// restarted.
const NEW_RUN: u32 = 3;
/// Number of lost frames accepted in any case; a larger gap requires that there was time to send
/// them.
const MOST_LOST: f64 = 100.0;

/// Counts frames without wrapping.
#[derive(Clone, Debug, Default)]
pub(super) struct Count {
    /// Last sequence number and the count it corresponds to.
    last: Option<(u32, u64)>,
    /// Last sequence number that did not follow, and how many such frames came in a row.
    other: Option<(u32, u32)>,
}

/// Result of checking a frame's sequence number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Counted {
    /// A frame in order, with its 64-bit sequence number.
    Frame(u64),
    /// An older frame, a repeated one, or one with an implausible number.
    PassedOver,
    /// The counter has restarted; the frame has this count, and `passed_over` frames before it were
    /// skipped.
    Renumbered { count: u64, passed_over: u32 },
}

impl Count {
    /// Checks a frame's sequence number; about `possible` frames can have been sent since the
    /// previous one.
    pub(super) fn take(&mut self, sequence: u32, possible: f64) -> Counted {
        let Some((before, count)) = self.last else {
            *self = Self { last: Some((sequence, u64::from(sequence))), other: None };
            return Counted::Frame(u64::from(sequence));
        };
        let step = sequence.wrapping_sub(before);
        let is_forward = step != 0 && step <= u32::MAX / 2;
        if is_forward && f64::from(step) <= MOST_LOST + 2.0 * possible {
            let count = count + u64::from(step);
            *self = Self { last: Some((sequence, count)), other: None };
            return Counted::Frame(count);
        }
        let run = match self.other {
            Some((other, run)) if sequence == other.wrapping_add(1) => run + 1,
            _ => 1,
        };
        if run < NEW_RUN {
            self.other = Some((sequence, run));
            return Counted::PassedOver;
        }
        let count = u64::from(sequence);
        *self = Self { last: Some((sequence, count)), other: None };
        Counted::Renumbered { count, passed_over: NEW_RUN - 1 }
    }
}

/// Copies values and flags from a frame.
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

/// Returns text for people, without control characters.
pub(super) fn text(payload: &[u8]) -> String {
    String::from_utf8_lossy(payload).replace(char::is_control, "?")
}

#[cfg(test)]
mod tests {
    use super::{Count, Counted};

    #[test]
    fn the_count_goes_on_where_the_sequence_wraps() {
        let mut count = Count::default();
        let mut take = |sequence| count.take(sequence, 1.0);
        assert_eq!(take(u32::MAX), Counted::Frame(u64::from(u32::MAX)));
        assert_eq!(take(u32::MAX), Counted::PassedOver);
        assert_eq!(take(1), Counted::Frame((1 << 32) + 1));
        assert_eq!(take(0), Counted::PassedOver);
        assert_eq!(take(2), Counted::Frame((1 << 32) + 2));
    }

    /// A single implausible number is skipped; a run of them means that the counter restarted.
    #[test]
    fn a_count_that_begins_anew_is_told_from_frames_out_of_order() {
        let mut count = Count::default();
        let taken: Vec<Counted> = [500, 501, 1_000_000_000, 502, 501, 502, 503, 504]
            .iter()
            .map(|&sequence| count.take(sequence, 1.0))
            .collect();
        let (frame, passed) = (Counted::Frame, Counted::PassedOver);
        let wanted =
            [frame(500), frame(501), passed, frame(502), passed, passed, frame(503), frame(504)];
        assert_eq!(taken, wanted);
        for start in [0, 1_000_000] {
            let taken: Vec<Counted> =
                (start..start + 4).map(|sequence| count.take(sequence, 1.0)).collect();
            let anew = Counted::Renumbered { count: u64::from(start) + 2, passed_over: 2 };
            assert_eq!(taken, [passed, passed, anew, frame(u64::from(start) + 3)]);
        }
        // after a pause long enough to send them, missing frames are a loss
        assert_eq!(count.take(1_005_000, 3000.0), frame(1_005_000));
    }
}
