//! How a forward solve went.

/// The way a forward solve took.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolvePath {
    /// The matrix of node and electrode potentials, assembled in `f64` as in textbooks: exact enough for
    /// ordinary scenes.
    NodalAssembly,
    /// Electrodes eliminated analytically, `f64`: contact impedances cost no digit.
    ElectrodesEliminated,
    /// Electrodes eliminated analytically, twice the precision of `f64`: nor do contrast and flat
    /// triangles.
    ExtendedPrecision,
}

/// How a forward solve went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveReport {
    /// The way it took.
    pub path: SolvePath,
    /// Node and electrode potentials.
    pub unknowns: usize,
    /// Stored entries of the Cholesky factor (in extended precision 16 bytes each).
    pub factor_entries: usize,
    /// Fields solved: the rank of the protocol's patterns.
    pub field_solves: usize,
    /// Largest componentwise backward error `|A x - b|_i / (|A| |x| + |b|)_i` of the fields
    /// (Oettli and Prager 1964): 1e-16 is as exact as the matrix itself.
    pub backward_error: f64,
    /// What rounding in the assembled matrix may have cost the voltages, relative to the largest:
    /// `1000 eps max(a_ii) / min(a_ii)` over the diagonal. An estimate from the spread of
    /// conductances, which the backward error cannot see; above the true error in every reference
    /// case of `tests/reference.rs`, often far above it. Near 1 no digit is certain.
    ///
    /// With electrodes eliminated it is `error_bound`.
    pub expected_loss: f64,
    /// No voltage is wrong by more than this fraction of the largest one. With electrodes eliminated a
    /// bound from residuals and the rounding of every step, at least `eps`; by nodal assembly
    /// [`SolveReport::expected_loss`], an estimate.
    pub error_bound: f64,
    /// No voltage is wrong by more than this fraction of itself; by nodal assembly an estimate.
    pub value_error_bound: f64,
    /// Relative change of the voltages per relative change of the conductances, at most: the loss
    /// over the rounding. By nodal assembly the spread of the diagonal.
    pub condition: f64,
    /// Time of assembly, factorisation and fields, seconds.
    pub time_s: f64,
}
