//! [`Protocol`]: ordered stimulation and measurement patterns.

use super::pairs::{PairPattern, check_electrodes, check_pair};
use crate::error::FemError;
use ndarray::{Array2, ArrayView2};
use std::collections::HashMap;

/// Largest sum of a pattern's entries, relative to its largest entry.
///
/// Pattern files carry about seven digits (single precision); a larger sum means a wrong file.
const BALANCE: f64 = 1e-6;

/// Ordered stimulation and measurement patterns.
///
/// ```
/// use eit_fem::Protocol;
///
/// // two measurements of a skin with four electrodes, driven by 0.1 mA
/// let protocol = Protocol::from_quadruples(4, &[[0, 1, 2, 3], [1, 2, 3, 0]], 1e-4)?;
/// assert_eq!(protocol.measurements(), 2);
/// assert_eq!(protocol.stimulations_a()[[0, 0]], 1e-4);
/// # Ok::<(), eit_fem::FemError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(
        try_from = "super::serialised::ProtocolParts",
        into = "super::serialised::ProtocolParts"
    )
)]
pub struct Protocol {
    stimulations_a: Array2<f64>,
    measurement_patterns: Array2<f64>,
    data: Vec<[u32; 2]>,
    quadruples: Option<Vec<[u32; 4]>>,
}

impl Protocol {
    /// Creates a protocol with one measurement per quadruple `[a, b, m, n]` (0-based), driven with
    /// `current_a`, ampere.
    ///
    /// # Errors
    /// An unknown electrode; a pair that uses one electrode twice; no quadruple; a current that is
    /// not finite and above zero; more than 4096 electrodes.
    pub fn from_quadruples(
        electrodes: usize,
        quadruples: &[[u32; 4]],
        current_a: f64,
    ) -> Result<Self, FemError> {
        check_electrodes(electrodes)?;
        if !(current_a.is_finite() && current_a > 0.0) {
            return Err(FemError::BadCurrent { current_a });
        }
        if quadruples.is_empty() {
            return Err(FemError::EmptyProtocol);
        }
        for (index, &[a, b, m, n]) in quadruples.iter().enumerate() {
            for pair in [[a, b], [m, n]] {
                check_pair("quadruple", index, pair, electrodes)?;
            }
        }
        let mut drives = PatternList::default();
        let mut senses = PatternList::default();
        let data = quadruples
            .iter()
            .map(|&[a, b, m, n]| [drives.index_of([a, b]), senses.index_of([m, n])])
            .collect();
        Ok(Self {
            stimulations_a: drives.matrix(electrodes, current_a),
            measurement_patterns: senses.matrix(electrodes, 1.0),
            data,
            quadruples: Some(quadruples.to_vec()),
        })
    }

    /// Creates a protocol that reads every measurement pattern under every stimulation pattern,
    /// with measurements varying fastest.
    ///
    /// Both matrices are [electrode, pattern], stimulations in ampere; each column sums to zero. A
    /// residual sum of up to 1e-6 of the largest entry (rounding in a file) is subtracted in equal
    /// parts from the column's non-zero entries, so that voltages and Jacobian agree to rounding.
    ///
    /// # Errors
    /// Matrices with different numbers of rows; no column; a value that is not finite; columns that
    /// are zero or do not sum to zero; more than 4096 electrodes.
    pub fn from_patterns(
        stimulations_a: ArrayView2<f64>,
        measurement_patterns: ArrayView2<f64>,
    ) -> Result<Self, FemError> {
        let electrodes = stimulations_a.nrows();
        check_electrodes(electrodes)?;
        let what = "rows of the measurement pattern matrix";
        FemError::check_length(what, measurement_patterns.nrows(), electrodes)?;
        check_patterns("stimulation", stimulations_a)?;
        check_patterns("measurement", measurement_patterns)?;
        let (stimulations, senses) = (stimulations_a.ncols(), measurement_patterns.ncols());
        if stimulations == 0 || senses == 0 {
            return Err(FemError::EmptyProtocol);
        }
        let data = (0..stimulations as u32)
            .flat_map(|s| (0..senses as u32).map(move |m| [s, m]))
            .collect();
        Ok(Self {
            stimulations_a: balanced_rows(stimulations_a),
            measurement_patterns: balanced_rows(measurement_patterns),
            data,
            quadruples: None,
        })
    }

