//! Settings of a Sciospec instrument.

use crate::error::HwError;
use crate::frame::Quadruple;

/// Gain of the voltmeters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Gain {
    /// No amplification.
    #[default]
    X1,
    /// Tenfold amplification.
    X10,
    /// Hundredfold amplification.
    X100,
    /// Thousandfold amplification.
    X1000,
}

impl Gain {
    /// Returns the amplification factor.
    pub const fn factor(self) -> f64 {
        match self {
            Self::X1 => 1.0,
            Self::X10 => 10.0,
            Self::X100 => 100.0,
            Self::X1000 => 1000.0,
        }
    }
}

/// Range of the converters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Range {
    /// ±1 V.
    #[default]
    V1,
    /// ±5 V.
    V5,
    /// ±10 V.
    V10,
}

impl Range {
    /// Returns the limit of the range in volts.
    pub const fn volts(self) -> f64 {
        match self {
            Self::V1 => 1.0,
            Self::V5 => 5.0,
            Self::V10 => 10.0,
        }
    }
}

/// Width of electrode numbers in the command that adds a drive; depends on the firmware.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum PairWidth {
    /// 8 bits, as sciopy and eit_app send them.
    #[default]
    Byte,
    /// 16 bits, as PrinceDinali's interface to an EIT32 sends them.
    Word,
}

/// Electrode of a listed pair at which current enters the skin. Public sources disagree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Polarity {
    /// Determined from the first frame of each stream: of the two driven electrodes, current enters
    /// at the one whose potential has the higher real part.
    #[default]
    Measured,
    /// The first electrode.
    AsListed,
    /// The second electrode: values change sign.
    Reversed,
}

/// Settings of a Sciospec instrument, in single-ended mode.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SciospecSettings {
    /// Number of electrodes in use, 2 to 128: channels 1 to this number.
    pub electrodes: u32,
    /// Driven pairs `[a, b]`, electrodes from 0.
    pub drives: Vec<[u32; 2]>,
    /// Amplitude of the current in ampere, 100 nA to 10 mA.
    pub current_a: f64,
    /// Frequency of the current in hertz, 100 Hz to 1 MHz.
    pub frequency_hz: f32,
    /// Frames per second, 0.1 to 100; the achievable maximum depends on drives and frequency.
    pub frame_rate_hz: f32,
    /// Gain of the voltmeters.
    pub gain: Gain,
    /// Range of the converters.
    pub range: Range,
    /// Width of electrode numbers in commands.
    pub pair_width: PairWidth,
    /// Sign of the current.
    pub polarity: Polarity,
}

impl SciospecSettings {
    /// Creates settings that measure these quadruples: each driven pair once, in order of first
    /// use.
    pub fn for_quadruples(electrodes: u32, quadruples: &[Quadruple]) -> Self {
        let mut drives: Vec<[u32; 2]> = Vec::new();
        for &[a, b, ..] in quadruples {
            if !drives.contains(&[a, b]) && !drives.contains(&[b, a]) {
                drives.push([a, b]);
            }
        }
        Self {
            electrodes,
            drives,
            current_a: 1e-3,
            frequency_hz: 1e4,
            frame_rate_hz: 10.0,
            gain: Gain::default(),
            range: Range::default(),
            pair_width: PairWidth::default(),
            polarity: Polarity::default(),
        }
    }

    /// Checks the settings.
    ///
    /// # Errors
    /// [`HwError::Setting`] names the first invalid one.
    pub fn validate(&self) -> Result<(), HwError> {
        let is_count = (2..=128).contains(&self.electrodes);
        HwError::require(is_count, "electrodes", self.electrodes, "2 to 128")?;
        let count = self.drives.len();
        HwError::require((1..=16_384).contains(&count), "number of drives", count, "1 to 16384")?;
        for (index, &[a, b]) in self.drives.iter().enumerate() {
            let drive = || format!("({a}, {b})");
            let is_pair = a != b && a.max(b) < self.electrodes;
            let wanted = "two different electrodes (from 0) below `electrodes`";
            HwError::require(is_pair, "drive", drive(), wanted)?;
            let before = &self.drives[..index];
            let is_new = !before.contains(&[a, b]) && !before.contains(&[b, a]);
            HwError::require(is_new, "drive", drive(), "each pair once, in one direction")?;
        }
        let (current_a, frequency_hz) = (self.current_a, self.frequency_hz);
        let is_valid = (1e-7..=1e-2).contains(&current_a);
        HwError::require(is_valid, "current_a", current_a, "1e-7 to 1e-2")?;
        let is_valid = (1e2..=1e6).contains(&frequency_hz);
        HwError::require(is_valid, "frequency_hz", frequency_hz, "100 to 1e6")?;
        let is_valid = (0.1..=100.0).contains(&self.frame_rate_hz);
        HwError::require(is_valid, "frame_rate_hz", self.frame_rate_hz, "0.1 to 100")
    }

    /// Returns the payloads of the set-up commands and what each does, in order.
    pub(super) fn commands(&self) -> Vec<(Vec<u8>, &'static str)> {
        let frequency = self.frequency_hz.to_be_bytes();
        let join = |parts: &[&[u8]]| parts.concat();
        let mut commands = vec![
            (vec![0x01], "reset its set-up"),
            (vec![0x02, 0, 0], "send frames continuously"),
            (join(&[&[0x05], &self.current_a.to_be_bytes()]), "use the current `current_a`"),
            (vec![0x0D, 1 + self.range as u8], "use the range"),
            (vec![0x09, 1, self.gain as u8], "use the gain"),
            (vec![0x08, 1, 1], "measure single-ended"),
            (vec![0x0C, 1], "use its relays"),
            (join(&[&[0x03], &self.frame_rate_hz.to_be_bytes()]), "use `frame_rate_hz`"),
            (join(&[&[0x04], &frequency, &frequency, &[0, 1, 0]]), "use `frequency_hz`"),
        ];
        for drive in &self.drives {
            // numbered from 1 on the wire; validated to be at most 128
            let [a, b] = drive.map(|electrode| (electrode + 1) as u8);
            let payload = match self.pair_width {
                PairWidth::Byte => vec![0x06, a, b],
                PairWidth::Word => vec![0x06, 0, a, 0, b],
            };
            commands.push((payload, "add a drive"));
        }
        commands
    }
}
