//! Non-zero entries of each pattern, and sums over them.

use super::patterns::Protocol;
use crate::sparse::Scalar;
use faer::MatRef;
use ndarray::ArrayView2;

/// Non-zero entries (electrode, value) of a protocol's patterns, one list per pattern.
#[derive(Debug, Clone)]
pub(crate) struct PatternEntries {
    pub stimulations_a: Vec<Vec<(u32, f64)>>,
    pub measurements: Vec<Vec<(u32, f64)>>,
}

impl PatternEntries {
    /// Collects the entries of a protocol.
    pub(crate) fn new(protocol: &Protocol) -> Self {
        let sparse = |rows: ArrayView2<f64>| {
            rows.rows()
                .into_iter()
                .map(|row| (0u32..).zip(row.iter().copied()).filter(|e| e.1 != 0.0).collect())
                .collect()
        };
        Self {
            stimulations_a: sparse(protocol.stimulations_a()),
            measurements: sparse(protocol.measurement_patterns()),
        }
    }

    /// Computes electrode potentials, [stimulation, electrode], from the potentials for unit
    /// currents, [electrode except ground, electrode except ground]. Rows sum to zero.
    pub(crate) fn electrode_potentials<T: Scalar>(
        &self,
        transfer: MatRef<'_, T>,
        potentials: &mut [T],
    ) {
        let ground = transfer.nrows();
        let rows = potentials.chunks_exact_mut(ground + 1);
        for (row, currents) in rows.zip(&self.stimulations_a) {
            row.fill(T::from(0.0));
            for &(k, current_a) in currents.iter().filter(|c| (c.0 as usize) < ground) {
                for (l, potential) in row[..ground].iter_mut().enumerate() {
                    *potential += transfer[(l, k as usize)] * current_a;
                }
            }
            let mut sum = T::from(0.0);
            row.iter().for_each(|potential| sum += *potential);
            let mean = sum / row.len() as f64;
            row.iter_mut().for_each(|potential| *potential -= mean);
        }
    }
}
