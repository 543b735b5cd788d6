//! Adjoint Jacobian with respect to conductivity.
//!
//! Elements are processed in blocks whose scaled gradients stay in the second-level cache. Each
//! product of two fields is computed once and written to every measurement that is a multiple of it
//! (reciprocal measurements: half of the rows). For 208 rows and `e` elements: 3 flops for each of
//! 104 e products (9 for quadratic elements), and 208 e values of 8 bytes written. The stores limit
//! the speed.
//!
//! Measured on the discs of the benches with linear elements, one thread (Xeon with 2 MiB
//! second-level cache), shortest of many runs, memory reused:
//!
//! | elements | Jacobian | this module | writing a constant to the same memory |
//! |---|---|---|---|
//! | 3 932 (6.5 MB) | 0.80 ms | 0.61 ms, 11 GB/s | 0.29 ms, 22 GB/s |
//! | 40 222 (67 MB) | 15.2 ms | 12.1 ms, 5.5 GB/s | 8.0 ms, 8.4 GB/s |
//!
//! Gathering and combining gradients take 0.11 and 1.4 ms of this, so ordering the triangles for
//! locality could gain 2 %. Blocks of 128 and 512 elements are 10 % and 3 % slower.

use super::solved_fields::{Potentials, SolvedFields};
use crate::element::ElementOrder;
use crate::element::gradient::gradient;
use crate::model::ForwardModel;
use ndarray::ArrayViewMut2;
use std::ops::Range;

/// Elements per block: 16 fields x 2 components x 256 x 8 bytes = 64 KiB of gradients (160 KiB for
/// the 5 components of quadratic elements). Rows are written in runs of half a page.
const BLOCK: usize = 256;

/// Stride between the components of a field. It is eight more than a block; with a stride of
/// exactly one block, all fields of an element would map to two of the sixty-four sets of a
/// first-level cache.
const STRIDE: usize = BLOCK + 8;

/// Working memory for one block.
#[derive(Clone)]
pub(crate) struct Block {
    /// Scaled gradients, [slot, component, element]; see `Fields::slots`.
    gradients: Vec<f64>,
    /// One product of fields.
    product: Vec<f64>,
}

impl Block {
    /// Number of gradient values, and that needed for a model.
    pub(crate) fn sizes(&self, model: &ForwardModel) -> [usize; 2] {
        [self.gradients.len(), Self::size_for(model)]
    }

    fn size_for(model: &ForwardModel) -> usize {
        model.fields.slot_count() * model.dofs.order.components() * STRIDE
    }

    /// Allocates the memory for a model.
    pub(crate) fn new(model: &ForwardModel) -> Self {
        Self { gradients: vec![0.0; Self::size_for(model)], product: vec![0.0; BLOCK] }
    }
}

/// Ranges of the components of a slot.
fn components<const COMPONENTS: usize>(slot: u32) -> [Range<usize>; COMPONENTS] {
    std::array::from_fn(|c| {
        let at = (slot as usize * COMPONENTS + c) * STRIDE;
        at..at + BLOCK
    })
}

/// Number type of [`Solution::unique_jacobian`](crate::Solution::unique_jacobian): `f64` or `f32`.
/// Sealed.
pub trait JacobianValue: private::Narrow + Copy + Default {}

impl JacobianValue for f64 {}
impl JacobianValue for f32 {}

mod private {
    pub trait Narrow {
        fn narrow(value: f64) -> Self;
    }

    impl Narrow for f64 {
        fn narrow(value: f64) -> Self {
            value
        }
    }

    impl Narrow for f32 {
        fn narrow(value: f64) -> Self {
            value as Self
        }
    }
}

/// Fills `jacobian`, [measurement, element].
pub(crate) fn fill(
    solved: &SolvedFields<'_>,
    block: &mut Block,
    mut jacobian: ArrayViewMut2<'_, f64>,
) {
    each_product(solved, block, |index, start, values| {
        for &(datum, factor) in &solved.model.fields.products[index].data {
            write(&mut jacobian, datum as usize, start, factor, values);
        }
    });
}

/// Fills `jacobian`, [product, element], with the row of the first measurement of each product.
pub(crate) fn fill_unique<T: JacobianValue>(
    solved: &SolvedFields<'_>,
    block: &mut Block,
    mut jacobian: ArrayViewMut2<'_, T>,
) {
    each_product(solved, block, |index, start, values| {
        // every product has at least one measurement
        let factor = solved.model.fields.products[index].data.first().map_or(0.0, |first| first.1);
        write(&mut jacobian, index, start, factor, values);
    });
}

