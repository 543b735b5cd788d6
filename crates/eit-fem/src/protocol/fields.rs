//! Electric fields that a protocol needs, and the smallest set of solves that spans them.
//!
//! Stimulation and measurement patterns that are multiples of each other share one field. Every
//! field is a linear combination of `rank` basis fields, chosen by pivoted Gram-Schmidt. For 16
//! electrodes with adjacent drive and measurement, 32 patterns need 16 fields and 15 solves, and
//! the 208 Jacobian rows come from 104 products of fields.

use super::patterns::Protocol;
use ndarray::{Array2, ArrayView1, ArrayView2};
use std::collections::HashMap;

/// Threshold on the distance between unit patterns, below which they count as one (or, for the
/// distance to the span of others, as dependent).
///
/// Pattern files carry at least seven digits. Patterns of well-formed sets are either dependent up
/// to rounding or far apart (adjacent pairs of 256 electrodes: 1e-2).
const DEPENDENT: f64 = 1e-9;

/// Fields of a protocol: unit patterns, a basis of them, and the product of fields for each
/// measurement.
#[derive(Debug, Clone)]
pub(crate) struct Fields {
    /// Current patterns of the basis, [solve, electrode], with unit norm.
    pub basis: Array2<f64>,
    /// Each field as a sparse combination of basis fields, (solve, coefficient).
    pub combinations: Vec<Vec<(u32, f64)>>,
    /// Storage slot of each field: basis fields first, then the other fields in order.
    pub slots: Vec<u32>,
    /// Field of which each stimulation is a multiple, and the factor.
    pub stimulations: Vec<(u32, f64)>,
    /// Products of fields, and the measurements that are multiples of them.
    pub products: Vec<Product>,
}

/// One product of two fields, and the measurements that are multiples of it.
#[derive(Debug, Clone)]
pub(crate) struct Product {
    /// The two fields.
    pub fields: [u32; 2],
    /// (measurement, factor).
    pub data: Vec<(u32, f64)>,
}

impl Fields {
    /// Analyses a protocol.
    pub(crate) fn new(protocol: &Protocol) -> Self {
        let mut patterns: Vec<Vec<f64>> = Vec::new();
        let mut assign = |rows: ArrayView2<f64>| -> Vec<(u32, f64)> {
            rows.rows().into_iter().map(|row| find_or_add(&mut patterns, row)).collect()
        };
        let stimulations = assign(protocol.stimulations_a());
        let senses = assign(protocol.measurement_patterns());
        let mut index = HashMap::new();
        let mut products: Vec<Product> = Vec::new();
        for (datum, &[s, m]) in protocol.data().iter().enumerate() {
            let ((f, scale_f), (g, scale_g)) = (stimulations[s as usize], senses[m as usize]);
            let fields = [f.min(g), f.max(g)];
            let product = *index.entry(fields).or_insert_with(|| {
                products.push(Product { fields, data: Vec::new() });
                products.len() - 1
            });
            products[product].data.push((datum as u32, scale_f * scale_g));
        }
        let (chosen, combinations) = basis(&patterns);
        let basis = Array2::from_shape_fn((chosen.len(), protocol.electrodes()), |(r, e)| {
            patterns[chosen[r]][e]
        });
        let mut next = basis.nrows() as u32;
        let slots = combinations.iter().map(|c| {
            basis_field(c).unwrap_or_else(|| {
                next += 1;
                next - 1
            })
        });
        let slots = slots.collect();
        Self { basis, combinations, slots, stimulations, products }
    }

    /// Number of slots: the basis fields and the fields that are combinations of several.
    pub(crate) fn slot_count(&self) -> usize {
        let combined = self.combinations.iter().filter(|c| basis_field(c).is_none());
        self.basis.nrows() + combined.count()
    }

    /// Fills the rows, [slot, value] with `width` values each, of the combined fields from those of
    /// the basis fields. The values must be linear in the fields.
    pub(crate) fn combine(&self, rows: &mut [f64], width: usize) {
        let (basis, others) = rows.split_at_mut(width * self.basis.nrows());
        let combined = self.combinations.iter().filter(|c| basis_field(c).is_none());
        for (out, combination) in others.chunks_exact_mut(width).zip(combined) {
            out.fill(0.0);
            for &(solve, coefficient) in combination {
                let field = &basis[solve as usize * width..][..width];
                out.iter_mut().zip(field).for_each(|(o, b)| *o += coefficient * b);
            }
        }
    }
}

/// Returns the basis field that a combination equals, if any.
fn basis_field(combination: &[(u32, f64)]) -> Option<u32> {
    match combination {
        [(solve, 1.0)] => Some(*solve),
        _ => None,
    }
}

/// Returns the index of a pattern's field and the factor between them; adds the field if it is new.
fn find_or_add(patterns: &mut Vec<Vec<f64>>, row: ArrayView1<f64>) -> (u32, f64) {
    // scale by the largest entry first: the squares of tiny currents would underflow
    let largest = row.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let scaled: Vec<f64> = row.iter().map(|x| x / largest).collect();
    let length = dot(&scaled, &scaled).sqrt();
    let unit: Vec<f64> = scaled.iter().map(|x| x / length).collect();
    let norm = largest * length;
    for (index, known) in patterns.iter().enumerate() {
        let cosine = dot(known, &unit);
        // distance of unit vectors up to sign; 1 - |cosine| would lose half the digits
        let sign = cosine.signum();
        let distance = known.iter().zip(&unit).map(|(a, b)| (a - sign * b).powi(2)).sum::<f64>();
        if distance.sqrt() < DEPENDENT {
            return (index as u32, sign * norm);
        }
    }
    patterns.push(unit);
    (patterns.len() as u32 - 1, norm)
}

