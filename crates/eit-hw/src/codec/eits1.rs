//! EITS-1: this project's own protocol, for skins with custom firmware.
//!
//! A message is a header of 20 bytes, a payload and a CRC-32C of both, COBS-encoded (Cheshire and
//! Baker 1999) and terminated by a zero byte. A receiver therefore resynchronises at the next zero
//! after any loss, and a damaged message is accepted with a probability of about 2^-32 (Koopman
//! 2002). docs/EITS-1.md is the specification, `c/eits1.h` an encoder in C99.

mod body;
mod cobs;

pub use body::{Configuration, Information};

use crate::error::HwError;
use crate::frame::Quality;

/// Version of the protocol: the first byte of each message.
pub(crate) const VERSION: u8 = 1;
/// Length of the header, which precedes the payload.
pub(crate) const HEADER_BYTES: usize = 20;
/// Longest message before COBS encoding, with header and CRC. A frame of all 928 complex adjacent
/// measurements of 32 electrodes, with a flag byte each, takes 8 400 bytes.
pub const MAX_MESSAGE_BYTES: usize = 16_384;

pub(crate) const CRC_BYTES: usize = 4;

/// Remainder of each byte by the polynomial of CRC-32C, 1EDC6F41, bits reversed.
const REMAINDERS: [u32; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut rest, mut bit) = (byte as u32, 0);
        while bit < 8 {
            rest = (rest >> 1) ^ if rest & 1 == 1 { 0x82F6_3B78 } else { 0 };
            bit += 1;
        }
        table[byte] = rest;
        byte += 1;
    }
    table
};

/// CRC-32C: E3069283 for "123456789".
fn checksum(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| (crc >> 8) ^ REMAINDERS[usize::from(crc as u8 ^ byte)];
    !bytes.iter().fold(u32::MAX, step)
}

/// Type of a message: its second byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Kind {
    /// From the device: [`Information`] about itself.
    Information = 0x01,
    /// To the device: the [`Configuration`] to use. From the device: the one in force.
    Configuration = 0x02,
    /// From the device: command done; the payload is the kind of the command.
    Acknowledgement = 0x03,
    /// From the device: command refused; the payload is the kind of the command, a [`Refusal`] and
    /// text.
    Refusal = 0x04,
    /// From the device: one frame of values.
    Frame = 0x10,
    /// From the device: UTF-8 text for people.
    Text = 0x20,
    /// To the device: send your information.
    Identify = 0x40,
    /// To the device: send the configuration in force.
    ReadConfiguration = 0x41,
    /// To the device: start sending frames.
    Start = 0x42,
    /// To the device: stop sending frames.
    Stop = 0x43,
}

impl Kind {
    const ALL: [Self; 10] = [
        Self::Information,
        Self::Configuration,
        Self::Acknowledgement,
        Self::Refusal,
        Self::Frame,
        Self::Text,
        Self::Identify,
        Self::ReadConfiguration,
        Self::Start,
        Self::Stop,
    ];

    /// Returns the kind with this byte, or `None` if there is none.
    pub fn of(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&kind| kind as u8 == byte)
    }
}

/// Why a device refuses a command: the second byte of a [`Kind::Refusal`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Refusal {
    /// Unknown kind of command.
    UnknownKind = 1,
    /// Wrong payload length.
    Length = 2,
    /// A value cannot be set.
    Value = 3,
    /// Not possible now, for example while frames are being sent.
    Busy = 4,
    /// Hardware failure.
    Hardware = 5,
}

/// Flag bits of the header.
pub mod flags {
    /// At least one value of the frame is saturated.
    pub const SATURATED: u16 = 1;
    /// At least one electrode is off.
    pub const ELECTRODE_OFF: u16 = 1 << 1;
    /// The device dropped frames before this one.
    pub const DROPPED_BEFORE: u16 = 1 << 2;
    /// Values are calibrated: in the unit that the information names.
    pub const CALIBRATED: u16 = 1 << 3;
    /// Real and imaginary parts alternate.
    pub const COMPLEX: u16 = 1 << 4;
    /// The values are followed by one byte of [`Quality`](crate::Quality) bits per measurement.
    pub const VALUE_FLAGS: u16 = 1 << 5;
}