/// Writes scaled values into a row, starting at element `start`.
fn write<T: JacobianValue>(
    jacobian: &mut ArrayViewMut2<'_, T>,
    row: usize,
    start: usize,
    factor: f64,
    values: &[f64],
) {
    let mut row = jacobian.row_mut(row);
    match row.as_slice_mut() {
        Some(row) => {
            for (entry, value) in row[start..start + values.len()].iter_mut().zip(values) {
                *entry = T::narrow(factor * value);
            }
        }
        None => {
            let entries = row.iter_mut().skip(start);
            entries.zip(values).for_each(|(entry, value)| *entry = T::narrow(factor * value));
        }
    }
}

/// Calls `take` for every product of fields on every block, with the product's index, the first
/// element and the values.
fn each_product(
    solved: &SolvedFields<'_>,
    block: &mut Block,
    take: impl FnMut(usize, usize, &[f64]),
) {
    match solved.model.dofs.order {
        ElementOrder::Linear => each_product_of::<3, 3, 2>(solved, block, take),
        ElementOrder::Quadratic => each_product_of::<6, 15, 5>(solved, block, take),
    }
}

/// [`each_product`] for elements of `NODES` nodes, `PAIRS` coefficients and `COMPONENTS` components.
fn each_product_of<const NODES: usize, const PAIRS: usize, const COMPONENTS: usize>(
    solved: &SolvedFields<'_>,
    block: &mut Block,
    mut take: impl FnMut(usize, usize, &[f64]),
) {
    let SolvedFields { model, geometry, potentials, .. } = solved;
    let (nodes, _) = model.dofs.element_nodes.as_chunks::<NODES>();
    let (coefficients, _) = geometry.elements.as_chunks::<PAIRS>();
    for start in (0..model.elements()).step_by(BLOCK) {
        let count = BLOCK.min(model.elements() - start);
        let (nodes, coefficients) =
            (&nodes[start..start + count], &coefficients[start..start + count]);
        let (solves, gradients) = (model.fields.basis.nrows(), &mut block.gradients);
        fill_gradients::<NODES, PAIRS, COMPONENTS>(
            nodes,
            coefficients,
            *potentials,
            solves,
            gradients,
        );
        model.fields.combine(&mut block.gradients, COMPONENTS * STRIDE);
        for (index, product) in model.fields.products.iter().enumerate() {
            let [f, g] = product.fields.map(|field| {
                let slot = model.fields.slots[field as usize];
                components::<COMPONENTS>(slot).map(|c| &block.gradients[c])
            });
            let values = &mut block.product[..count];
            for (i, value) in values.iter_mut().enumerate() {
                let first = f[0][i] * g[0][i];
                *value = -(1..COMPONENTS).fold(first, |sum, c| sum + f[c][i] * g[c][i]);
            }
            take(index, start, values);
        }
    }
}

/// Computes the scaled gradients of the basis fields on one block of elements, given by their nodes
/// and coefficients.
fn fill_gradients<const NODES: usize, const PAIRS: usize, const COMPONENTS: usize>(
    nodes: &[[u32; NODES]],
    coefficients: &[[f64; PAIRS]],
    potentials: Potentials<'_>,
    solves: usize,
    out: &mut [f64],
) {
    let place = |r: usize, c: usize, i: usize| (COMPONENTS * r + c) * STRIDE + i;
    for (i, (nodes, element)) in nodes.iter().zip(coefficients).enumerate() {
        let u = nodes.map(|n| &potentials.values[n as usize * solves..][..solves]);
        for r in 0..solves {
            let g: [f64; COMPONENTS] = gradient(element, u.map(|u| u[r]));
            (0..COMPONENTS).for_each(|c| out[place(r, c, i)] = g[c]);
        }
        let Some(low) = potentials.low else { continue };
        let u = nodes.map(|n| &low[n as usize * solves..][..solves]);
        for r in 0..solves {
            let g: [f64; COMPONENTS] = gradient(element, u.map(|u| u[r]));
            (0..COMPONENTS).for_each(|c| out[place(r, c, i)] += g[c]);
        }
    }
}
