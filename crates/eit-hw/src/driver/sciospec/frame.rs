//! Assembles data frames of 16 channels into frames of the protocol.

use super::settings::{Polarity, SciospecSettings};
use crate::codec::sciospec::{DataFrame, GROUP};
use crate::driver::decoded::{Decoded, RawFrame};
use crate::frame::Quality;

/// Minimum fraction of driven pairs that must agree on the polarity.
const CLEAR_SHARE: f64 = 0.9;

/// A frame being received. Data are placed by driven pair and channel group, never by order of
/// arrival; groups beyond the electrodes in use are ignored.
#[derive(Clone, Debug, Default)]
pub(super) struct Assembly {
    drives: Vec<[u32; 2]>,
    electrodes: usize,
    groups: usize,
    polarity: Polarity,
    /// Sign of the values; `None` until determined.
    sign: Option<f64>,
    values: Vec<f64>,
    imaginary: Vec<f64>,
    quality: Vec<Quality>,
    filled: Vec<bool>,
    filled_count: usize,
    /// Index of the last data frame: driven pair times groups, plus group.
    last_cell: usize,
    time: Option<f64>,
    /// Last reading of the device clock, and number of wraps.
    clock: (u32, u64),
}

impl Assembly {
    pub(super) fn new(settings: &SciospecSettings) -> Self {
        let electrodes = settings.electrodes as usize;
        let (groups, count) = (groups(settings.electrodes), settings.drives.len() * electrodes);
        let mut assembly = Self {
            drives: settings.drives.clone(),
            electrodes,
            groups,
            polarity: settings.polarity,
            values: vec![0.0; count],
            imaginary: vec![0.0; count],
            quality: vec![Quality::GOOD; count],
            filled: vec![false; settings.drives.len() * groups],
            ..Self::default()
        };
        assembly.reset();
        assembly
    }

    /// Prepares for a new stream.
    pub(super) fn reset(&mut self) {
        self.sign = match self.polarity {
            Polarity::Measured => None,
            Polarity::AsListed => Some(1.0),
            Polarity::Reversed => Some(-1.0),
        };
        self.clock = (0, 0);
        self.clear();
    }

    fn clear(&mut self) {
        self.values.fill(f64::NAN);
        self.imaginary.fill(f64::NAN);
        self.quality.fill(Quality::MISSING);
        self.filled.fill(false);
        self.filled_count = 0;
        self.last_cell = 0;
        self.time = None;
    }

    /// Adds one data frame.
    pub(super) fn take(&mut self, data: &DataFrame, on_decoded: &mut dyn FnMut(Decoded<'_>)) {
        let Some([a, b]) = data.drive.map(|drive| drive.map(|electrode| u32::from(electrode) - 1))
        else {
            return;
        };
        // some firmware may swap the electrodes of a pair
        let same = |pair: &[u32; 2]| *pair == [a, b] || *pair == [b, a];
        let Some(drive) = self.drives.iter().position(same) else {
            return on_decoded(Decoded::Damaged { bytes: 1 });
        };
        // only one frequency is set; some models number it 0
        if data.frequency_row.is_some_and(|row| row > 1) {
            return on_decoded(Decoded::Damaged { bytes: 1 });
        }
        let group = usize::from(data.group) - 1;
        if group >= self.groups {
            return;
        }
        let cell = drive * self.groups + group;
        if self.filled_count > 0 && (self.filled[cell] || cell < self.last_cell) {
            self.finish(on_decoded);
        }
        self.last_cell = cell;
        self.filled[cell] = true;
        self.filled_count += 1;
        let time = data.time_ms.map(|time| self.unwrapped(time));
        self.time = self.time.or(time);
        let first = drive * self.electrodes + group * GROUP;
        let wanted = (self.electrodes - group * GROUP).min(GROUP);
        for (offset, [real, imaginary]) in data.potentials_v.iter().take(wanted).enumerate() {
            self.values[first + offset] = f64::from(*real);
            self.imaginary[first + offset] = f64::from(*imaginary);
            self.quality[first + offset] = Quality::GOOD;
        }
        if self.filled_count == self.filled.len() {
            self.finish(on_decoded);
        }
    }

    /// Returns the device clock in seconds, unwrapped; it wraps after 49.7 days.
    fn unwrapped(&mut self, time_ms: u32) -> f64 {
        let (last, wraps) = self.clock;
        let wraps = wraps + u64::from(time_ms < last && last - time_ms > u32::MAX / 2);
        self.clock = (time_ms, wraps);
        ((wraps << 32) + u64::from(time_ms)) as f64 * 1e-3
    }

    fn finish(&mut self, on_decoded: &mut dyn FnMut(Decoded<'_>)) {
        // less than half a frame is useless
        if 2 * self.filled_count < self.filled.len() {
            on_decoded(Decoded::TruncatedFrame);
            return self.clear();
        }
        if self.sign.is_none() {
            let sign = self.measured_sign();
            self.sign = Some(sign.unwrap_or(1.0));
            on_decoded(Decoded::Notice(match sign {
                Some(1.0) => "polarity: current enters at the first electrode of a drive",
                Some(_) => "polarity: current enters at the second electrode of a drive; corrected",
                None => "polarity: unclear from this frame; used as listed",
            }));
        }
        let sign = self.sign.unwrap_or(1.0);
        for part in [&mut self.values, &mut self.imaginary] {
            part.iter_mut().for_each(|value| *value *= sign);
        }
        on_decoded(Decoded::Frame(RawFrame {
            values: &self.values,
            imaginary: &self.imaginary,
            quality: &self.quality,
            counter: None,
            device_time_s: self.time,
        }));
        self.clear();
    }

    /// Determines the sign of the drives from whether Re u(a) > Re u(b).
    fn measured_sign(&self) -> Option<f64> {
        let (mut decided, mut forward) = (0.0, 0.0);
        for (drive, &[a, b]) in self.drives.iter().enumerate() {
            let potential =
                |electrode: u32| self.values[drive * self.electrodes + electrode as usize];
            let difference = potential(a) - potential(b);
            if difference != 0.0 && difference.is_finite() {
                decided += 1.0;
                forward += f64::from(u8::from(difference > 0.0));
            }
        }
        if decided > 0.0 && forward >= CLEAR_SHARE * decided {
            Some(1.0)
        } else if decided > 0.0 && forward <= (1.0 - CLEAR_SHARE) * decided {
            Some(-1.0)
        } else {
            None
        }
    }
}

/// Returns the number of groups of 16 channels that hold the electrodes.
pub(super) fn groups(electrodes: u32) -> usize {
    (electrodes as usize).div_ceil(GROUP)
}
