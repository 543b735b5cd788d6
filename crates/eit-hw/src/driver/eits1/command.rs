//! Commands to an EITS-1 instrument, and time limits for their answers.

use std::time::Duration;

use crate::codec::eits1::{CRC_BYTES, HEADER_BYTES, Kind, Message, encode};
use crate::error::HwError;
use crate::transport::{Endpoint, Link};

/// Time limit for an answer, in addition to the transmission time of command and answer.
const ANSWER_LIMIT: Duration = Duration::from_millis(500);
/// Bits per byte on a serial line.
const BITS: f64 = 10.0;
/// Highest baud rate assumed after the first attempt: the other side of an adapter may run slower
/// than the rate it is set to.
const SLOWEST_BAUD: u32 = 9600;
/// A command to the instrument.
pub(super) struct Command<'a> {
    pub(crate) kind: Kind,
    pub(crate) payload: &'a [u8],
    /// Kind of the message that answers the command.
    pub(crate) answer: Kind,
    /// What the command tells the instrument to do, for error messages.
    pub(crate) purpose: &'static str,
}

impl Command<'static> {
    pub(super) fn without_payload(kind: Kind, answer: Kind, purpose: &'static str) -> Self {
        Self { kind, payload: &[], answer, purpose }
    }
}

/// Returns how long to wait for an answer, including transmission times on a serial line.
pub(super) fn answer_limit(
    endpoint: &Endpoint,
    attempt: u32,
    payload: usize,
    wanted: Kind,
) -> Duration {
    let Endpoint::Serial { baud, .. } = endpoint else { return ANSWER_LIMIT };
    let answer = match wanted {
        Kind::Configuration => payload,
        // two texts, of at most 255 bytes each
        Kind::Information => 64,
        _ => 8,
    };
    let baud = if attempt == 0 { *baud } else { (*baud).min(SLOWEST_BAUD) };
    let bytes = 2 * (HEADER_BYTES + CRC_BYTES + 8) + payload + answer;
    // COBS adds one byte in 254, and the device needs time of its own
    let line_s = 1.1 * BITS * bytes as f64 / f64::from(baud.max(1));
    ANSWER_LIMIT + Duration::from_secs_f64(line_s)
}

pub(super) fn send(
    link: &mut Link,
    kind: Kind,
    sequence: u32,
    payload: &[u8],
) -> Result<(), HwError> {
    let count = payload.len().min(usize::from(u16::MAX)) as u16;
    // the leading 0 ends whatever noise may have started
    let mut wire = vec![0];
    let message = Message { kind, sequence, device_time_us: 0, flags: 0, count, payload };
    encode(&message, &mut wire)?;
    link.write(&wire)
}
