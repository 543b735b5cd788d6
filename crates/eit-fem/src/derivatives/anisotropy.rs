//! Derivatives with respect to ratio and direction of the conductivity.
//!
//! A direction along with ratio `r` and the tensor `M` ([`crate::model::Anisotropy`]) is `M = exp Q` with
//! the traceless matrix `Q = ln(r) (d d' - n n') / 2`. Its derivatives are differences of two tensors,
//! exactly, because `M` is linear in `cos` and `sin` of twice the angle and in `sqrt(r)` and its inverse:
//!
//! ```text
//! dM along Q                = ( M(4 r) - M(r/4) ) / 3
//! dM along (d n' + n d')/2  = sinh(ln(r)/2)/ln(r) ( M(4, +45 degrees) - M(4, -45 degrees) ) / 1.5
//! ```
//!
//! The derivative of a voltage is `-u' dK u*` with the stiffness `dK` of `dM`: for `s` solves and a matrix
//! of `e` entries `4 s e` flops, plus `2 s^2` per node.

use super::solved_fields::SolvedFields;
use crate::error::FemError;
use crate::model::{Anisotropy, Grain};
use eit_core::vector::{along, cross, normal, unit};
use ndarray::ArrayViewMut2;

/// A derivative of the tensors: the difference of two sheets, times a factor of each element.
struct Change {
    more: Anisotropy,
    less: Anisotropy,
    factors: Vec<f64>,
}

/// Fills `jacobian`, [measurement, 2].
pub(crate) fn fill(
    solved: &SolvedFields<'_>,
    mut jacobian: ArrayViewMut2<'_, f64>,
) -> Result<(), FemError> {
    let Some(sheet) = &solved.geometry.anisotropy else { return Err(FemError::NoAnisotropy) };
    for (column, change) in [of_ratio(sheet), of_direction(solved, sheet)].into_iter().enumerate() {
        let Change { more, less, factors } = change;
        let conductivities = factors.iter().zip(solved.conductivity_s);
        let conductivities: Vec<f64> =
            conductivities.map(|(factor, sigma)| factor * sigma).collect();
        let mut matrix = stiffness(solved, more, &conductivities)?;
        let less = stiffness(solved, less, &conductivities)?;
        matrix.iter_mut().zip(&less).for_each(|(more, less)| *more -= less);
        let products = products(solved, &matrix);
        for (product, value) in solved.model.fields.products.iter().zip(products) {
            for &(datum, factor) in &product.data {
                jacobian[[datum as usize, column]] = -factor * value;
            }
        }
    }
    Ok(())
}

fn of_ratio(sheet: &Anisotropy) -> Change {
    let times = |factor: f64| sheet.map(|_, g| Grain { ratio: factor * g.ratio, ..*g });
    Change { more: times(4.0), less: times(0.25), factors: vec![1.0 / 3.0; sheet.elements()] }
}

fn of_direction(solved: &SolvedFields<'_>, sheet: &Anisotropy) -> Change {
    let dofs = &solved.model.dofs;
    let normal_of = |element: usize| {
        let nodes = &dofs.element_nodes[element * dofs.order.nodes()..];
        normal([0, 1, 2].map(|k| solved.geometry.positions[nodes[k] as usize]))
    };
    let turned = |sign: f64| {
        sheet.map(|element, grain| {
            let normal = unit(normal_of(element));
            let tangential = grain.within(normal);
            let direction = along(tangential, sign, cross(normal, tangential));
            Grain { ratio: 4.0, direction }
        })
    };
    let factor = |ratio: f64| {
        let half = 0.5 * ratio.ln();
        // sinh(x)/x is 1 to rounding below
        let mean = if half.abs() < 1e-8 { 1.0 } else { half.sinh() / half };
        mean / 3.0
    };
    Change { more: turned(1.0), less: turned(-1.0), factors: sheet.ratios().map(factor).collect() }
}

/// Matrix of a sheet of these conductivities, without contacts.
fn stiffness(
    solved: &SolvedFields<'_>,
    sheet: Anisotropy,
    conductivity_s: &[f64],
) -> Result<Vec<f64>, FemError> {
    let SolvedFields { model, geometry, .. } = solved;
    let mut geometry = (*geometry).clone().with_anisotropy(&model.dofs, sheet)?;
    geometry.leave_out_contacts();
    let mut values = vec![0.0; model.assembly.pattern.entries()];
    geometry.fill_matrix(&model.assembly, conductivity_s, &mut values);
    Ok(values)
}

/// `u' A u*` of each product of two fields.
fn products(solved: &SolvedFields<'_>, matrix: &[f64]) -> Vec<f64> {
    let (fields, potentials) = (&solved.model.fields, &solved.potentials);
    let (solves, unknowns) = (fields.basis.nrows(), solved.model.unknowns());
    let value = |unknown: usize, r: usize| {
        let at = unknown * solves + r;
        potentials.values[at] + potentials.low.map_or(0.0, |low| low[at])
    };
    let (mut x, mut product, mut size) =
        (vec![0.0; unknowns], vec![0.0; unknowns], vec![0.0; unknowns]);
    // [slot, solve]
    let mut rows = vec![0.0; fields.slot_count() * solves];
    for r in 0..solves {
        x.iter_mut().enumerate().for_each(|(unknown, x)| *x = value(unknown, r));
        solved.model.assembly.pattern.multiply(matrix, &x, &mut product, &mut size);
        for (unknown, y) in product.iter().enumerate() {
            for other in 0..solves {
                rows[other * solves + r] += value(unknown, other) * y;
            }
        }
    }
    fields.combine(&mut rows, solves);
    let product = |[f, g]: [u32; 2]| -> f64 {
        let row = &rows[fields.slots[f as usize] as usize * solves..][..solves];
        fields.combinations[g as usize].iter().map(|&(r, c)| c * row[r as usize]).sum()
    };
    fields.products.iter().map(|p| product(p.fields)).collect()
}
