//! Payloads of the EITS-1 messages that identify and configure a device.

use crate::error::HwError;
use crate::frame::Quadruple;
use crate::recording::Unit;

/// A device's description of itself: the payload of
/// [`Kind::Information`](super::Kind::Information).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Information {
    /// Number of electrodes.
    pub electrodes: u16,
    /// Maximum number of measurements per frame.
    pub max_measurements: u16,
    /// Highest frame rate of the device's default configuration, hertz.
    pub max_frame_rate_hz: f32,
    /// Magnitude of the largest value, in its unit; infinite if unspecified.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::infinite_f32"))]
    pub full_scale: f32,
    /// Unit of calibrated values.
    pub unit: Unit,
    /// Whether values are complex.
    pub complex: bool,
    /// Name of the type of device, at most 255 bytes.
    pub name: String,
    /// Serial number or other identifier of this unit, at most 255 bytes.
    pub serial: String,
}

impl Information {
    const FIXED_BYTES: usize = 16;

    /// Encodes the payload. Texts are truncated to 255 bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let (name, serial) = (cut(&self.name), cut(&self.serial));
        let unit = match self.unit {
            Unit::Arbitrary => 0,
            Unit::Volt => 1,
            Unit::Ohm => 2,
        };
        let mut bytes = Vec::with_capacity(Self::FIXED_BYTES + name.len() + serial.len());
        bytes.extend(self.electrodes.to_le_bytes());
        bytes.extend(self.max_measurements.to_le_bytes());
        bytes.extend(self.max_frame_rate_hz.to_le_bytes());
        bytes.extend(self.full_scale.to_le_bytes());
        bytes.extend([unit, u8::from(self.complex), name.len() as u8, serial.len() as u8]);
        bytes.extend(name.as_bytes());
        bytes.extend(serial.as_bytes());
        bytes
    }

    /// Decodes a payload; returns `None` if it is invalid.
    pub fn from_bytes(payload: &[u8]) -> Option<Self> {
        let (fixed, texts) = payload.split_first_chunk::<{ Self::FIXED_BYTES }>()?;
        let [e0, e1, m0, m1, r0, r1, r2, r3, s0, s1, s2, s3, unit, complex, name, serial] = *fixed;
        let (name, serial_text) = texts.split_at_checked(usize::from(name))?;
        if serial_text.len() != usize::from(serial) {
            return None;
        }
        let text = |bytes: &[u8]| std::str::from_utf8(bytes).ok().map(str::to_owned);
        Some(Self {
            electrodes: u16::from_le_bytes([e0, e1]),
            max_measurements: u16::from_le_bytes([m0, m1]),
            max_frame_rate_hz: f32::from_le_bytes([r0, r1, r2, r3]),
            full_scale: f32::from_le_bytes([s0, s1, s2, s3]),
            unit: match unit {
                0 => Unit::Arbitrary,
                1 => Unit::Volt,
                2 => Unit::Ohm,
                _ => return None,
            },
            complex: match complex {
                0 => false,
                1 => true,
                _ => return None,
            },
            name: text(name)?,
            serial: text(serial_text)?,
        })
    }
}

/// Truncates a text to at most 255 bytes of whole characters.
fn cut(text: &str) -> &str {
    let mut end = text.len().min(255);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    &text[..end]
}

/// What a device measures: the payload of [`Kind::Configuration`](super::Kind::Configuration).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Configuration {
    /// Frames per second.
    pub frame_rate_hz: f32,
    /// Amplitude of the drive current in ampere.
    pub current_a: f32,
    /// Frequency of the drive current in hertz; 0 for direct current.
    pub frequency_hz: f32,
    /// Electrodes `[a, b, m, n]` of each measurement, in the order of a frame.
    pub quadruples: Vec<[u8; 4]>,
}

impl Configuration {
    const FIXED_BYTES: usize = 14;

    /// Creates a configuration that measures these quadruples.
    ///
    /// # Errors
    /// [`HwError::Setting`] if there are no quadruples or more than 4 000, or an electrode is above
    /// 255.
    pub fn new(
        quadruples: &[Quadruple],
        frame_rate_hz: f32,
        current_a: f32,
        frequency_hz: f32,
    ) -> Result<Self, HwError> {
        /// Maximum number of quadruples that fits a message.
        const MOST: usize = 4000;
        if quadruples.is_empty() || quadruples.len() > MOST {
            return Err(HwError::setting(
                "quadruples of the protocol",
                quadruples.len(),
                "1 to 4000 for EITS-1",
            ));
        }
        let byte = |electrode: u32| {
            u8::try_from(electrode).map_err(|_| {
                HwError::setting("electrode (from 0)", electrode, "at most 255 for EITS-1")
            })
        };
        let quadruples = quadruples
            .iter()
            .map(|&[a, b, m, n]| Ok([byte(a)?, byte(b)?, byte(m)?, byte(n)?]))
            .collect::<Result<_, HwError>>()?;
        Ok(Self { frame_rate_hz, current_a, frequency_hz, quadruples })
    }

    /// Encodes the payload; quadruples beyond 65 535 are dropped.
    pub fn to_bytes(&self) -> Vec<u8> {
        let count = u16::try_from(self.quadruples.len()).unwrap_or(u16::MAX);
        let mut bytes = Vec::with_capacity(Self::FIXED_BYTES + 4 * usize::from(count));
        for value in [self.frame_rate_hz, self.current_a, self.frequency_hz] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(count.to_le_bytes());
        bytes.extend(self.quadruples.iter().take(usize::from(count)).flatten());
        bytes
    }

    /// Decodes a payload; returns `None` if it is invalid.
    pub fn from_bytes(payload: &[u8]) -> Option<Self> {
        let (fixed, rest) = payload.split_first_chunk::<{ Self::FIXED_BYTES }>()?;
        let (floats, count) = fixed.split_last_chunk::<2>()?;
        let (floats, _) = floats.as_chunks::<4>();
        let &[rate, current, frequency] = floats else { return None };
        let (quadruples, left) = rest.as_chunks::<4>();
        let whole = left.is_empty() && quadruples.len() == usize::from(u16::from_le_bytes(*count));
        whole.then(|| Self {
            frame_rate_hz: f32::from_le_bytes(rate),
            current_a: f32::from_le_bytes(current),
            frequency_hz: f32::from_le_bytes(frequency),
            quadruples: quadruples.to_vec(),
        })
    }
}
