//! Data frames of Sciospec instruments.

/// Number of channels in a data frame.
pub const GROUP: usize = 16;
/// Plausibility limit in volts; the largest range of an instrument is 10 V.
const LARGEST_V: f32 = 20.0;
/// Optional contents of data frames, beside the voltages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Output {
    /// Whether frames name the driven pair.
    pub drive: bool,
    /// Whether frames have the number of the frequency.
    pub frequency_row: bool,
    /// Whether frames have the device clock.
    pub time: bool,
}

impl Default for Output {
    /// All contents.
    fn default() -> Self {
        Self { drive: true, frequency_row: true, time: true }
    }
}

impl Output {
    /// Returns the payload length of a data frame.
    pub(super) const fn payload_bytes(self) -> usize {
        1 + 2 * self.drive as usize
            + 2 * self.frequency_row as usize
            + 4 * self.time as usize
            + 8 * GROUP
    }
}

/// Potentials of 16 channels against the instrument's ground, for one driven pair.
///
/// Accepted only if plausible: the group is 1 to 8, the driven pair two different electrodes from 1
/// to 128, and every voltage finite and within 20 V (the largest range is 10 V).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DataFrame {
    /// Group of channels, from 1; its first channel, counted from 0, is `16 (group - 1)`.
    pub group: u8,
    /// Driven pair as the device names it, electrodes from 1.
    pub drive: Option<[u8; 2]>,
    /// Number of the frequency, from 1; some models send 0.
    pub frequency_row: Option<u16>,
    /// Device clock in milliseconds; wraps after 49.7 days.
    pub time_ms: Option<u32>,
    /// Real and imaginary part of each channel's potential in volts.
    pub potentials_v: [[f32; 2]; GROUP],
}

impl DataFrame {
    pub(super) fn of(payload: &[u8], output: Output) -> Option<Self> {
        let (&group, mut rest) = payload.split_first()?;
        let mut drive = None;
        if output.drive {
            let (&pair, after) = rest.split_first_chunk::<2>()?;
            (drive, rest) = (Some(pair), after);
        }
        let mut frequency_row = None;
        if output.frequency_row {
            let (&row, after) = rest.split_first_chunk::<2>()?;
            (frequency_row, rest) = (Some(u16::from_be_bytes(row)), after);
        }
        let mut time_ms = None;
        if output.time {
            let (&time, after) = rest.split_first_chunk::<4>()?;
            (time_ms, rest) = (Some(u32::from_be_bytes(time)), after);
        }
        let (floats, _) = rest.as_chunks::<4>();
        let (parts, _) = floats.as_chunks::<2>();
        let mut potentials_v = [[0.0; 2]; GROUP];
        if parts.len() != GROUP {
            return None;
        }
        for (potential, part) in potentials_v.iter_mut().zip(parts) {
            *potential = part.map(f32::from_be_bytes);
        }
        let frame = Self { group, drive, frequency_row, time_ms, potentials_v };
        frame.makes_sense().then_some(frame)
    }

    fn makes_sense(&self) -> bool {
        let drive = self
            .drive
            .is_none_or(|[a, b]| a != b && (1..=128).contains(&a) && (1..=128).contains(&b));
        // a NaN is in no range
        let voltage = |v: &f32| (-LARGEST_V..=LARGEST_V).contains(v);
        (1..=8).contains(&self.group)
            && drive
            && self.potentials_v.as_flattened().iter().all(voltage)
    }
}
