//! Parameters of the fabric: each with its default, its source or the word "assumed".
//!
//! `docs/FABRIC.md` discusses them. An amplitude of zero leaves its part out: nothing of it is
//! computed, and no other part changes.

mod check;

/// Everything the fabric is made of.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct FabricSettings {
    /// How the fabric yields.
    pub membrane: Membrane,
    /// How it conducts when pressed and stretched.
    pub piezo: Piezoresistance,
    /// How rim and electrodes give way.
    pub rim: Rim,
    /// Unevenness of the fabric.
    pub weave: Weave,
    /// Slow change of fabric and contacts.
    pub drift: Drift,
    /// What measures.
    pub instrument: Instrument,
    /// The response of a linear skin, in place of `membrane`, `piezo` and `rim`: nothing moves, no contact
    /// changes, no force is too large. Left out: that of the fabric.
    pub linear: Option<LinearResponse>,
}

/// A stretched membrane on a soft layer.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Membrane {
    /// Tension, newton per metre, above zero. Assumed: 50, a knit stretched over a frame; a
    /// fingertip of 1.5 N then sinks in by a centimetre.
    pub tension_n_per_m: f64,
    /// Foundation: pressure per deflection, pascal per metre, above zero. Assumed: 5e4, next to
    /// nothing beneath the fabric. With 50 N/m a dent reaches 30 mm. Soft foam has 1e6.
    pub foundation_pa_per_m: f64,
    /// Poisson's ratio of the fabric, from 0 to below 1. Assumed: 0.3.
    pub poisson_ratio: f64,
    /// Stiffness of the fabric in its plane, newton per metre, above zero. Assumed: 300, a knit.
    pub stiffness_n_per_m: f64,
    /// Friction of a moving finger, which drags the fabric along. Assumed: 0.4. Zero: none.
    pub friction: f64,
    /// Whether the dent moves the nodes of the mesh; false: the solves see a flat skin at rest.
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

/// From pressure and strain to conductivity, with hysteresis and relaxation.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Piezoresistance {
    /// Change of ln(conductivity) under very high pressure. Assumed: 0.3. Zero: no effect.
    pub pressure_gain: f64,
    /// Pressure of half that change, pascal, above zero. Assumed: 1e4.
    pub half_pressure_pa: f64,
    /// Change of ln(conductivity) per areal strain; positive: stretching brings yarns together.
    /// Zero: no effect. Published gauge factors of knitted sensors are 0 to 2.4 in size, of either
    /// sign (Bozali et al., Sensors 22:7688, 2022: 0 to 1.19; Tangsirinaruenart and Stylios,
    /// Materials 12:1469, 2019: 1.61). Default 1.2 with this sign: assumed.
    pub strain_gain: f64,
    /// Share of the response that is plastic (play operators), 0 to below 1. Zero: no hysteresis.
    /// Default 0.1; published hysteresis of knitted sensors is 3 % (Bozali et al.) to 12.5 %
    /// (see `docs/FABRIC.md`).
    pub hysteresis: f64,
    /// Thresholds of the play operators, in ln(conductivity), above zero. Assumed.
    pub thresholds: Vec<f64>,
    /// Shares of the response that fade after a step, each from 0, sum below 1. Assumed: 0.08 and
    /// 0.07, as fabrics overshoot and settle (Bozali et al. and others).
    pub relaxing: Vec<f64>,
    /// Their time constants, seconds, above zero. Assumed: 0.5 and 10.
    pub relaxation_s: Vec<f64>,
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
        }
    }
}

/// Rim and electrodes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Rim {
    /// Part of the free fabric's displacement that the rim follows: 0 rigid, 1 free. Springs in
    /// series, `1 / (1 + rim stiffness / fabric stiffness)`. Assumed: 0.7.
    pub compliance: f64,
    /// Fall of ln(contact impedance) per deflection at the electrode over the membrane's length:
    /// a fabric pulled down is pressed against its electrode. Zero: no effect. Assumed: 2.
    pub contact_gain: f64,
}

impl Default for Rim {
    fn default() -> Self {
        Self { compliance: 0.7, contact_gain: 2.0 }
    }
}

