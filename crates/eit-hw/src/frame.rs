//! One frame of measurements, and the quality of each.

use std::fmt;
use std::ops::{BitOr, BitOrAssign};
use std::path::Path;

use crate::error::{HwError, Place};

/// Electrodes `[a, b, m, n]` of one measurement, 0-based: current enters the skin at `a` and leaves
/// it at `b`; the value is the potential at `m` minus the potential at `n`.
pub type Quadruple = [u32; 4];

/// Returns the quadruple with `a < b` and `m < n`, and the resulting sign of its value.
pub(crate) fn unsigned([a, b, m, n]: Quadruple) -> (Quadruple, f64) {
    let sign = if (a > b) == (m > n) { 1.0 } else { -1.0 };
    ([a.min(b), a.max(b), m.min(n), m.max(n)], sign)
}

/// Checks that lists which belong together have the wanted lengths; each is a name, the length found
/// and the length wanted. `source` is used in messages only.
pub(crate) fn check_lengths(
    source: &Path,
    fields: impl IntoIterator<Item = (&'static str, usize, usize)>,
) -> Result<(), HwError> {
    match fields.into_iter().find(|(_, found, wanted)| found != wanted) {
        None => Ok(()),
        Some((field, found, wanted)) => {
            Err(HwError::Inconsistent { place: Place::file(source), field, found, wanted })
        }
    }
}

/// One complete set of measurements, in the order of the scene's protocol.
///
/// ```
/// use eit_hw::{Frame, Quality};
///
/// let mut frame = Frame::new(0, vec![1.2e-3, 0.0, f64::NAN]);
/// frame.quality[1] = Quality::OPEN;
/// assert_eq!(frame.quality, [Quality::GOOD, Quality::OPEN, Quality::MISSING]);
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Frame {
    /// Value of each measurement, in the unit of the recording or instrument.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::nan_list"))]
    pub values: Vec<f64>,
    /// Imaginary part of each measurement, of the same length as `values`, which then holds the
    /// real parts; `None` for real measurements.
    pub imaginary: Option<Vec<f64>>,
    /// Quality of each measurement, of the same length as `values`.
    pub quality: Vec<Quality>,
    /// Number of the frame since the start of the recording or stream, from 0; gaps are lost
    /// frames.
    pub sequence: u64,
    /// Number of the connection, from 0. It increases when a lost instrument is found again; a
    /// reference frame of another epoch is no longer valid.
    pub epoch: u32,
    /// Seconds by the instrument's clock since its first frame. Regular, but with an origin and
    /// drift of its own; use `host_time_s` to align two instruments.
    pub device_time_s: Option<f64>,
    /// Seconds since the Unix epoch (1970-01-01 00:00 UTC) by this computer's clock when the last
    /// byte of the frame had arrived. The origin is common to all instruments; the f64 resolution
    /// is 0.24 us there.
    pub host_time_s: Option<f64>,
}

impl Frame {
    /// Checks that all lists have as many entries as there are values, and as wanted if that is known.
    #[cfg(feature = "mcap")]
    pub(crate) fn check(&self, wanted: Option<usize>, source: &Path) -> Result<(), HwError> {
        let wanted = wanted.unwrap_or(self.values.len());
        let fields = [
            ("values", self.values.len(), wanted),
            ("imaginary", self.imaginary.as_ref().map_or(wanted, Vec::len), wanted),
            ("quality", self.quality.len(), wanted),
        ];
        check_lengths(source, fields)
    }

    /// Creates a real frame of the first connection, without times. A value that is not finite is
    /// [missing](Quality::MISSING), any other good.
    pub fn new(sequence: u64, values: Vec<f64>) -> Self {
        let quality =
            |value: &f64| if value.is_finite() { Quality::GOOD } else { Quality::MISSING };
        Self {
            quality: values.iter().map(quality).collect(),
            values,
            imaginary: None,
            sequence,
            epoch: 0,
            device_time_s: None,
            host_time_s: None,
        }
    }
}

/// Flags that describe what is wrong with one measurement; no flag means good.
///
/// ```
/// use eit_hw::Quality;
/// let quality = Quality::SATURATED | Quality::OPEN;
/// assert!(quality.contains(Quality::OPEN) && !quality.is_good());
/// assert_eq!(quality.to_string(), "saturated, open");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "u16", into = "u16")
)]
pub struct Quality(u16);

