//! Validation of fabric settings.

use super::FabricSettings;
use crate::error::FemError;

/// Names and values of settings, `group { field, ... } ...`. One that is left out counts as 1, which every range
/// allows.
macro_rules! named {
    ($($group:ident { $($field:ident),+ })+) => {
        [$($((
            concat!("fabric.", stringify!($group), ".", stringify!($field)),
            Option::<f64>::from($group.$field).unwrap_or(1.0),
        )),+),+]
    };
}

impl FabricSettings {
    /// Rejects parameters that are out of range for a skin with the given number of electrodes.
    ///
    /// # Errors
    /// [`FemError::OutOfRange`], [`FemError::WrongLength`] or [`FemError::NoSuchElectrode`], with
    /// the parameter and its value.
    pub fn validate(&self, electrodes: usize) -> Result<(), FemError> {
        let Self { membrane, print, piezo, rim, weave, drift, instrument, linear } = self;
        let positive = named!(
            membrane { tension_n_per_m, foundation_pa_per_m, stiffness_n_per_m }
            print { roll_s }
            piezo { half_pressure_pa, ring_radius_m, saturation }
            instrument { common_mode_db }
            weave { correlation_m, ratio }
            drift { time_s }
            instrument { range_v, compliance_v, loose_time_s }
        );
        require(positive, |v| v > 0.0, "finite and above zero")?;
        let list = |name, values: &[f64]| values.iter().map(|v| (name, *v)).collect::<Vec<_>>();
        require(list("fabric.piezo.thresholds", &piezo.thresholds), |v| v > 0.0, "above zero")?;
        require(list("fabric.piezo.relaxation_s", &piezo.relaxation_s), |v| v > 0.0, "above zero")?;
        let [least_v, most_v] = instrument.noise_v;
        let noise = [
            ("fabric.instrument.noise_v[0]", least_v),
            ("fabric.instrument.noise_v[1] - noise_v[0]", most_v - least_v),
        ];
        let amplitudes = named!(
            membrane { friction }
            print { squash_n, roll_m, roll_deg }
            weave { amplitude }
            drift { conductivity, contact, warming_unevenness }
            instrument { gain_error, flicker_v, mains_v, mains_hz }
        );
        let amplitudes = amplitudes.into_iter().chain(noise);
        let amplitudes = amplitudes.chain(named!(instrument { loose_rate_hz }));
        require(amplitudes, |v| v >= 0.0, "finite and at least zero")?;
        let relaxing = piezo.relaxing.iter().map(|share| share.abs()).sum();
        let below_one = [
            ("fabric.membrane.poisson_ratio", membrane.poisson_ratio),
            ("fabric.piezo.hysteresis", piezo.hysteresis),
            ("the sum of magnitudes of fabric.piezo.relaxing", relaxing),
            ("the magnitude of fabric.piezo.ring", piezo.ring.abs()),
        ];
        require(below_one, |v| (0.0..1.0).contains(&v), "from 0 to below 1")?;
        let gains = named!(
            piezo { pressure_gain, strain_gain }
            rim { contact_gain }
            drift { warming_per_min }
        );
        // beyond this, ln(conductivity) would span decades under a finger
        require(gains, |v| v.abs() <= 10.0, "from -10 to 10")?;
        let shares = named!(rim { compliance } instrument { scan_share, torn, spiked });
        require(shares, |v| (0.0..=1.0).contains(&v), "0 to 1")?;
        if let Some(linear) = linear {
            require(named!(linear { change_per_newton }), |_| true, "finite")?;
        }
        require(named!(print { ratio }), |v| v >= 1.0, "finite and at least 1")?;
        require(named!(weave { angle_deg }), |_| true, "finite")?;
        let bits = [("fabric.instrument.bits", f64::from(instrument.bits))];
        require(bits, |v| v == 0.0 || (2.0..=32.0).contains(&v), "0 or from 2 to 32")?;
        require(named!(instrument { open_factor }), |v| (1.0..=1e6).contains(&v), "from 1 to 1e6")?;
        self.check_lists(electrodes)
    }

    /// Rejects lists of unequal length, and electrodes that the skin does not have.
    fn check_lists(&self, electrodes: usize) -> Result<(), FemError> {
        let Self { piezo, instrument, .. } = self;
        let what = "fabric.piezo.relaxation_s (one per share of fabric.piezo.relaxing)";
        FemError::check_length(what, piezo.relaxation_s.len(), piezo.relaxing.len())?;
        for (what, list) in [
            ("fabric.instrument.lost", &instrument.lost),
            ("fabric.instrument.loose", &instrument.loose),
        ] {
            if let Some(index) = list.iter().position(|n| !(1..=electrodes).contains(n)) {
                return Err(FemError::NoSuchElectrode { what, number: list[index], electrodes });
            }
        }
        Ok(())
    }
}

/// Requires every value to be finite and to satisfy `fits`.
fn require(
    values: impl IntoIterator<Item = (&'static str, f64)>,
    fits: impl Fn(f64) -> bool,
    must: &'static str,
) -> Result<(), FemError> {
    values.into_iter().try_for_each(|(name, v)| FemError::require(name, v, fits(v), must))
}
