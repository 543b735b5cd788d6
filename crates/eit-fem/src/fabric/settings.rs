//! Parameters of the fabric, each with its default and its source, or marked as assumed.
//!
//! `docs/FABRIC.md` discusses them. An effect whose amplitude is zero is not computed, and the
//! other effects do not change.

mod check;

/// Settings of the simulated fabric and its instrument.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct FabricSettings {
    /// Mechanics of the stretched fabric.
    pub membrane: Membrane,
    /// Shape and movement of the prints of resting fingers.
    pub print: Print,
    /// Conductivity under pressure and strain.
    pub piezo: Piezoresistance,
    /// Compliance of the rim and response of the contacts.
    pub rim: Rim,
    /// Unevenness and direction of the conductivity.
    pub weave: Weave,
    /// Slow drift of the conductivity and the contact impedances.
    pub drift: Drift,
    /// Noise, gain errors, converter and bad contacts.
    pub instrument: Instrument,
    /// Response of a linear skin, which replaces `membrane`, `print`, `piezo` and `rim`: no node
    /// moves, contacts do not change with touches, and no force is too large. `None`: the full model
    /// of the fabric.
    pub linear: Option<LinearResponse>,
}

/// Mechanics: a stretched membrane on a soft layer.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Membrane {
    /// Tension, newton per metre, above zero. Default 50, assumed: a knit stretched over a frame,
    /// into which a fingertip sinks by a centimetre at 1.5 N.
    pub tension_n_per_m: f64,
    /// Stiffness of the foundation: pressure per deflection, pascal per metre, above zero. Default
    /// 5e4, assumed: almost nothing beneath the fabric. With 50 N/m a dent extends over 30 mm. Soft
    /// foam has 1e6.
    pub foundation_pa_per_m: f64,
    /// Poisson's ratio of the fabric, from 0 to below 1. Default 0.3, assumed.
    pub poisson_ratio: f64,
    /// In-plane stiffness of the fabric, newton per metre, above zero. Default 300, assumed for a
    /// knit.
    pub stiffness_n_per_m: f64,
    /// Friction coefficient of a moving finger, which drags the fabric along. Default 0.4, assumed.
    /// Zero: no friction.
    pub friction: f64,
    /// Whether dents move the mesh nodes. If false, all solves use the mesh at rest.
    pub moves_nodes: bool,
}

impl Default for Membrane {
    fn default() -> Self {
        Self {
            tension_n_per_m: 50.0,
            foundation_pa_per_m: 5e4,
            poisson_ratio: 0.3,
            stiffness_n_per_m: 300.0,
            friction: 0.4,
            moves_nodes: true,
        }
    }
}

impl Membrane {
    /// Length over which a dent decays, `sqrt(tension / foundation)`, metres.
    pub(super) fn length_m(&self) -> f64 {
        (self.tension_n_per_m / self.foundation_pa_per_m).sqrt()
    }
}

/// Prints of fingers: elliptic, and rolling while they rest. Each finger has a direction and a phase of its own,
/// drawn from the seed.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Print {
    /// Long over short axis of the print of a firm touch, at least 1; its area is that of the round print. Default
    /// 1: round; 1.2 to 1.8 assumed for a finger that is not upright.
    pub ratio: f64,
    /// Force at which the print has `1 - 1/e` of that elongation, newton. Default 0: at any force; 0.5 to 2 assumed.
    pub squash_n: f64,
    /// Amplitude with which a print rolls to and fro across its long axis, metres. Default 0; 0.5e-3 to 2e-3 assumed.
    pub roll_m: f64,
    /// Amplitude with which its long axis turns, degrees. Default 0; 5 to 20 assumed.
    pub roll_deg: f64,
    /// Period of rolling and turning, seconds, above zero. Default 3, assumed.
    pub roll_s: f64,
}

impl Default for Print {
    fn default() -> Self {
        Self { ratio: 1.0, squash_n: 0.0, roll_m: 0.0, roll_deg: 0.0, roll_s: 3.0 }
    }
}