/// Pivoted Gram-Schmidt with reorthogonalisation. Returns the indices of independent patterns and
/// every pattern as a combination of them.
fn basis(patterns: &[Vec<f64>]) -> (Vec<usize>, Vec<Vec<(u32, f64)>>) {
    let mut rest: Vec<Vec<f64>> = patterns.to_vec();
    // coordinates of each pattern in the orthonormal directions found so far
    let mut coordinates: Vec<Vec<f64>> = vec![Vec::new(); patterns.len()];
    let mut directions: Vec<Vec<f64>> = Vec::new();
    let mut chosen = Vec::new();
    let limit = patterns.first().map_or(0, Vec::len);
    while directions.len() < limit {
        let norms: Vec<f64> = rest.iter().map(|r| dot(r, r).sqrt()).collect();
        // on ties take the first, so that adjacent patterns keep their order
        let best = (0..norms.len()).fold(0, |b, i| if norms[i] > norms[b] { i } else { b });
        if norms.is_empty() || norms[best] < DEPENDENT {
            break;
        }
        let mut direction: Vec<f64> = rest[best].iter().map(|x| x / norms[best]).collect();
        for known in &directions {
            let overlap = dot(known, &direction);
            direction.iter_mut().zip(known).for_each(|(d, k)| *d -= overlap * k);
        }
        let norm = dot(&direction, &direction).sqrt();
        direction.iter_mut().for_each(|d| *d /= norm);
        for (vector, known) in rest.iter_mut().zip(&mut coordinates) {
            let along = dot(vector, &direction);
            vector.iter_mut().zip(&direction).for_each(|(v, d)| *v -= along * d);
            known.push(along);
        }
        directions.push(direction);
        chosen.push(best);
    }
    let combinations = (0..patterns.len())
        .map(|p| match chosen.iter().position(|&c| c == p) {
            Some(solve) => vec![(solve as u32, 1.0)],
            None => combination(&coordinates, &chosen, &coordinates[p]),
        })
        .collect();
    (chosen, combinations)
}

/// Solves `sum_r c_r * coordinates[chosen[r]] = wanted`, which is lower triangular in the chosen
/// order.
fn combination(coordinates: &[Vec<f64>], chosen: &[usize], wanted: &[f64]) -> Vec<(u32, f64)> {
    let mut remainder = wanted.to_vec();
    let mut found = Vec::new();
    for (r, &pattern) in chosen.iter().enumerate().rev() {
        let c = remainder[r] / coordinates[pattern][r];
        for (rest, x) in remainder.iter_mut().zip(&coordinates[pattern]) {
            *rest -= c * x;
        }
        if c.abs() > DEPENDENT {
            found.push((r as u32, c));
        }
    }
    found.reverse();
    found
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PairPattern, PairProtocol};

    /// Every field equals its combination of basis patterns, and the counts match theory.
    fn check(protocol: &Protocol, solves: usize, products: usize) {
        let fields = Fields::new(protocol);
        assert_eq!((fields.basis.nrows(), fields.products.len()), (solves, products));
        for product in &fields.products {
            for &(datum, factor) in &product.data {
                let [s, m] = protocol.data()[datum as usize];
                let [f, g] = product.fields.map(|i| expand(&fields, i as usize));
                let stimulation = protocol.stimulations_a().row(s as usize).to_vec();
                let sense = protocol.measurement_patterns().row(m as usize).to_vec();
                // the measurement is linear in the outer product; 1e-12: rounding of 30 terms
                for i in 0..f.len() {
                    for j in 0..f.len() {
                        let symmetric = factor * (f[i] * g[j] + g[i] * f[j]);
                        let wanted = stimulation[i] * sense[j] + sense[i] * stimulation[j];
                        assert!((symmetric - wanted).abs() < 1e-12);
                    }
                }
            }
        }
    }

    fn expand(fields: &Fields, field: usize) -> Vec<f64> {
        let mut pattern = vec![0.0; fields.basis.ncols()];
        for &(solve, c) in &fields.combinations[field] {
            let row = fields.basis.row(solve as usize);
            pattern.iter_mut().zip(row).for_each(|(p, b)| *p += c * b);
        }
        pattern
    }

    #[test]
    fn adjacent_pairs_need_one_solve_less_than_electrodes() {
        check(&PairProtocol::default().protocol().unwrap(), 15, 104);
    }

    #[test]
    fn opposite_drives_share_fields_and_solves() {
        let opposite = PairProtocol { drive: PairPattern::Opposite, ..Default::default() };
        // 8 opposite and 16 adjacent fields, all within the 15-dimensional space of balanced
        // patterns
        check(&opposite.protocol().unwrap(), 15, 96);
    }

    #[test]
    fn one_drive_pair_needs_only_its_own_span() {
        let one = Protocol::from_quadruples(16, &[[0, 1, 4, 5], [0, 1, 5, 6]], 1e-3).unwrap();
        check(&one, 3, 2);
    }

    #[test]
    fn trigonometric_patterns_against_adjacent_measurements() {
        let angle = |e: usize| std::f64::consts::TAU * e as f64 / 16.0;
        let currents = Array2::from_shape_fn((16, 15), |(e, p)| {
            let k = (p / 2 + 1) as f64;
            if p % 2 == 0 { (k * angle(e)).cos() } else { (k * angle(e)).sin() }
        });
        let adjacent = Array2::from_shape_fn((16, 16), |(e, m)| {
            f64::from(u8::from(e == m)) - f64::from(u8::from(e == (m + 1) % 16))
        });
        let protocol = Protocol::from_patterns(currents.view(), adjacent.view()).unwrap();
        check(&protocol, 15, 240);
    }
}
