//! Which electrodes a measurement involves, and which measurement is its reciprocal.

use eit_fem::Protocol;
use std::collections::HashMap;

/// Electrodes and reciprocals of the measurements of a protocol.
#[derive(Debug, Clone)]
pub(super) struct Wiring {
    /// Electrodes of each measurement.
    pub of_measurement: Vec<Vec<usize>>,
    /// Used measurements that involve each electrode.
    pub of_electrode: Vec<Vec<usize>>,
    /// Reciprocal of each measurement; its own index if it has none.
    pub reciprocal: Vec<usize>,
}

impl Wiring {
    /// `used` tells for each measurement of the protocol whether it counts.
    pub(crate) fn new(protocol: &Protocol, used: &[bool]) -> Self {
        let of_measurement = electrodes_of(protocol);
        let mut of_electrode = vec![Vec::new(); protocol.electrodes()];
        let counted = of_measurement.iter().zip(used).enumerate().filter(|(_, (_, used))| **used);
        for (i, (electrodes, _)) in counted {
            electrodes.iter().for_each(|&e| of_electrode[e].push(i));
        }
        Self { of_measurement, of_electrode, reciprocal: reciprocal(protocol) }
    }
}

/// Electrodes of each measurement that carry current or are measured; none for patterns with more
/// than two electrodes.
fn electrodes_of(protocol: &Protocol) -> Vec<Vec<usize>> {
    let (stimulations, patterns) = (protocol.stimulations_a(), protocol.measurement_patterns());
    let of = |row: ndarray::ArrayView1<'_, f64>| -> Vec<usize> {
        let involved: Vec<usize> = (0..row.len()).filter(|&e| row[e] != 0.0).collect();
        if involved.len() > 2 { Vec::new() } else { involved }
    };
    let measurement = |&[s, m]: &[u32; 2]| {
        let mut electrodes = of(stimulations.row(s as usize));
        electrodes.extend(of(patterns.row(m as usize)));
        electrodes.sort_unstable();
        electrodes.dedup();
        electrodes
    };
    protocol.data().iter().map(measurement).collect()
}

/// Index of the measurement with drive and measurement exchanged, with the same sign; its own index if there
/// is none.
fn reciprocal(protocol: &Protocol) -> Vec<usize> {
    let Some(quadruples) = protocol.quadruples() else {
        return (0..protocol.measurements()).collect();
    };
    let index: HashMap<[u32; 4], usize> =
        quadruples.iter().enumerate().map(|(i, q)| (*q, i)).collect();
    let twin = |(i, [a, b, m, n]): (usize, &[u32; 4])| {
        let candidates = [[*m, *n, *a, *b], [*n, *m, *b, *a]];
        candidates.iter().find_map(|q| index.get(q)).copied().unwrap_or(i)
    };
    let found: Vec<usize> = quadruples.iter().enumerate().map(twin).collect();
    (0..found.len()).map(|i| if found[found[i]] == i { found[i] } else { i }).collect()
}
