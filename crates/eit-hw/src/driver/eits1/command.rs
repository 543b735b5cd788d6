//! Commands to an EITS-1 instrument, and how long their answers may take.

use std::time::Duration;

use crate::codec::eits1::{CRC_BYTES, HEADER_BYTES, Kind, Message, encode};
use crate::error::HwError;
use crate::transport::{Endpoint, Link};

/// One answer must come within this, beside the time that command and answer take on the line.
const ANSWER_LIMIT: Duration = Duration::from_millis(500);
/// Bits of a byte on a serial line.
const BITS: f64 = 10.0;
/// A line is no slower than this after the first attempt: an adapter may be set to another rate than it
/// has on its other side.
const SLOWEST_BAUD: u32 = 9600;
/// A command to the instrument.
pub(super) struct Command<'a> {
    pub kind: Kind,
    pub payload: &'a [u8],
    /// Kind of the message that answers it.
    pub answer: Kind,
    /// What it tells the instrument to do, for messages.
    pub purpose: &'static str,
}

impl Command<'static> {
    pub fn without_payload(kind: Kind, answer: Kind, purpose: &'static str) -> Self {
        Self { kind, payload: &[], answer, purpose }
    }
}

/// How long to wait for an answer: command and answer take their time on a serial line.
pub(super) fn answer_limit(
    endpoint: &Endpoint,
    attempt: u32,
    payload: usize,
    wanted: Kind,
) -> Duration {
    let Endpoint::Serial { baud, .. } = endpoint else { return ANSWER_LIMIT };
    let answer = match wanted {
        Kind::Configuration => payload,
        // two texts of at most 255 bytes
        Kind::Information => 64,
        _ => 8,
    };
    let baud = if attempt == 0 { *baud } else { (*baud).min(SLOWEST_BAUD) };
    let bytes = 2 * (HEADER_BYTES + CRC_BYTES + 8) + payload + answer;
    // COBS adds a byte in 254, the device its own time
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
    // the first 0 ends what noise may have begun
    let mut wire = vec![0];
    let message = Message { kind, sequence, device_time_us: 0, flags: 0, count, payload };
    encode(&message, &mut wire)?;
    link.write(&wire)
}