    /// Creates a protocol with trigonometric currents on all electrodes at once, and the voltages
    /// of the measured pairs under each of them.
    ///
    /// There are `L - 1` stimulation patterns for `L` electrodes, with `theta_l = 2 pi l / L`:
    ///
    /// ```text
    /// I_l = current_a cos(k theta_l)   k = 1 ..= L / 2
    /// I_l = current_a sin(k theta_l)   k = 1 ..= (L - 1) / 2
    /// ```
    ///
    /// Cosines come first; measured pairs vary fastest. The patterns span all balanced currents,
    /// and no pair of electrodes carries more current than the others. On a disc they distinguish
    /// conductivities best (D. Isaacson, "Distinguishability of conductivities by electric current
    /// computed tomography", IEEE Trans. Med. Imaging 5, 1986). Every electrode is driven, so every
    /// value depends on contact impedances.
    ///
    /// # Errors
    /// Fewer than 2 electrodes or more than 4096; a current that is not finite and above zero; an
    /// invalid pair.
    pub fn trigonometric(
        electrodes: usize,
        measure: &PairPattern,
        current_a: f64,
    ) -> Result<Self, FemError> {
        check_electrodes(electrodes)?;
        if !(current_a.is_finite() && current_a > 0.0) {
            return Err(FemError::BadCurrent { current_a });
        }
        let pairs = measure.pairs("measured pair", electrodes)?;
        if pairs.is_empty() {
            return Err(FemError::EmptyProtocol);
        }
        let angle = |k: usize, l: usize| {
            // reduce modulo the number of electrodes, so that a pattern's values cancel to rounding
            std::f64::consts::TAU * ((k * l) % electrodes) as f64 / electrodes as f64
        };
        let cosines = electrodes / 2;
        let stimulations = Array2::from_shape_fn((electrodes, electrodes - 1), |(l, s)| {
            current_a
                * match s.checked_sub(cosines) {
                    None => angle(s + 1, l).cos(),
                    Some(s) => angle(s + 1, l).sin(),
                }
        });
        let senses = Array2::from_shape_fn((electrodes, pairs.len()), |(l, m)| match pairs[m] {
            [first, _] if first as usize == l => 1.0,
            [_, second] if second as usize == l => -1.0,
            _ => 0.0,
        });
        Self::from_patterns(stimulations.view(), senses.view())
    }

    /// Number of electrodes.
    pub fn electrodes(&self) -> usize {
        self.stimulations_a.ncols()
    }

    /// Number of measurements, which is the length of a frame.
    pub fn measurements(&self) -> usize {
        self.data.len()
    }

    /// Stimulation patterns, [stimulation, electrode], ampere; positive currents enter the skin.
    pub fn stimulations_a(&self) -> ArrayView2<'_, f64> {
        self.stimulations_a.view()
    }

    /// Measurement patterns, [pattern, electrode]: weights of the electrode potentials.
    pub fn measurement_patterns(&self) -> ArrayView2<'_, f64> {
        self.measurement_patterns.view()
    }

    /// For each measurement, in protocol order: the indices of its stimulation pattern and of its
    /// measurement pattern.
    pub fn data(&self) -> &[[u32; 2]] {
        &self.data
    }

    /// Quadruples `[a, b, m, n]` in protocol order; `None` unless the protocol was made from
    /// quadruples.
    pub fn quadruples(&self) -> Option<&[[u32; 4]]> {
        self.quadruples.as_deref()
    }
}

/// Distinct pairs in order of first use.
#[derive(Default)]
struct PatternList {
    pairs: Vec<[u32; 2]>,
    index: HashMap<[u32; 2], u32>,
}

impl PatternList {
    fn index_of(&mut self, pair: [u32; 2]) -> u32 {
        *self.index.entry(pair).or_insert_with(|| {
            self.pairs.push(pair);
            self.pairs.len() as u32 - 1
        })
    }

    fn matrix(&self, electrodes: usize, amplitude: f64) -> Array2<f64> {
        let mut matrix = Array2::zeros((self.pairs.len(), electrodes));
        for (row, pair) in self.pairs.iter().enumerate() {
            matrix[[row, pair[0] as usize]] = amplitude;
            matrix[[row, pair[1] as usize]] = -amplitude;
        }
        matrix
    }
}

fn check_patterns(what: &'static str, patterns: ArrayView2<f64>) -> Result<(), FemError> {
    for (pattern, column) in patterns.columns().into_iter().enumerate() {
        if let Some(electrode) = column.iter().position(|x| !x.is_finite()) {
            let value = column[electrode];
            return Err(FemError::NonFinitePattern { what, pattern, electrode, value });
        }
        let largest = column.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let sum = column.sum();
        // the sum of entries near the largest f64 can be NaN
        if largest == 0.0 || sum.is_nan() || sum.abs() > BALANCE * largest {
            return Err(FemError::UnbalancedPattern { what, pattern, sum, largest });
        }
    }
    Ok(())
}

/// Patterns as rows, with the residual of each sum spread over the pattern's non-zero entries.
fn balanced_rows(patterns: ArrayView2<f64>) -> Array2<f64> {
    let mut rows = patterns.t().as_standard_layout().into_owned();
    for mut row in rows.rows_mut() {
        let used = row.iter().filter(|x| **x != 0.0).count();
        let excess = row.sum() / used as f64;
        row.iter_mut().filter(|x| **x != 0.0).for_each(|x| *x -= excess);
    }
    rows
}
