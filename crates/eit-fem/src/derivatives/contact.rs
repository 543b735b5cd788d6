//! Derivatives with respect to contact impedances.
//!
//! The equation of an electrode's potential gives `U - u = z I / measure + (mu - u)`, where `mu` is
//! the mean potential of the skin under the electrode. The currents `I` are known, and the
//! deviations `mu - u` are computed from differences of potentials, so neither a large nor a small
//! `z` causes cancellation:
//!
//! ```text
//! dV/dz = factor ( I_f I_g / measure  +  integral of (mu_f - u_f)/z (mu_g - u_g)/z )
//! ```
//!
//! The mixed terms vanish because the deviations have mean zero.

use super::solved_fields::SolvedFields;
use crate::error::FemError;
use crate::model::contact::measure;
use ndarray::ArrayViewMut2;

/// Fields under one electrode.
pub(crate) struct ContactFields {
    /// Length (metres) or area (square metres) of the electrode.
    pub measure: f64,
    /// Length or area of each part (edge or triangle).
    pub measures: Vec<f64>,
    /// Number of corners of a part.
    corners: usize,
    /// [slot, 1 + part x corner]: the current of a field, then `mu - u` at the corners of each
    /// part.
    rows: Vec<f64>,
}

/// One field under an electrode.
#[derive(Clone, Copy)]
pub(crate) struct Under<'a> {
    /// Current into the skin.
    pub current: f64,
    /// `mu - u` at the corners of each part.
    deviations: &'a [f64],
    corners: usize,
}

impl<'a> Under<'a> {
    /// Returns the deviations at the corners of one part.
    pub(crate) fn part(&self, part: usize) -> &'a [f64] {
        &self.deviations[part * self.corners..][..self.corners]
    }
}

impl ContactFields {
    /// Gathers the fields of electrode `l`.
    pub(crate) fn new(solved: &SolvedFields<'_>, l: usize) -> Self {
        let (fields, contact) = (&solved.model.fields, &solved.model.dofs.contacts[l]);
        let parts = contact.parts();
        let measures: Vec<f64> =
            parts.iter().map(|nodes| measure(nodes, &solved.geometry.positions)).collect();
        let total: f64 = measures.iter().sum();
        // every electrode has a part, and all its parts are of one kind
        let corners = parts.first().map_or(0, Vec::len);
        let width = 1 + corners * parts.len();
        let solves = fields.basis.nrows();
        let mut rows = vec![0.0; width * fields.slot_count()];
        let high = |unknown: u32, r: usize| solved.potentials.values[unknown as usize * solves + r];
        let low = |unknown: u32, r: usize| {
            solved.potentials.low.map_or(0.0, |low| low[unknown as usize * solves + r])
        };
        let origin = parts.first().and_then(|nodes| nodes.first()).copied().unwrap_or(0);
        for (r, row) in rows.chunks_exact_mut(width).take(solves).enumerate() {
            row[0] = fields.basis[[r, l]];
            let relative = &mut row[1..];
            for (value, &node) in relative.iter_mut().zip(parts.iter().flatten()) {
                *value = (high(node, r) - high(origin, r)) + (low(node, r) - low(origin, r));
            }
            let means = relative.chunks_exact(corners).map(|u| u.iter().sum::<f64>());
            let integral: f64 = means.zip(&measures).map(|(sum, measure)| sum * measure).sum();
            let mean = integral / (corners as f64 * total);
            relative.iter_mut().for_each(|u| *u = mean - *u);
        }
        fields.combine(&mut rows, width);
        Self { measure: total, measures, corners, rows }
    }

    /// Returns a field by its index.
    pub(crate) fn field(&self, solved: &SolvedFields<'_>, field: u32) -> Under<'_> {
        let width = 1 + self.corners * self.measures.len();
        let slot = solved.model.fields.slots[field as usize] as usize;
        let row = &self.rows[slot * width..][..width];
        Under { current: row[0], deviations: &row[1..], corners: self.corners }
    }
}

/// Computes the mean of the product of two linear functions over an edge or triangle, from corner
/// values.
pub(crate) fn mean_product(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len() as f64;
    let products: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    (a.iter().sum::<f64>() * b.iter().sum::<f64>() + products) / (count * (count + 1.0))
}

/// Fills `jacobian`, [measurement, electrode].
pub(crate) fn fill(
    solved: &SolvedFields<'_>,
    mut jacobian: ArrayViewMut2<'_, f64>,
) -> Result<(), FemError> {
    let impedance = &solved.geometry.impedance;
    if let Some(l) = impedance.iter().position(|z| *z == 0.0 || z.is_infinite()) {
        return Err(FemError::ContactLimit { electrode: l + 1, value: impedance[l] });
    }
    for (l, z) in impedance.iter().enumerate() {
        let under = ContactFields::new(solved, l);
        for product in &solved.model.fields.products {
            let [f, g] = product.fields.map(|field| under.field(solved, field));
            let parts = under.measures.iter().enumerate();
            let deviations: f64 =
                parts.map(|(p, measure)| measure * mean_product(f.part(p), g.part(p))).sum();
            let value = f.current * g.current / under.measure + deviations / z / z;
            for &(datum, factor) in &product.data {
                jacobian[[datum as usize, l]] = factor * value;
            }
        }
    }
    Ok(())
}
