//! Frames of Sciospec EIT16 to EIT128 instruments, from public sources; not verified on hardware.
//!
//! A frame is `[tag][length][payload][tag]` with up to 255 bytes of payload, big-endian, without
//! checksum or escaping. A damaged value within a data frame therefore cannot be detected, and a
//! tag byte among values may look like the start of a frame. The decoder accepts a frame only if
//! the tag can have this length and both tags agree; otherwise it drops one byte and tries again.
//! Data frames must also hold plausible values: see [`DataFrame`]. If a byte of a data frame is
//! lost, the first tag of the next frame takes the place of its last tag. Only the byte after it
//! reveals this, so a frame whose payload ends with its own tag is held until that byte arrives.
//!
//! Sources: the vendor's public examples (`Sciospec/Examples`,
//! `Sciospec/sciospec_EIT_matlab_example`), sciopy 1.0.1, imt-jku/EIT-Sciospec,
//! PrinceDinali/Sciospec-EIT32-Interface, DavidMetzIMT/eit_app.

mod code;
mod data;

pub use code::Code;
pub use data::{DataFrame, GROUP, Output};

/// First and last byte of a system message or acknowledgement.
pub const TAG_SYSTEM: u8 = 0x18;
/// Software reset.
pub(crate) const TAG_RESET: u8 = 0xA1;
/// Write the measurement set-up.
pub const TAG_SET_SETUP: u8 = 0xB0;
/// Read the measurement set-up.
pub(crate) const TAG_GET_SETUP: u8 = 0xB1;
/// Choose the contents of data frames.
pub(crate) const TAG_SET_OUTPUT: u8 = 0xB2;
/// Start, stop and data.
pub const TAG_DATA: u8 = 0xB4;
/// Device information.
pub(crate) const TAG_DEVICE: u8 = 0xD1;

/// Tag, length, payload, tag.
const LONGEST: usize = 258;

/// Appends a frame `[tag][length][payload][tag]`; the payload is truncated to 255 bytes.
pub fn encode(tag: u8, payload: &[u8], wire: &mut Vec<u8>) {
    let payload = &payload[..payload.len().min(255)];
    wire.extend([tag, payload.len() as u8]);
    wire.extend(payload);
    wire.push(tag);
}

/// Appends a data frame; parts that are `None` are omitted.
pub fn encode_data(frame: &DataFrame, wire: &mut Vec<u8>) {
    let mut payload = Vec::with_capacity(Output::default().payload_bytes());
    payload.push(frame.group);
    payload.extend(frame.drive.iter().flatten());
    payload.extend(frame.frequency_row.iter().flat_map(|row| row.to_be_bytes()));
    payload.extend(frame.time_ms.iter().flat_map(|time| time.to_be_bytes()));
    payload.extend(frame.potentials_v.as_flattened().iter().flat_map(|part| part.to_be_bytes()));
    encode(TAG_DATA, &payload, wire);
}

/// Outcome of decoding the bytes received so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// A system message.
    System(Code),
    /// A data frame with voltages.
    Data(DataFrame),
    /// Any other frame: a requested value or, on the device's side, a command.
    Other {
        /// Tag of the frame.
        tag: u8,
        /// Bytes between length and closing tag.
        payload: &'a [u8],
    },
    /// Bytes that belong to no frame. Reported before the next frame, so that the count does not
    /// depend on how the bytes were split.
    Skipped {
        /// Number of bytes.
        bytes: u64,
    },
}

/// The side whose frames are decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    /// The device, with the contents of its data frames.
    Device(Output),
    Host,
}

/// Decodes the frames sent by one side.
///
/// ```
/// use eit_hw::codec::sciospec::{Code, Decoder, Event, Output};
/// let mut codes = Vec::new();
/// let mut decoder = Decoder::new(Output::default());
/// decoder.push(&[0x00, 0x18, 0x01, 0x83], &mut |_| unreachable!("no frame is complete yet"));
/// decoder.push(&[0x18], &mut |event| match event {
///     Event::System(code) => codes.push(code),
///     Event::Skipped { bytes } => assert_eq!(bytes, 1),
///     other => panic!("{other:?}"),
/// });
/// assert_eq!(codes, [Code::Executed]);
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    side: Side,
    buffer: Vec<u8>,
    skipped: u64,
}