/// Dependence of the conductivity on pressure and strain, with hysteresis and relaxation.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Piezoresistance {
    /// Change of ln(conductivity) at very high pressure. Default 0.3, assumed. Zero: no effect.
    pub pressure_gain: f64,
    /// Pressure at which half of that change is reached, pascal, above zero. Default 1e4, assumed.
    pub half_pressure_pa: f64,
    /// Change of ln(conductivity) per areal strain. Positive if stretching brings yarns together;
    /// zero: no effect. Published gauge factors of knitted sensors have magnitudes of 0 to 2.4 and
    /// either sign (Bozali et al., Sensors 22:7688, 2022: 0 to 1.19; Tangsirinaruenart and Stylios,
    /// Materials 12:1469, 2019: 1.61). Default 1.2; the sign is assumed.
    pub strain_gain: f64,
    /// Share of the response with hysteresis (play operators), 0 to below 1. Zero: no hysteresis.
    /// Default 0.1; published hysteresis of knitted sensors ranges from 3 % (Bozali et al.) to 12.5
    /// % (see `docs/FABRIC.md`).
    pub hysteresis: f64,
    /// Thresholds of the play operators, in ln(conductivity), above zero. Defaults are assumed.
    pub thresholds: Vec<f64>,
    /// Shares of the response that relax after a step, from -1 to 1, whose magnitudes sum to below 1. Default
    /// 0.08 and 0.07, assumed: fabrics overshoot and settle (Bozali et al. and others). Negative: the
    /// response creeps up, and that share of it is left after a lift, as on foams and films.
    pub relaxing: Vec<f64>,
    /// Time constants of the relaxing shares, seconds, above zero. Default 0.5 and 10, assumed.
    pub relaxation_s: Vec<f64>,
    /// Strength of a ring of the other sign around a touch, as a share of the touch's own, from -1 to 1. Default
    /// 0; 0.35 to 0.7 assumed where fabric is drawn in from around a finger.
    pub ring: f64,
    /// Radius at which the ring is strongest, metres, above zero. Default 0.02, assumed.
    pub ring_radius_m: f64,
    /// Largest magnitude that the whole change of ln(conductivity) approaches, above zero: a drive `d` becomes
    /// `d / (1 + |d| / saturation)`. `None`: no limit; 0.3 to 1 assumed.
    pub saturation: Option<f64>,
}

impl Default for Piezoresistance {
    fn default() -> Self {
        Self {
            pressure_gain: 0.3,
            half_pressure_pa: 1e4,
            strain_gain: 1.2,
            hysteresis: 0.1,
            thresholds: vec![0.02, 0.05, 0.1, 0.2],
            relaxing: vec![0.08, 0.07],
            relaxation_s: vec![0.5, 10.0],
            ring: 0.0,
            ring_radius_m: 0.02,
            saturation: None,
        }
    }
}

/// Compliance of the rim and response of the contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Rim {
    /// Fraction of the free fabric's displacement by which the rim moves: 0 rigid, 1 free. For
    /// springs in series it is `1 / (1 + rim stiffness / fabric stiffness)`. Default 0.7, assumed.
    pub compliance: f64,
    /// Decrease of ln(contact impedance) per deflection at the electrode, relative to the
    /// membrane's length: fabric that is pulled down presses against its electrode. Zero: no
    /// effect. Default 2, assumed.
    pub contact_gain: f64,
}

impl Default for Rim {
    fn default() -> Self {
        Self { compliance: 0.7, contact_gain: 2.0 }
    }
}

/// Unevenness of the fabric, and how much better it conducts along than across: ln(conductivity) is a
/// Gaussian field with covariance `amplitude^2 exp(-r^2 / 2 correlation^2)`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Weave {
    /// Standard deviation of ln(conductivity). Default 0.05, assumed. Zero: uniform.
    pub amplitude: f64,
    /// Correlation length, metres, above zero. Default 0.02, assumed.
    pub correlation_m: f64,
    /// Conductivity along `angle_deg` divided by that across, above zero. Default 1; knits have 1.3 to 2
    /// (see `docs/FABRIC.md`).
    pub ratio: f64,
    /// Angle of the better direction, degrees counter-clockwise from x ([`Anisotropy::uniform`](crate::Anisotropy::uniform)).
    pub angle_deg: f64,
}

impl Default for Weave {
    fn default() -> Self {
        Self { amplitude: 0.05, correlation_m: 0.02, ratio: 1.0, angle_deg: 0.0 }
    }
}

/// Slow drift: Gaussian processes that start from zero.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Drift {
    /// Standard deviation of ln(conductivity) of the whole sheet. Default 1e-3, assumed. Zero: no
    /// drift.
    pub conductivity: f64,
    /// Standard deviation of ln(contact impedance), independent for each electrode. Default 5e-3,
    /// assumed. Zero: no drift.
    pub contact: f64,
    /// Correlation time, seconds, above zero. Default 60, assumed.
    pub time_s: f64,
    /// Steady change of ln(conductivity) per minute, mean over the sheet. Default 0; 0.003 to 0.01 assumed for a sheet
    /// that a hand or a motor warms.
    pub warming_per_min: f64,
    /// Standard deviation of that change over the sheet, relative to its mean. Default 0.5, assumed.
    pub warming_unevenness: f64,
}

impl Default for Drift {
    fn default() -> Self {
        Self {
            conductivity: 1e-3,
            contact: 5e-3,
            time_s: 60.0,
            warming_per_min: 0.0,
            warming_unevenness: 0.5,
        }
    }
}

