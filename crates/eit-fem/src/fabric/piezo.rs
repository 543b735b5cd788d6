//! Piezoresistive law from pressure and strain to conductivity: saturation, hysteresis and
//! relaxation.
//!
//! The drive `d` is the change of ln(conductivity) that would occur without memory:
//!
//! ```text
//! d = pressure_gain p / (p + half_pressure) + strain_gain e       e: areal strain
//! ```
//!
//! Where the response saturates at `s`, the drive becomes `d / (1 + |d| / s)`.
//!
//! Hysteresis is a Prandtl-Ishlinskii operator (Krejci, Hysteresis, Convexity and Dissipation in
//! Hyperbolic Equations, 1996; Kuhnen, European Journal of Control 9:407, 2003), with `n` play
//! operators of thresholds `r_i`, each contributing a share `h / n` of the response:
//!
//! ```text
//! c = (1 - h) d + h/n sum of P_i,        P_i <- max(d - r_i, min(d + r_i, P_i))
//! ```
//!
//! It is independent of the rate of the drive and has the wiping-out and congruency properties. In
//! addition, shares `g_j` of the response relax, each with its own time constant `T_j`: after a
//! step, the change overshoots and settles at the fraction `1 - sum of g_j`.
//!
//! ```text
//! change of ln(conductivity) = c - sum of g_j y_j,      T_j y_j' = c - y_j
//! ```
//!
//! This is a Prony series (Christensen, Theory of Viscoelasticity, 1982). The update is exact for a
//! response that is linear between frames.

use super::contact::Dent;
use super::settings::Piezoresistance;

/// Piezoresistive law with its constants.
#[derive(Debug, Clone)]
pub struct PiezoLaw {
    settings: Piezoresistance,
    /// Weight of each play operator.
    play_weight: f64,
    /// For each Prony term: share, decay over a step, and weight of the response's change in y.
    terms: Vec<[f64; 3]>,
}

impl PiezoLaw {
    /// Creates the law for frames `step_s` seconds apart. The settings must be valid.
    pub fn new(settings: &Piezoresistance, step_s: f64) -> Self {
        let hysteresis = settings.hysteresis > 0.0 && !settings.thresholds.is_empty();
        let mut settings = settings.clone();
        if !hysteresis {
            settings.thresholds.clear();
            settings.hysteresis = 0.0;
        }
        let term = |(share, time_s): (&f64, &f64)| {
            let x = step_s / time_s;
            // 1 - (1 - e^-x)/x, the fraction of a ramp's change that y follows
            [*share, (-x).exp(), 1.0 + (-x).exp_m1() / x]
        };
        let terms = settings.relaxing.iter().zip(&settings.relaxation_s);
        let terms = terms.filter(|(share, _)| **share != 0.0).map(term).collect();
        let play_weight = settings.hysteresis / settings.thresholds.len().max(1) as f64;
        Self { settings, play_weight, terms }
    }

    /// Number of memory values per element.
    pub fn memory(&self) -> usize {
        self.settings.thresholds.len() + usize::from(!self.terms.is_empty()) + self.terms.len()
    }

    /// Returns the drive. Add the pressure and strain of several touches before calling it.
    pub fn drive(&self, dent: &Dent) -> f64 {
        let Piezoresistance { pressure_gain, half_pressure_pa, strain_gain, .. } = self.settings;
        let p = dent.pressure_pa;
        pressure_gain * p / (p + half_pressure_pa) + strain_gain * dent.areal_strain
    }

    /// Limits a drive to the saturation.
    pub fn saturated(&self, drive: f64) -> f64 {
        self.settings.saturation.map_or(drive, |most| drive / (1.0 + drive.abs() / most))
    }

    /// Returns the change of ln(conductivity) for the drive of the next frame. `memory` must start
    /// as zeros.
    pub fn step(&self, drive: f64, memory: &mut [f64]) -> f64 {
        let (plays, rest) = memory.split_at_mut(self.settings.thresholds.len());
        let mut sum = 0.0;
        for (play, r) in plays.iter_mut().zip(&self.settings.thresholds) {
            *play = (drive - r).max((drive + r).min(*play));
            sum += *play;
        }
        let response = (1.0 - self.settings.hysteresis) * drive + self.play_weight * sum;
        let Some((last, fading)) = rest.split_first_mut() else { return response };
        let rise = response - *last;
        let mut change = response;
        for (y, [share, decay, follow]) in fading.iter_mut().zip(&self.terms) {
            *y = *last + decay * (*y - *last) + follow * rise;
            change -= share * *y;
        }
        *last = response;
        change
    }
}
