//! EITS-1: the native protocol of this project, for skins whose firmware is one's own.
//!
//! A message is a header of 20 bytes, a payload and a CRC-32C of both, COBS-encoded (Cheshire and
//! Baker 1999) and ended by a byte 0. So a receiver is in step again at the next 0 after any loss,
//! and a damaged message is taken for a good one with a probability of about 2^-32 (Koopman 2002).
//! docs/EITS-1.md is the specification, `c/eits1.h` an encoder in C99. A few lines over the usual
//! length, to have the layout of a message in one place.

mod body;
mod cobs;

pub use body::{Configuration, Information};

use crc::{CRC_32_ISCSI, Crc, Table};

use crate::error::HwError;
use crate::frame::Quality;

/// Version of the protocol, the first byte of each message.
pub const VERSION: u8 = 1;
/// Bytes before the payload.
pub const HEADER_BYTES: usize = 20;
/// Longest message before COBS, with header and CRC. 32 electrodes, all 928 complex adjacent
/// measurements with a flag each, take 8 400 bytes.
pub const MAX_MESSAGE_BYTES: usize = 16_384;

pub(crate) const CRC_BYTES: usize = 4;
/// CRC-32C, check value E3069283 over "123456789".
const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISCSI);

/// What a message is, its second byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// From the device: [`Information`] about itself.
    Information = 0x01,
    /// To the device: the [`Configuration`] to use. From it: the one in force.
    Configuration = 0x02,
    /// From the device: done; the payload is the kind of the command.
    Acknowledgement = 0x03,
    /// From the device: not done; the payload is the kind of the command, a [`Refusal`] and text.
    Refusal = 0x04,
    /// From the device: one frame.
    Frame = 0x10,
    /// From the device: text for people, UTF-8.
    Text = 0x20,
    /// To the device: send the information.
    Identify = 0x40,
    /// To the device: send the configuration in force.
    ReadConfiguration = 0x41,
    /// To the device: send frames.
    Start = 0x42,
    /// To the device: send no more frames.
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

    /// The kind of this byte.
    pub fn of(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&kind| kind as u8 == byte)
    }
}

/// Why a device refuses a command, the second byte of a [`Kind::Refusal`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Refusal {
    /// The kind is not known.
    UnknownKind = 1,
    /// The payload has the wrong length.
    Length = 2,
    /// A value cannot be set.
    Value = 3,
    /// Not now, for example not while frames are sent.
    Busy = 4,
    /// The hardware failed.
    Hardware = 5,
}

/// Bits of the header's flags.
pub mod flags {
    /// Some value of the frame is saturated.
    pub const SATURATED: u16 = 1;
    /// Some electrode is off.
    pub const ELECTRODE_OFF: u16 = 1 << 1;
    /// Frames before this one were dropped by the device.
    pub const DROPPED_BEFORE: u16 = 1 << 2;
    /// The values are calibrated: in the unit that the information names.
    pub const CALIBRATED: u16 = 1 << 3;
    /// Values alternate real and imaginary part.
    pub const COMPLEX: u16 = 1 << 4;
    /// After the values, one byte of [`Quality`](crate::Quality) bits for each measurement.
    pub const VALUE_FLAGS: u16 = 1 << 5;
}

/// One message, its payload borrowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Message<'a> {
    /// What it is.
    pub kind: Kind,
    /// Number of the frame, wrapping; in a command the host's own number, in an answer the command's.
    pub sequence: u32,
    /// The device's clock in microseconds, at the middle of the measurement; 0 in commands.
    pub device_time_us: u64,
    /// Bits of [`flags`].
    pub flags: u16,
    /// Number of `f32` values of a frame (two for a complex one), else bytes of the payload.
    pub count: u16,
    /// What follows the header.
    pub payload: &'a [u8],
}

impl Message<'_> {
    /// Number of measurements of a frame: half the count where they are complex.
    pub fn measurements(&self) -> usize {
        let count = usize::from(self.count);
        if self.is_complex() { count / 2 } else { count }
    }

    /// Whether values alternate real and imaginary part.
    pub fn is_complex(&self) -> bool {
        self.flags & flags::COMPLEX != 0
    }

    /// The `count` values of a frame, real and imaginary parts alternating if it is complex.
    pub fn values(&self) -> impl Iterator<Item = f32> + '_ {
        let (values, _) = self.payload.as_chunks::<4>();
        values.iter().take(usize::from(self.count)).map(|&bytes| f32::from_le_bytes(bytes))
    }

    /// The device's flags of each measurement; good where the frame has none. Bits without meaning
    /// are left out.
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

/// Appends a message to `wire`, with its final 0.
///
/// # Errors
/// [`HwError::Setting`] where the payload does not fit the kind, flags and count, or the message is
/// longer than [`MAX_MESSAGE_BYTES`]; nothing is written then.
pub fn encode(message: &Message<'_>, wire: &mut Vec<u8>) -> Result<(), HwError> {
    let length = HEADER_BYTES + message.payload.len() + CRC_BYTES;
    if !message.fits() || length > MAX_MESSAGE_BYTES {
        return Err(HwError::Setting {
            name: "EITS-1 payload",
            value: format!("{} bytes for count {}", message.payload.len(), message.count),
            wanted: "4 bytes a value and 1 a flag, at most 16 384 with header and CRC",
        });
    }
    let mut bytes = Vec::with_capacity(length);
    bytes.extend([VERSION, message.kind as u8, 0, 0]);
    bytes.extend(message.sequence.to_le_bytes());
    bytes.extend(message.device_time_us.to_le_bytes());
    bytes.extend(message.flags.to_le_bytes());
    bytes.extend(message.count.to_le_bytes());
    bytes.extend(message.payload);
    bytes.extend(CRC.checksum(&bytes).to_le_bytes());
    cobs::encode(&bytes, wire);
    wire.push(0);
    Ok(())
}

/// What a decoder found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// A whole message with the right CRC.
    Message(Message<'a>),
    /// Bytes up to a 0 that are no message; a 0 after a 0 is none of these.
    Damaged {
        /// How many, without the 0.
        bytes: usize,
        /// Why.
        damage: Damage,
    },
}

/// Why bytes are no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// The bytes are no COBS.
    Cobs,
    /// Shorter than header and CRC, or longer than [`MAX_MESSAGE_BYTES`].
    Length,
    /// The CRC differs.
    Crc,
    /// The CRC is right, but version, kind, flags and count do not fit: another version.
    Meaning,
}

/// Decodes EITS-1.
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
    /// Bytes since the last 0, also those beyond the buffer.
    received: usize,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder, in step from the first byte.
    pub fn new() -> Self {
        Self { buffer: Vec::with_capacity(cobs::longest(MAX_MESSAGE_BYTES)), received: 0 }
    }

    /// Forgets the bytes of an open message.
    pub fn reset(&mut self) {
        self.buffer.clear();
        self.received = 0;
    }

    /// Takes bytes as they arrive and calls `on_event` with what they complete.
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
        if CRC.checksum(body) != u32::from_le_bytes(*crc) {
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
