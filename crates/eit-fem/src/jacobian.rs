//! The adjoint Jacobian with respect to conductivity.
//!
//! Elements are taken in blocks whose scaled gradients stay in the second-level cache. Each
//! product of two fields is formed once and written to every measurement that is a multiple of it
//! (reciprocal ones: half of the rows). For 208 rows and `e` elements: 3 flops for each of 104 e
//! products, 208 e values written, 8 bytes each. The stores are the floor.
//!
//! Measured on the discs of the benches, one thread (Xeon with 2 MiB second-level cache), the
//! shortest of many runs, memory reused:
//!
//! | elements | Jacobian | this module | the same memory set to a constant |
//! |---|---|---|---|
//! | 3 932 (6.5 MB) | 0.80 ms | 0.61 ms, 11 GB/s | 0.29 ms, 22 GB/s |
//! | 40 222 (67 MB) | 15.2 ms | 12.1 ms, 5.5 GB/s | 8.0 ms, 8.4 GB/s |
//!
//! Gathering and combining gradients take 0.11 and 1.4 ms of it, so ordering the triangles for
//! locality could gain 2 %. Blocks of 128 and 512 elements are 10 and 3 % slower.

use crate::fields::basis_field;
use crate::forward::ForwardModel;
use crate::geometry::Geometry;
use ndarray::ArrayViewMut2;
use std::ops::Range;

/// Elements per block: 16 fields x 2 components x 256 x 8 bytes = 64 KiB of gradients, and rows
/// are written in runs of half a page.
const BLOCK: usize = 256;

/// Values from one component of a field to the next. Eight more than a block, or all fields of
/// one element would fall into two of the sixty-four sets of a first-level cache.
const STRIDE: usize = BLOCK + 8;

/// Potentials [unknown, solve], and what the accurate path has beyond their last digit.
#[derive(Clone, Copy)]
pub(crate) struct Potentials<'a> {
    pub values: &'a [f64],
    pub low: Option<&'a [f64]>,
}

/// Memory of one block.
pub(crate) struct Block {
    /// Scaled gradients [slot, component, element]; see `Fields::slots`.
    gradients: Vec<f64>,
    /// One product of fields.
    product: Vec<f64>,
}

impl Block {
    /// Number of values in the memory.
    pub fn size(&self) -> usize {
        self.gradients.len()
    }

    /// [`Block::size`] of the memory for a model.
    pub fn size_for(model: &ForwardModel) -> usize {
        model.fields.slot_count() * 2 * STRIDE
    }

    /// Memory for a model.
    pub fn new(model: &ForwardModel) -> Self {
        Self { gradients: vec![0.0; Self::size_for(model)], product: vec![0.0; BLOCK] }
    }
}

/// The two components of a slot.
fn components(slot: u32) -> [Range<usize>; 2] {
    let at = slot as usize * 2 * STRIDE;
    [at..at + BLOCK, at + STRIDE..at + STRIDE + BLOCK]
}

/// Fills `jacobian` [measurement, element] from potentials [unknown, solve].
pub(crate) fn fill(
    model: &ForwardModel,
    geometry: &Geometry,
    potentials: Potentials<'_>,
    block: &mut Block,
    mut jacobian: ArrayViewMut2<'_, f64>,
) {
    for start in (0..model.elements()).step_by(BLOCK) {
        let count = BLOCK.min(model.elements() - start);
        gradients(model, (geometry, potentials), start, count, &mut block.gradients);
        combine(model, &mut block.gradients);
        for product in &model.fields.products {
            let [[fx, fy], [gx, gy]] = product.fields.map(|field| {
                components(model.fields.slots[field as usize]).map(|c| &block.gradients[c])
            });
            let values = &mut block.product[..count];
            for (i, value) in values.iter_mut().enumerate() {
                *value = -(fx[i] * gx[i] + fy[i] * gy[i]);
            }
            for &(datum, factor) in &product.data {
                let mut row = jacobian.row_mut(datum as usize);
                match row.as_slice_mut() {
                    Some(row) => scale_into(factor, values, &mut row[start..start + count]),
                    None => {
                        (0..count).for_each(|i| row[start + i] = factor * values[i]);
                    }
                }
            }
        }
    }
}

fn scale_into(factor: f64, values: &[f64], row: &mut [f64]) {
    for (entry, value) in row.iter_mut().zip(values) {
        *entry = factor * value;
    }
}

/// Scaled gradients of the basis fields on one block.
fn gradients(
    model: &ForwardModel,
    (geometry, potentials): (&Geometry, Potentials<'_>),
    start: usize,
    count: usize,
    out: &mut [f64],
) {
    let solves = model.fields.basis.nrows();
    let row = |unknown: u32| &potentials.values[unknown as usize * solves..][..solves];
    let low = |unknown: u32| potentials.low.map(|low| &low[unknown as usize * solves..][..solves]);
    for i in 0..count {
        let element = geometry.elements[start + i];
        let [u0, u1, u2] = model.triangles[start + i].map(row);
        for r in 0..solves {
            let [x, y] = element.gradient([u0[r], u1[r], u2[r]]);
            out[2 * STRIDE * r + i] = x;
            out[2 * STRIDE * r + STRIDE + i] = y;
        }
        if let [Some(u0), Some(u1), Some(u2)] = model.triangles[start + i].map(low) {
            for r in 0..solves {
                let [x, y] = element.gradient([u0[r], u1[r], u2[r]]);
                out[2 * STRIDE * r + i] += x;
                out[2 * STRIDE * r + STRIDE + i] += y;
            }
        }
    }
}

/// The fields of one block that are not basis fields, as combinations of those.
fn combine(model: &ForwardModel, gradients: &mut [f64]) {
    let fields = &model.fields;
    let (basis, others) = gradients.split_at_mut(2 * STRIDE * fields.basis.nrows());
    let combined = fields.combinations.iter().filter(|c| basis_field(c).is_none());
    for (out, combination) in others.chunks_exact_mut(2 * STRIDE).zip(combined) {
        out.fill(0.0);
        for &(solve, coefficient) in combination {
            let field = &basis[solve as usize * 2 * STRIDE..][..2 * STRIDE];
            for (o, b) in out.iter_mut().zip(field) {
                *o += coefficient * b;
            }
        }
    }
}
