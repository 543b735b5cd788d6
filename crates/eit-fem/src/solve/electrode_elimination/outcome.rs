//! What a solve with electrodes eliminated leaves.

/// What a solve leaves beside the potentials in the workspace.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// Voltages in protocol order.
    pub voltages_v: Vec<f64>,
    /// Bound of the error of each.
    pub bounds_v: Vec<f64>,
    /// What the potentials of the workspace lack: [unknown, solve], low parts.
    pub low: Vec<f64>,
    /// Potential of the fields' zero for each stimulation.
    pub levels_v: Vec<f64>,
    /// Largest componentwise backward error of the fields.
    pub backward_error: f64,
    /// Relative change of the voltages per relative change of conductances, at most.
    pub condition: f64,
    /// Stored entries of the factor.
    pub factor_entries: usize,
    /// Whether numbers had twice the precision.
    pub extended: bool,
}

impl Outcome {
    /// Largest bound over the largest voltage.
    pub fn bound(&self) -> f64 {
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        largest(&self.bounds_v) / largest(&self.voltages_v)
    }

    /// What the potentials of the workspace lack, where it is anything.
    pub fn low(&self) -> Option<&[f64]> {
        self.extended.then_some(&self.low)
    }
}
