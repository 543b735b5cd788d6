//! Report of a forward solve.

/// Path that a forward solve took.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SolvePath {
    /// Textbook matrix of node and electrode potentials, assembled in `f64`. Accurate enough for
    /// ordinary scenes.
    NodalAssembly,
    /// Electrodes eliminated analytically, in `f64`. Contact impedances cost no accuracy.
    ElectrodesEliminated,
    /// Electrodes eliminated analytically, in twice the precision of `f64`. High contrast and flat
    /// triangles cost no accuracy either.
    ExtendedPrecision,
}

/// Path, size, accuracy and time of a forward solve.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct SolveReport {
    /// Path that the solve took.
    pub path: SolvePath,
    /// Number of unknowns: node and electrode potentials.
    pub unknowns: usize,
    /// Number of stored entries of the factor, 8 bytes each (extended precision: 16).
    pub factor_entries: usize,
    /// Number of fields solved: the rank of the protocol's patterns.
    pub field_solves: usize,
    /// Largest componentwise backward error `|A x - b|_i / (|A| |x| + |b|)_i` of the fields
    /// (Oettli and Prager 1964). At 1e-16, the solve is as accurate as the matrix entries.
    pub backward_error: f64,
    /// Estimated error of the voltages due to rounding in the assembled matrix, relative to the
    /// largest: `1000 eps max(a_ii) / min(a_ii)` over the diagonal.
    ///
    /// The estimate comes from the spread of conductances, which the backward error does not show.
    /// It exceeds the true error in every reference case of `tests/all/reference.rs`, often by far.
    /// Near 1, no digit is certain. With electrodes eliminated it equals `error_bound`.
    pub expected_loss: f64,
    /// Largest error of any voltage, as a fraction of the largest voltage. With electrodes
    /// eliminated it is a bound from residuals and the rounding of every step, at least `eps`; with
    /// nodal assembly it is [`SolveReport::expected_loss`], an estimate.
    pub error_bound: f64,
    /// Largest relative error of any voltage. A bound with electrodes eliminated; an estimate with
    /// nodal assembly.
    pub value_error_bound: f64,
    /// Condition number: the largest relative change of the voltages per relative change of the
    /// conductances. With nodal assembly, the ratio of the largest to the smallest diagonal entry.
    pub condition: f64,
    /// Time of assembly, factorisation and fields, seconds.
    pub time_s: f64,
}