/// Unevenness: ln(conductivity) is a Gaussian field of covariance
/// `amplitude^2 exp(-r^2 / 2 correlation^2)`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Weave {
    /// Standard deviation of ln(conductivity). Assumed: 0.05. Zero: even.
    pub amplitude: f64,
    /// Correlation length, metres, above zero. Assumed: 0.02.
    pub correlation_m: f64,
}

impl Default for Weave {
    fn default() -> Self {
        Self { amplitude: 0.05, correlation_m: 0.02 }
    }
}

/// Slow Gaussian processes that start from zero.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Drift {
    /// Standard deviation of ln(conductivity) of the whole sheet. Assumed: 1e-3. Zero: none.
    pub conductivity: f64,
    /// Standard deviation of ln(contact impedance), each electrode for itself. Assumed: 5e-3.
    pub contact: f64,
    /// Correlation time, seconds, above zero. Assumed: 60.
    pub time_s: f64,
}

impl Default for Drift {
    fn default() -> Self {
        Self { conductivity: 1e-3, contact: 5e-3, time_s: 60.0 }
    }
}

/// The instrument.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Instrument {
    /// Standard deviation of additive noise, volt: each channel (measurement pattern) has its own,
    /// uniform between the two. Default 4e-7 and 1.4e-6, as measured on recordings of a KHU
    /// Mark2.5. Zero and zero: none.
    pub noise_v: [f64; 2],
    /// Standard deviation of the channels' gains around one. Assumed: 1e-3. Zero: exact.
    pub gain_error: f64,
    /// Bits of the converter, 2 to 32; 0: neither quantised nor saturated.
    pub bits: u32,
    /// Largest magnitude that the converter shows, volt, above zero. Left out: 1.25 times the
    /// largest voltage of the untouched skin, a gain set once.
    pub range_v: Option<f64>,
    /// Voltage at which the current source gives up, between its two electrodes, above zero: its
    /// current then falls to what that voltage drives. Left out: none.
    pub compliance_v: Option<f64>,
    /// Electrodes without contact, by number from 1: what they drive or measure floats, noise of a tenth
    /// of the largest voltage.
    pub lost: Vec<usize>,
    /// Electrodes with a loose contact, by number from 1.
    pub loose: Vec<usize>,
    /// How often a loose contact opens, per second, and how long it stays open on average, seconds.
    pub loose_rate_hz: f64,
    /// See there.
    pub loose_time_s: f64,
    /// Factor on the contact impedance of an open contact, at least 1. 1e3: one that barely touches.
    pub open_factor: f64,
}

impl Default for Instrument {
    fn default() -> Self {
        Self {
            noise_v: [4e-7, 1.4e-6],
            gain_error: 1e-3,
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

/// The response of a linear skin: the conductivity follows force and shape of the fingers at once, so
/// that images can be judged without the mechanics of a fabric between finger and truth.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct LinearResponse {
    /// Relative change of the conductivity in the middle of a touch, per newton. Either sign; the
    /// conductivity must stay above zero.
    pub change_per_newton: f64,
}

impl FabricSettings {
    /// No drift, unevenness, electrode effects, hysteresis, relaxation, nor instrument: only the
    /// conductivity follows the touch, and no node moves.
    pub fn ideal() -> Self {
        Self {
            membrane: Membrane { moves_nodes: false, ..Default::default() },
            piezo: Piezoresistance {
                hysteresis: 0.0,
                relaxing: Vec::new(),
                relaxation_s: Vec::new(),
                ..Default::default()
            },
            rim: Rim { compliance: 0.0, contact_gain: 0.0 },
            weave: Weave { amplitude: 0.0, ..Default::default() },
            drift: Drift { conductivity: 0.0, contact: 0.0, ..Default::default() },
            instrument: Instrument {
                noise_v: [0.0, 0.0],
                gain_error: 0.0,
                bits: 0,
                ..Default::default()
            },
            linear: None,
        }
    }

    /// A linear skin and nothing else: no drift, unevenness nor instrument.
    pub fn linear(change_per_newton: f64) -> Self {
        Self { linear: Some(LinearResponse { change_per_newton }), ..Self::ideal() }
    }
}
