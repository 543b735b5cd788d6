//! Result of a solve with electrodes eliminated.

/// Result of a solve, in addition to the potentials in the workspace.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// Voltages in protocol order.
    pub voltages_v: Vec<f64>,
    /// Error bound of each voltage.
    pub bounds_v: Vec<f64>,
    /// Low-order parts of the potentials in the workspace, [unknown, solve].
    pub low: Vec<f64>,
    /// For each stimulation, the potential where the fields are zero (the last electrode's mean).
    pub levels_v: Vec<f64>,
    /// Largest componentwise backward error of the fields.
    pub backward_error: f64,
    /// Largest relative change of the voltages per relative change of the conductances.
    pub condition: f64,
    /// Number of stored entries of the factor.
    pub factor_entries: usize,
    /// Whether the solve used twice the precision.
    pub extended: bool,
}

impl Outcome {
    /// Largest error bound, relative to the largest voltage.
    pub(crate) fn bound(&self) -> f64 {
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        largest(&self.bounds_v) / largest(&self.voltages_v)
    }

    /// Low-order parts of the potentials; `None` if the solve used `f64`.
    pub(crate) fn low(&self) -> Option<&[f64]> {
        self.extended.then_some(&self.low)
    }
}
