//! Validation of fabric settings.

use super::FabricSettings;
use crate::error::FemError;

impl FabricSettings {
    /// Rejects parameters that are out of range for a skin with the given number of electrodes.
    ///
    /// # Errors
    /// [`FemError::OutOfRange`], [`FemError::WrongLength`] or [`FemError::NoSuchElectrode`], with
    /// the parameter and its value.
    pub fn validate(&self, electrodes: usize) -> Result<(), FemError> {
        let Self { membrane, print, piezo, rim, weave, drift, instrument, linear } = self;
        let positive = [
            ("fabric.membrane.tension_n_per_m", membrane.tension_n_per_m),
            ("fabric.membrane.foundation_pa_per_m", membrane.foundation_pa_per_m),
            ("fabric.membrane.stiffness_n_per_m", membrane.stiffness_n_per_m),
            ("fabric.print.roll_s", print.roll_s),
            ("fabric.piezo.half_pressure_pa", piezo.half_pressure_pa),
            ("fabric.piezo.ring_radius_m", piezo.ring_radius_m),
            ("fabric.piezo.saturation", piezo.saturation.unwrap_or(1.0)),
            ("fabric.instrument.common_mode_db", instrument.common_mode_db.unwrap_or(1.0)),
            ("fabric.weave.correlation_m", weave.correlation_m),
            ("fabric.weave.ratio", weave.ratio),
            ("fabric.drift.time_s", drift.time_s),
            ("fabric.instrument.range_v", instrument.range_v.unwrap_or(1.0)),
            ("fabric.instrument.compliance_v", instrument.compliance_v.unwrap_or(1.0)),
            ("fabric.instrument.loose_time_s", instrument.loose_time_s),
        ];
        require(positive, |v| v > 0.0, "finite and above zero")?;
        let list = |name, values: &[f64]| values.iter().map(|v| (name, *v)).collect::<Vec<_>>();
        require(list("fabric.piezo.thresholds", &piezo.thresholds), |v| v > 0.0, "above zero")?;
        require(list("fabric.piezo.relaxation_s", &piezo.relaxation_s), |v| v > 0.0, "above zero")?;
        let [least_v, most_v] = instrument.noise_v;
        let amplitudes = [
            ("fabric.membrane.friction", membrane.friction),
            ("fabric.print.squash_n", print.squash_n),
            ("fabric.print.roll_m", print.roll_m),
            ("fabric.print.roll_deg", print.roll_deg),
            ("fabric.weave.amplitude", weave.amplitude),
            ("fabric.drift.conductivity", drift.conductivity),
            ("fabric.drift.contact", drift.contact),
            ("fabric.drift.warming_unevenness", drift.warming_unevenness),
            ("fabric.instrument.gain_error", instrument.gain_error),
            ("fabric.instrument.flicker_v", instrument.flicker_v),
            ("fabric.instrument.mains_v", instrument.mains_v),
            ("fabric.instrument.mains_hz", instrument.mains_hz),
            ("fabric.instrument.noise_v[0]", least_v),
            ("fabric.instrument.noise_v[1] - noise_v[0]", most_v - least_v),
            ("fabric.instrument.loose_rate_hz", instrument.loose_rate_hz),
        ];
        require(amplitudes, |v| v >= 0.0, "finite and at least zero")?;
        let relaxing = piezo.relaxing.iter().map(|share| share.abs()).sum();
        let below_one = [
            ("fabric.membrane.poisson_ratio", membrane.poisson_ratio),
            ("fabric.piezo.hysteresis", piezo.hysteresis),
            ("the sum of magnitudes of fabric.piezo.relaxing", relaxing),
            ("the magnitude of fabric.piezo.ring", piezo.ring.abs()),
        ];
        require(below_one, |v| (0.0..1.0).contains(&v), "from 0 to below 1")?;
        let gains = [
            ("fabric.piezo.pressure_gain", piezo.pressure_gain),
            ("fabric.piezo.strain_gain", piezo.strain_gain),
            ("fabric.rim.contact_gain", rim.contact_gain),
            ("fabric.drift.warming_per_min", drift.warming_per_min),
        ];
        // beyond this, ln(conductivity) would span decades under a finger
        require(gains, |v| v.abs() <= 10.0, "from -10 to 10")?;
        let shares = [
            ("fabric.rim.compliance", rim.compliance),
            ("fabric.instrument.scan_share", instrument.scan_share),
            ("fabric.instrument.torn", instrument.torn),
            ("fabric.instrument.spiked", instrument.spiked),
        ];
        require(shares, |v| (0.0..=1.0).contains(&v), "0 to 1")?;
        let change =
            linear.map(|linear| ("fabric.linear.change_per_newton", linear.change_per_newton));
        require(change, |_| true, "finite")?;
        require([("fabric.print.ratio", print.ratio)], |v| v >= 1.0, "finite and at least 1")?;
        require([("fabric.weave.angle_deg", weave.angle_deg)], |_| true, "finite")?;
        let bits = [("fabric.instrument.bits", f64::from(instrument.bits))];
        require(bits, |v| v == 0.0 || (2.0..=32.0).contains(&v), "0 or from 2 to 32")?;
        let factor = [("fabric.instrument.open_factor", instrument.open_factor)];
        require(factor, |v| (1.0..=1e6).contains(&v), "from 1 to 1e6")?;
        self.check_lists(electrodes)
    }

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