impl Decoder {
    /// Creates a decoder for the frames of a device whose data frames contain `output`.
    pub fn new(output: Output) -> Self {
        Self { side: Side::Device(output), buffer: Vec::with_capacity(LONGEST), skipped: 0 }
    }

    /// Creates a decoder for the commands of a host.
    pub fn of_commands() -> Self {
        Self { side: Side::Host, buffer: Vec::with_capacity(LONGEST), skipped: 0 }
    }

    /// Discards an incomplete frame.
    pub fn reset(&mut self) {
        self.buffer.clear();
        self.skipped = 0;
    }

    /// Returns whether a frame has begun and not ended.
    pub fn is_open(&self) -> bool {
        !self.buffer.is_empty()
    }

    /// Decodes bytes as they arrive and calls `on_event` for each completed frame.
    pub fn push(&mut self, bytes: &[u8], on_event: &mut impl FnMut(Event<'_>)) {
        for &byte in bytes {
            self.buffer.push(byte);
            // each pass either waits for more or takes bytes away
            while let Some(found) = candidate(self.side, &self.buffer) {
                let used = match found {
                    Some((event, used)) => {
                        if self.skipped > 0 {
                            on_event(Event::Skipped { bytes: self.skipped });
                            self.skipped = 0;
                        }
                        on_event(event);
                        used
                    }
                    None => {
                        self.skipped = self.skipped.saturating_add(1);
                        1
                    }
                };
                self.buffer.drain(..used);
            }
        }
    }
}

/// Returns the frame at the start of the buffer and its length; `Some(None)` if no frame can start
/// there, `None` if more bytes are needed to tell.
#[allow(clippy::option_option, reason = "incomplete, no frame and a frame are three cases")]
fn candidate(side: Side, buffer: &[u8]) -> Option<Option<(Event<'_>, usize)>> {
    let (&tag, after) = buffer.split_first()?;
    if !side.is_tag(tag) {
        return Some(None);
    }
    let (&length, after) = after.split_first()?;
    if !side.fits(tag, usize::from(length)) {
        return Some(None);
    }
    let payload = after.get(..usize::from(length))?;
    let &end = after.get(usize::from(length))?;
    let used = usize::from(length) + 3;
    if end != tag {
        return Some(None);
    }
    // a byte was lost: the payload holds the real end, and `end` is the start of the next frame
    if tag == TAG_DATA && payload.last() == Some(&tag) && *buffer.get(used)? == length {
        return Some(None);
    }
    let event = match (side, tag, payload) {
        (Side::Device(_), TAG_SYSTEM, &[code]) => Event::System(Code::of(code)),
        (Side::Device(output), TAG_DATA, _) => match DataFrame::of(payload, output) {
            Some(frame) => Event::Data(frame),
            None => return Some(None),
        },
        _ => Event::Other { tag, payload },
    };
    Some(Some((event, used)))
}

impl Side {
    fn is_tag(self, tag: u8) -> bool {
        let answers = matches!(tag, 0xB1 | 0xB3 | TAG_DATA | 0xB5 | 0xBE | 0xC7 | 0xC9 | 0xCC)
            || matches!(tag, TAG_DEVICE | 0xD2);
        match self {
            Side::Device(_) => answers || tag == TAG_SYSTEM,
            // a device also answers unknown commands
            Side::Host => true,
        }
    }

    fn fits(self, tag: u8, length: usize) -> bool {
        match (self, tag) {
            (Side::Device(_), TAG_SYSTEM) => length == 1,
            (Side::Device(output), TAG_DATA) => length == output.payload_bytes(),
            (Side::Device(_), _) => length > 0,
            (Side::Host, _) => true,
        }
    }
}