/// One message, with a borrowed payload.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Message<'a> {
    /// Type of the message.
    pub kind: Kind,
    /// Frame number, wrapping; in a command the host's own number, in an answer that of the
    /// command.
    pub sequence: u32,
    /// Device clock in microseconds at the middle of the measurement; 0 in commands.
    pub device_time_us: u64,
    /// Flag bits; see [`flags`].
    pub flags: u16,
    /// Number of `f32` values of a frame (two per complex value); otherwise length of the payload.
    pub count: u16,
    /// Bytes after the header.
    pub payload: &'a [u8],
}

impl Message<'_> {
    /// Returns the number of measurements of a frame: half the count for complex values.
    pub fn measurements(&self) -> usize {
        let count = usize::from(self.count);
        if self.is_complex() { count / 2 } else { count }
    }

    /// Returns whether real and imaginary parts alternate.
    pub(crate) fn is_complex(&self) -> bool {
        self.flags & flags::COMPLEX != 0
    }

    /// Iterates over the `count` values of a frame; real and imaginary parts alternate if complex.
    pub fn values(&self) -> impl Iterator<Item = f32> + '_ {
        let (values, _) = self.payload.as_chunks::<4>();
        values.iter().take(usize::from(self.count)).map(|&bytes| f32::from_le_bytes(bytes))
    }

    /// Iterates over the device's flags of each measurement; good if the frame has none. Unknown
    /// bits are ignored.
    pub fn qualities(&self) -> impl Iterator<Item = Quality> + '_ {
        let flags = self.payload.get(4 * usize::from(self.count)..).unwrap_or_default();
        (0..self.measurements()).map(move |index| {
            let bits = flags.get(index).copied().unwrap_or_default();
            Quality::from_bits(u16::from(bits & 0x3F)).unwrap_or_default()
        })
    }

    fn fits(&self) -> bool {
        let count = usize::from(self.count);
        if self.kind != Kind::Frame {
            return self.payload.len() == count;
        }
        let flag_bytes = if self.flags & flags::VALUE_FLAGS != 0 { self.measurements() } else { 0 };
        (!self.is_complex() || count.is_multiple_of(2))
            && self.payload.len() == 4 * count + flag_bytes
    }
}

/// Appends an encoded message, with its final zero byte, to `wire`.
///
/// # Errors
/// [`HwError::Setting`] if the payload does not match the kind, flags and count, or the message is
/// longer than [`MAX_MESSAGE_BYTES`]; nothing is written then.
pub fn encode(message: &Message<'_>, wire: &mut Vec<u8>) -> Result<(), HwError> {
    let length = HEADER_BYTES + message.payload.len() + CRC_BYTES;
    if !message.fits() || length > MAX_MESSAGE_BYTES {
        return Err(HwError::setting(
            "EITS-1 payload",
            format!("{} bytes for count {}", message.payload.len(), message.count),
            "4 bytes a value and 1 a flag, at most 16 384 with header and CRC",
        ));
    }
    let mut bytes = Vec::with_capacity(length);
    bytes.extend([VERSION, message.kind as u8, 0, 0]);
    bytes.extend(message.sequence.to_le_bytes());
    bytes.extend(message.device_time_us.to_le_bytes());
    bytes.extend(message.flags.to_le_bytes());
    bytes.extend(message.count.to_le_bytes());
    bytes.extend(message.payload);
    bytes.extend(checksum(&bytes).to_le_bytes());
    cobs::encode(&bytes, wire);
    wire.push(0);
    Ok(())
}

/// Outcome of decoding the bytes received so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// A complete message with the right CRC.
    Message(Message<'a>),
    /// Bytes before a zero byte that form no message; consecutive zero bytes are not reported.
    Damaged {
        /// Number of bytes, without the zero.
        bytes: usize,
        /// Reason for rejecting them.
        damage: Damage,
    },
}

