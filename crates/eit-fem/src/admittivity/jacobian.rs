//! Adjoint Jacobian with respect to complex admittivity: the real kernel with two planes per
//! component.
//!
//! ```text
//! dV/dgamma_e = -integral over e of grad u_stimulation . grad u_measurement     (no conjugate)
//! ```
//!
//! Real and imaginary parts of the gradients are stored separately, so that products of fields use
//! whole registers; they are interleaved when a row is stored. 16 flops per product (real: 3), 16
//! bytes per value.

use crate::element::gradient::gradient;
use crate::model::ForwardModel;
use ndarray::ArrayViewMut2;
use num_complex::Complex64;

/// Elements per block: 16 fields x 4 planes x 128 x 8 bytes = 64 KiB of gradients.
const BLOCK: usize = 128;

/// Stride between the planes of a field: eight more than a block, as in the real kernel.
const STRIDE: usize = BLOCK + 8;

/// Planes per field: two components, real and imaginary parts.
const PLANES: usize = 4;

/// Working memory for one block.
#[derive(Clone)]
pub(super) struct Block {
    /// Scaled gradients, [slot, plane, element]; see `Fields::slots`.
    gradients: Vec<f64>,
    /// One product of fields: real part, imaginary part.
    product: [Vec<f64>; 2],
}

impl Block {
    /// Number of gradient values, and that needed for a model.
    pub(crate) fn sizes(&self, model: &ForwardModel) -> [usize; 2] {
        [self.gradients.len(), Self::size_for(model)]
    }

    fn size_for(model: &ForwardModel) -> usize {
        model.fields.slot_count() * PLANES * STRIDE
    }

    /// Allocates the memory for a model.
    pub(crate) fn new(model: &ForwardModel) -> Self {
        Self {
            gradients: vec![0.0; Self::size_for(model)],
            product: [vec![0.0; BLOCK], vec![0.0; BLOCK]],
        }
    }
}

/// Planes of a slot: x real, x imaginary, y real, y imaginary.
fn planes(gradients: &[f64], slot: u32, count: usize) -> [&[f64]; PLANES] {
    std::array::from_fn(|p| &gradients[(slot as usize * PLANES + p) * STRIDE..][..count])
}

/// Fills `jacobian`, [measurement, element], from potentials, [unknown, solve].
pub(super) fn fill(
    model: &ForwardModel,
    potentials: &[Complex64],
    block: &mut Block,
    mut jacobian: ArrayViewMut2<'_, Complex64>,
) {
    let slots = &model.fields.slots;
    for start in (0..model.elements()).step_by(BLOCK) {
        let count = BLOCK.min(model.elements() - start);
        gradients(model, potentials, start, count, &mut block.gradients);
        model.fields.combine(&mut block.gradients, PLANES * STRIDE);
        for product in &model.fields.products {
            let [f, g] =
                product.fields.map(|field| planes(&block.gradients, slots[field as usize], count));
            let [re, im] = &mut block.product;
            multiply(f, g, &mut re[..count], &mut im[..count]);
            for &(datum, factor) in &product.data {
                let mut row = jacobian.row_mut(datum as usize);
                let values = re[..count].iter().zip(&im[..count]);
                let scaled = values.map(|(re, im)| Complex64::new(factor * re, factor * im));
                match row.as_slice_mut() {
                    Some(row) => {
                        row[start..start + count].iter_mut().zip(scaled).for_each(|(o, v)| *o = v);
                    }
                    None => scaled.enumerate().for_each(|(i, v)| row[start + i] = v),
                }
            }
        }
    }
}

/// Computes minus the product of two gradients.
fn multiply(f: [&[f64]; PLANES], g: [&[f64]; PLANES], re: &mut [f64], im: &mut [f64]) {
    let count = re.len();
    let ([fx, fxi, fy, fyi], [gx, gxi, gy, gyi]) = (f.map(|p| &p[..count]), g.map(|p| &p[..count]));
    let im = &mut im[..count];
    for i in 0..count {
        re[i] = (fxi[i] * gxi[i] - fx[i] * gx[i]) + (fyi[i] * gyi[i] - fy[i] * gy[i]);
        im[i] = -((fx[i] * gxi[i] + fxi[i] * gx[i]) + (fy[i] * gyi[i] + fyi[i] * gy[i]));
    }
}

/// Computes the scaled gradients of the basis fields on one block.
fn gradients(
    model: &ForwardModel,
    potentials: &[Complex64],
    start: usize,
    count: usize,
    out: &mut [f64],
) {
    let solves = model.fields.basis.nrows();
    let row = |unknown: u32| &potentials[unknown as usize * solves..][..solves];
    let (triangles, _) = model.dofs.element_nodes.as_chunks::<3>();
    let (coefficients, _) = model.geometry.elements.as_chunks::<3>();
    let elements = triangles[start..start + count].iter().zip(&coefficients[start..]);
    for (i, (triangle, element)) in elements.enumerate() {
        let u = triangle.map(row);
        for r in 0..solves {
            let [x, y] = gradient(element, u.map(|u| u[r].re));
            let [xi, yi] = gradient(element, u.map(|u| u[r].im));
            for (p, value) in [x, xi, y, yi].into_iter().enumerate() {
                out[(PLANES * r + p) * STRIDE + i] = value;
            }
        }
    }
}
