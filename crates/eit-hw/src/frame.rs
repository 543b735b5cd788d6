//! One frame of measurements and the quality of each of them.

use std::fmt;
use std::ops::{BitOr, BitOrAssign};

/// Electrodes `[a, b, m, n]` of one measurement, 0-based: current enters the skin at `a` and leaves
/// it at `b`; value = potential at `m` minus potential at `n`.
pub type Quadruple = [u32; 4];

/// The quadruple with `a < b` and `m < n`, and the sign that this gives its value.
pub(crate) fn unsigned([a, b, m, n]: Quadruple) -> (Quadruple, f64) {
    let sign = if (a > b) == (m > n) { 1.0 } else { -1.0 };
    ([a.min(b), a.max(b), m.min(n), m.max(n)], sign)
}

/// One full set of measurements, in the order of the scene's protocol.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Value of each measurement; its unit is that of the recording or instrument it came from.
    pub values: Vec<f64>,
    /// Imaginary part of each measurement, as long as `values`, which are the real parts then;
    /// `None` where the instrument measures real values.
    pub imaginary: Option<Vec<f64>>,
    /// Quality of each measurement, as long as `values`.
    pub quality: Vec<Quality>,
    /// Number of the frame since the start of the recording or stream, from 0; holes are frames
    /// that were lost.
    pub sequence: u64,
    /// Number of the connection, from 0: it rises when an instrument was lost and found again, and
    /// a reference frame of another epoch no longer holds.
    pub epoch: u32,
    /// Seconds of the instrument's own clock since its first frame. Regular, but its origin and
    /// drift are its own: two instruments are aligned by `host_time_s`.
    pub device_time_s: Option<f64>,
    /// Seconds since the Unix epoch (1970-01-01 00:00 UTC) by this computer's clock when the last
    /// byte of the frame had arrived. The origin is the same for all instruments; an f64 resolves
    /// 0.24 us there.
    pub host_time_s: Option<f64>,
}

/// Flags that say what is wrong with one measurement; none set means good.
///
/// ```
/// use eit_hw::Quality;
/// let quality = Quality::SATURATED | Quality::OPEN;
/// assert!(quality.contains(Quality::OPEN) && !quality.is_good());
/// assert_eq!(quality.to_string(), "saturated, open");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Quality(u16);

impl Quality {
    /// Nothing wrong.
    pub const GOOD: Self = Self(0);
    /// The converter or amplifier was at its limit.
    pub const SATURATED: Self = Self(1);
    /// The value does not change although others do.
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

    /// Whether no flag is set.
    pub const fn is_good(self) -> bool {
        self.0 == 0
    }

    /// Whether every flag of `other` is set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The flags as bits: saturated 1, stuck 2, open 4, over range 8, non-finite 16, missing 32.
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// The flags of these [`bits`](Self::bits); `None` where one of them has no meaning.
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