impl Quality {
    /// No flag set.
    pub const GOOD: Self = Self(0);
    /// The converter or amplifier reached its limit.
    pub const SATURATED: Self = Self(1);
    /// The value stays constant while others change.
    pub const STUCK: Self = Self(1 << 1);
    /// An electrode of the measurement is not connected.
    pub const OPEN: Self = Self(1 << 2);
    /// The value is larger than the instrument can measure.
    pub const OVER_RANGE: Self = Self(1 << 3);
    /// The value is NaN or infinite.
    pub const NON_FINITE: Self = Self(1 << 4);
    /// The value was not received.
    pub const MISSING: Self = Self(1 << 5);

    const NAMES: [(Self, &str); 6] = [
        (Self::SATURATED, "saturated"),
        (Self::STUCK, "stuck"),
        (Self::OPEN, "open"),
        (Self::OVER_RANGE, "over range"),
        (Self::NON_FINITE, "non-finite"),
        (Self::MISSING, "missing"),
    ];

    /// Returns whether no flag is set.
    pub const fn is_good(self) -> bool {
        self.0 == 0
    }

    /// Returns whether every flag of `other` is set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns the flags as bits: saturated 1, stuck 2, open 4, over range 8, non-finite 16,
    /// missing 32.
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// Returns the flags of these [`bits`](Self::bits), or `None` if one is unknown.
    ///
    /// ```
    /// use eit_hw::Quality;
    /// assert_eq!(Quality::from_bits(5), Some(Quality::SATURATED | Quality::OPEN));
    /// assert_eq!(Quality::from_bits(1 << 15), None);
    /// ```
    pub const fn from_bits(bits: u16) -> Option<Self> {
        let mut known = 0;
        let mut index = 0;
        while index < Self::NAMES.len() {
            known |= Self::NAMES[index].0.0;
            index += 1;
        }
        if bits & !known == 0 { Some(Self(bits)) } else { None }
    }
}

/// The flags' [`bits`](Quality::bits).
impl From<Quality> for u16 {
    fn from(quality: Quality) -> Self {
        quality.0
    }
}

/// Fails with the bits if one of them is not a flag, like [`Quality::from_bits`].
impl TryFrom<u16> for Quality {
    type Error = UnknownFlags;

    fn try_from(bits: u16) -> Result<Self, UnknownFlags> {
        Self::from_bits(bits).ok_or(UnknownFlags { bits })
    }
}

/// Bits that are not all flags of [`Quality`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the bits {bits:#b} contain a flag of quality that does not exist")]
#[non_exhaustive]
pub struct UnknownFlags {
    /// Bits, of which some are no flags.
    pub bits: u16,
}

/// All flags of several measurements together.
///
/// ```
/// use eit_hw::Quality;
/// let all: Quality = [Quality::OPEN, Quality::GOOD, Quality::STUCK].into_iter().collect();
/// assert_eq!(all, Quality::OPEN | Quality::STUCK);
/// assert_eq!(all.bits(), 0b110);
/// ```
impl FromIterator<Quality> for Quality {
    fn from_iter<I: IntoIterator<Item = Self>>(flags: I) -> Self {
        flags.into_iter().fold(Self::GOOD, |all, flag| all | flag)
    }
}

impl BitOr for Quality {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Quality {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_good() {
            return f.write_str("good");
        }
        let mut separator = "";
        for (flag, name) in Self::NAMES {
            if self.contains(flag) {
                write!(f, "{separator}{name}")?;
                separator = ", ";
            }
        }
        Ok(())
    }
}