/// Why bytes do not form a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Damage {
    /// Invalid COBS encoding.
    Cobs,
    /// Shorter than header and CRC, or longer than [`MAX_MESSAGE_BYTES`].
    Length,
    /// Wrong CRC.
    Crc,
    /// The CRC is right, but version, kind, flags and count are inconsistent: another version.
    Meaning,
}

/// Decodes EITS-1 messages.
///
/// ```
/// use eit_hw::codec::eits1::{Decoder, Event, Kind};
/// let wire = [
///     0x03, 0x01, 0x10, 0x01, 0x02, 0x07, 0x01, 0x01, 0x04, 0x40, 0x42, 0x0F, 0x01, 0x01, 0x01, 0x01,
///     0x01, 0x01, 0x02, 0x02, 0x01, 0x01, 0x03, 0xC0, 0x3F, 0x01, 0x07, 0x80, 0xBE, 0x14, 0xF5,
///     0x93, 0x1D, 0x00,
/// ];
/// let mut found = None;
/// Decoder::new().push(&wire, &mut |event| {
///     if let Event::Message(message) = event {
///         found = Some((message.kind, message.sequence, message.values().collect::<Vec<_>>()));
///     }
/// });
/// assert_eq!(found, Some((Kind::Frame, 7, vec![1.5, -0.25])));
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: Vec<u8>,
    /// Bytes since the last zero byte, including those beyond the buffer.
    received: usize,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// Creates a decoder that expects the start of a message.
    pub fn new() -> Self {
        Self { buffer: Vec::with_capacity(cobs::longest(MAX_MESSAGE_BYTES)), received: 0 }
    }

    /// Discards an incomplete message.
    pub fn reset(&mut self) {
        self.buffer.clear();
        self.received = 0;
    }

    /// Decodes bytes as they arrive and calls `on_event` for each completed message.
    pub fn push(&mut self, bytes: &[u8], on_event: &mut impl FnMut(Event<'_>)) {
        for &byte in bytes {
            if byte != 0 {
                self.received = self.received.saturating_add(1);
                if self.buffer.len() < cobs::longest(MAX_MESSAGE_BYTES) {
                    self.buffer.push(byte);
                }
                continue;
            }
            if self.received > 0 {
                let bytes = self.received;
                match self.message() {
                    Ok(message) => on_event(Event::Message(message)),
                    Err(damage) => on_event(Event::Damaged { bytes, damage }),
                }
            }
            self.reset();
        }
    }

    fn message(&mut self) -> Result<Message<'_>, Damage> {
        if self.received > cobs::longest(MAX_MESSAGE_BYTES) {
            return Err(Damage::Length);
        }
        let length = cobs::decode_in_place(&mut self.buffer).ok_or(Damage::Cobs)?;
        let bytes = &self.buffer[..length];
        let (body, crc) = bytes.split_last_chunk::<CRC_BYTES>().ok_or(Damage::Length)?;
        let (header, payload) = body.split_first_chunk::<HEADER_BYTES>().ok_or(Damage::Length)?;
        if length > MAX_MESSAGE_BYTES {
            return Err(Damage::Length);
        }
        if checksum(body) != u32::from_le_bytes(*crc) {
            return Err(Damage::Crc);
        }
        let [version, kind, _, _, s0, s1, s2, s3, time @ .., f0, f1, c0, c1] = *header;
        let message = Message {
            kind: Kind::of(kind).ok_or(Damage::Meaning)?,
            sequence: u32::from_le_bytes([s0, s1, s2, s3]),
            device_time_us: u64::from_le_bytes(time),
            flags: u16::from_le_bytes([f0, f1]),
            count: u16::from_le_bytes([c0, c1]),
            payload,
        };
        if version == VERSION && message.fits() { Ok(message) } else { Err(Damage::Meaning) }
    }
}