/// Noise, gain errors, converter, current source and bad contacts of the instrument.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Instrument {
    /// Range of the standard deviation of additive noise, volt. Each channel (measurement pattern)
    /// draws its own uniformly from this range. Default 4e-7 to 1.4e-6, as measured on recordings
    /// of a KHU Mark2.5. Both zero: no noise.
    pub noise_v: [f64; 2],
    /// Standard deviation of the channels' gains around one. Default 1e-3, assumed. Zero: exact
    /// gains.
    pub gain_error: f64,
    /// Common-mode rejection, decibel, above zero: the mean potential of the measured electrodes above the sink of
    /// the current leaks into each value by `10^(-dB / 20)`. `None`: none leaks. 45 to 60
    /// assumed behind multiplexers at tens of kilohertz.
    pub common_mode_db: Option<f64>,
    /// Standard deviation of slow noise of each channel, volt, equal in each octave of time from one frame to 256
    /// (1/f). Default 0.
    pub flicker_v: f64,
    /// Amplitude of mains that sampling turns into a slow sine, volt, with a phase of its own for each channel. Default 0.
    pub mains_v: f64,
    /// Frequency of that sine, hertz. Default 0.1, assumed.
    pub mains_hz: f64,
    /// Time from the first to the last drive of a scan as a share of the time between frames, 0 to 1: each drive is
    /// measured at its own time, evenly around the frame's. Default 0: all at once; 0.5 to 1 for instruments that
    /// drive one pair after the other.
    pub scan_share: f64,
    /// Probability that a frame is torn: its first values are of this scan, the others of the former frame. Default 0.
    pub torn: f64,
    /// Probability that one value of a frame is off by up to the largest voltage. Default 0.
    pub spiked: f64,
    /// Resolution of the converter, 2 to 32 bits; 0: values are neither quantised nor clipped.
    pub bits: u32,
    /// Largest magnitude that the converter can represent, volt, above zero. `None`: 1.25 times the
    /// largest voltage of the untouched skin, as if the gain were set once.
    pub range_v: Option<f64>,
    /// Compliance voltage of the current source, between its two electrodes, volt, above zero. The
    /// current is reduced so that this voltage is not exceeded. `None`: no limit.
    pub compliance_v: Option<f64>,
    /// Electrodes without contact, by number from 1. Measurements that involve them float: noise
    /// with a standard deviation of a tenth of the largest voltage.
    pub lost: Vec<usize>,
    /// Electrodes with a loose contact, by number from 1.
    pub loose: Vec<usize>,
    /// Rate at which a closed loose contact opens, per second. Default 0.5, assumed.
    pub loose_rate_hz: f64,
    /// Mean time that a loose contact stays open, seconds. Default 0.3, assumed.
    pub loose_time_s: f64,
    /// Factor on the contact impedance of an open contact, 1 to 1e6. Default 1e3, assumed: a
    /// contact that barely touches.
    pub open_factor: f64,
}

impl Default for Instrument {
    fn default() -> Self {
        Self {
            noise_v: [4e-7, 1.4e-6],
            gain_error: 1e-3,
            common_mode_db: None,
            flicker_v: 0.0,
            mains_v: 0.0,
            mains_hz: 0.1,
            scan_share: 0.0,
            torn: 0.0,
            spiked: 0.0,
            bits: 16,
            range_v: None,
            compliance_v: None,
            lost: Vec::new(),
            loose: Vec::new(),
            loose_rate_hz: 0.5,
            loose_time_s: 0.3,
            open_factor: 1e3,
        }
    }
}

/// Response of a linear skin: the conductivity depends only on the current force and shape of the
/// fingers, so images can be assessed without the mechanics of a fabric.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct LinearResponse {
    /// Relative change of the conductivity at the centre of a touch, per newton. Either sign; the
    /// conductivity must stay above zero.
    pub change_per_newton: f64,
}

impl FabricSettings {
    /// Settings without drift, unevenness, electrode effects, hysteresis, relaxation or instrument
    /// errors: touches only change the conductivity, and no node moves.
    pub fn ideal() -> Self {
        let mut ideal = Self::default();
        ideal.membrane.moves_nodes = false;
        ideal.piezo.hysteresis = 0.0;
        ideal.piezo.relaxing.clear();
        ideal.piezo.relaxation_s.clear();
        ideal.rim = Rim { compliance: 0.0, contact_gain: 0.0 };
        ideal.weave.amplitude = 0.0;
        ideal.drift.conductivity = 0.0;
        ideal.drift.contact = 0.0;
        ideal.instrument.noise_v = [0.0, 0.0];
        ideal.instrument.gain_error = 0.0;
        ideal.instrument.bits = 0;
        ideal
    }

    /// Settings of a linear skin without drift, unevenness or instrument errors.
    pub fn linear(change_per_newton: f64) -> Self {
        Self { linear: Some(LinearResponse { change_per_newton }), ..Self::ideal() }
    }
}
