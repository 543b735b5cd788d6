//! Derivatives along displacements of the nodes.
//!
//! Let `D` be the gradient of the displacement in the plane of a triangle. With nodal values fixed,
//! `grad u` changes by `-D' grad u` and the area by `area trace D`, so
//!
//! ```text
//! d(area grad f . grad g) = area grad f . (trace S - 2 S) grad g,     S = (D + D') / 2
//! ```
//!
//! The matrix `trace S - 2 S` has trace zero, so two numbers per triangle describe it. The
//! gradients are those of the Jacobian, in the frame of the first edge ([`crate::element`]). An
//! electrode part of measure `m` contributes `m/z mean (U - u)(U* - u*)`, with `U - u = z I /
//! measure + (mu - u)` as in [`super::contact`].

use super::contact::{ContactFields, Under, mean_product};
use super::displacement::Displacement;
use super::solved_fields::SolvedFields;
use crate::element::gradient::gradient;
use crate::model::Grain;
use eit_core::vector::{Vector, cross, dot, norm, scaled, sub};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
#[cfg(feature = "fabric")]
use ndarray::Array2;
use ndarray::{ArrayViewMut2, Axis};

/// Elements per block: 16 fields x 2 components x 64 x 8 bytes = 16 KiB of gradients.
const BLOCK: usize = 64;

/// Displacements whose strains are held in memory at a time: 1 kB a triangle.
const AT_ONCE: usize = 64;

/// Change of the length or area of one part of an electrode by one displacement.
struct Stretch {
    electrode: u32,
    part: u32,
    displacement: u32,
    change: f64,
}

/// Fills `jacobian`, [measurement, displacement], for validated displacements.
pub(crate) fn fill(
    solved: &SolvedFields<'_>,
    displacements: &[Displacement],
    mut jacobian: ArrayViewMut2<'_, f64>,
) {
    let columns = jacobian.axis_chunks_iter_mut(Axis(1), AT_ONCE);
    for (displacements, columns) in displacements.chunks(AT_ONCE).zip(columns) {
        fill_some(solved, displacements, columns);
    }
}

fn fill_some(
    solved: &SolvedFields<'_>,
    displacements: &[Displacement],
    mut jacobian: ArrayViewMut2<'_, f64>,
) {
    let products = &solved.model.fields.products;
    let count = displacements.len();
    // [element][component][displacement]: conductivity times S22 - S11 and -2 S12
    let mut strains = vec![0.0; 2 * count * solved.conductivity_s.len()];
    let mut is_strained = vec![false; solved.conductivity_s.len()];
    let mut stretches = Vec::new();
    let mut moves = Moves::new(solved);
    for (index, displacement) in displacements.iter().enumerate() {
        moves.set(solved, displacement);
        moves.strains(solved, |element, [along, across]| {
            is_strained[element] = true;
            strains[2 * element * count + index] = along;
            strains[(2 * element + 1) * count + index] = across;
        });
        moves.stretches(solved, index as u32, &mut stretches);
    }
    let strained: Vec<usize> = (0..is_strained.len()).filter(|&e| is_strained[e]).collect();
    // derivative of the energy, [product, displacement]
    let mut sums = vec![0.0; products.len() * count];
    add_elements(solved, &strained, &strains, &mut sums);
    add_contacts(solved, &mut stretches, count, &mut sums);
    for (index, product) in products.iter().enumerate() {
        let sums = &sums[index * count..][..count];
        for &(datum, factor) in &product.data {
            let row = jacobian.row_mut(datum as usize);
            row.into_iter().zip(sums).for_each(|(entry, sum)| *entry = -factor * sum);
        }
    }
}

/// Displacement of each unknown that is a node, and whether it moves.
struct Moves {
    vectors: Vec<Vector>,
    moved: Vec<bool>,
}

impl Moves {
    fn new(solved: &SolvedFields<'_>) -> Self {
        let nodes = solved.geometry.positions.len();
        Self { vectors: vec![[0.0; 3]; nodes], moved: vec![false; nodes] }
    }

    fn set(&mut self, solved: &SolvedFields<'_>, displacement: &Displacement) {
        self.vectors.fill([0.0; 3]);
        self.moved.fill(false);
        for &(node, vector) in displacement.nodes() {
            let unknown = solved.model.dofs.unknown_of_node[node as usize] as usize;
            self.vectors[unknown].iter_mut().zip(vector).for_each(|(sum, v)| *sum += v);
            self.moved[unknown] = true;
        }
    }

    fn any(&self, nodes: &[u32]) -> bool {
        nodes.iter().any(|&n| self.moved[n as usize])
    }

    fn strains(&self, solved: &SolvedFields<'_>, mut put: impl FnMut(usize, [f64; 2])) {
        let (triangles, _) = solved.model.dofs.element_nodes.as_chunks::<3>();
        for (element, (triangle, sigma)) in triangles.iter().zip(solved.conductivity_s).enumerate()
        {
            if !self.any(triangle) {
                continue;
            }
            let corners = triangle.map(|n| solved.geometry.positions[n as usize]);
            let vectors = triangle.map(|n| self.vectors[n as usize]);
            let grain = solved.geometry.anisotropy.as_ref();
            let grain = grain.map(|anisotropy| &anisotropy.grains()[element]);
            put(element, strain(corners, vectors, grain).map(|s| sigma * s));
        }
    }

    fn stretches(
        &self,
        solved: &SolvedFields<'_>,
        displacement: u32,
        stretches: &mut Vec<Stretch>,
    ) {
        for (electrode, contact) in (0u32..).zip(&solved.model.dofs.contacts) {
            for (part, nodes) in (0u32..).zip(contact.parts()) {
                if self.any(nodes) {
                    let change = self.stretch(solved, nodes);
                    stretches.push(Stretch { electrode, part, displacement, change });
                }
            }
        }
    }

    /// Computes the change of the length of an edge or the area of a triangle.
    fn stretch(&self, solved: &SolvedFields<'_>, nodes: &[u32]) -> f64 {
        let place = |n: u32| solved.geometry.positions[n as usize];
        let vector = |n: u32| self.vectors[n as usize];
        let edge = |a: u32, b: u32| (sub(place(b), place(a)), sub(vector(b), vector(a)));
        match *nodes {
            [a, b] => {
                let (e, w) = edge(a, b);
                dot(e, w) / norm(e)
            }
            [a, b, c] => {
                let ((e1, w1), (e2, w2)) = (edge(a, b), edge(a, c));
                let normal = cross(e1, e2);
                0.5 * (dot(normal, cross(w1, e2)) + dot(normal, cross(e1, w2))) / norm(normal)
            }
            // parts are edges or triangles
            _ => 0.0,
        }
    }
}

/// Derivatives with respect to `S22 - S11` and `-2 S12` of each triangle ([`strain`]), [product, 2 triangle + component], for
/// the first measurement of each product.
#[cfg(feature = "fabric")]
pub(crate) fn shears(solved: &SolvedFields<'_>) -> Array2<f64> {
    let fields = &solved.model.fields;
    let elements: Vec<usize> = (0..solved.conductivity_s.len()).collect();
    let mut jacobian = Array2::zeros((fields.products.len(), 2 * elements.len()));
    let mut gradients = vec![0.0; fields.slot_count() * 2 * BLOCK];
    for elements in elements.chunks(BLOCK) {
        gather(solved, elements, &mut gradients);
        for (product, mut row) in fields.products.iter().zip(jacobian.rows_mut()) {
            let factor = product.data.first().map_or(0.0, |first| first.1);
            for (i, &e) in elements.iter().enumerate() {
                let scale = -factor * solved.conductivity_s[e];
                let shear = shear(solved, product.fields, &gradients, i);
                (0..2).for_each(|k| row[2 * e + k] = scale * shear[k]);
            }
        }
    }
    jacobian
}

/// The products of two fields that a shear of the `i`th gathered triangle changes.
fn shear(solved: &SolvedFields<'_>, of: [u32; 2], gradients: &[f64], i: usize) -> [f64; 2] {
    let slots = &solved.model.fields.slots;
    let [f, g] = of.map(|field| {
        let at = slots[field as usize] as usize * 2 * BLOCK + i;
        [gradients[at], gradients[at + BLOCK]]
    });
    [f[0] * g[0] - f[1] * g[1], f[0] * g[1] + f[1] * g[0]]
}

/// Computes `S22 - S11` and `-2 S12` of a triangle whose corners move, in the frame of its first
/// edge; of an anisotropic one after its map ([`Grain::mapped`]).
pub(crate) fn strain(
    corners: [Vector; 3],
    vectors: [Vector; 3],
    grain: Option<&Grain>,
) -> [f64; 2] {
    let mut edges = [1, 2].map(|k| sub(corners[k], corners[0]));
    let mut moves = [1, 2].map(|k| sub(vectors[k], vectors[0]));
    if let Some(grain) = grain {
        (edges, moves) = (grain.mapped(edges), grain.mapped_moves(edges, moves));
    }
    let ([e1, e2], [w1, w2]) = (edges, moves);
    let normal = cross(e1, e2);
    let (l, double_area) = (norm(e1), norm(normal));
    let first = scaled(1.0 / l, e1);
    let second = scaled(1.0 / double_area, cross(normal, first));
    let (c, h) = (dot(e2, first), double_area / l);
    // derivatives of the displacement along the two axes
    let d1 = scaled(1.0 / l, w1);
    let d2: Vector = std::array::from_fn(|k| (w2[k] - c * d1[k]) / h);
    [dot(second, d2) - dot(first, d1), -(dot(first, d2) + dot(second, d1))]
}

/// Adds the contributions of the strained triangles, a product of matrices for each block.
fn add_elements(solved: &SolvedFields<'_>, strained: &[usize], strains: &[f64], sums: &mut [f64]) {
    let fields = &solved.model.fields;
    let products = fields.products.len();
    let count = sums.len() / products.max(1);
    let mut gradients = vec![0.0; fields.slot_count() * 2 * BLOCK];
    let mut of_products = vec![0.0; products * 2 * BLOCK];
    let mut of_block = vec![0.0; 2 * BLOCK * count];
    let mut sums = MatMut::from_row_major_slice_mut(sums, products, count);
    for elements in strained.chunks(BLOCK) {
        gather(solved, elements, &mut gradients);
        let width = 2 * elements.len();
        for (product, out) in fields.products.iter().zip(of_products.chunks_exact_mut(width)) {
            for (i, out) in out.chunks_exact_mut(2).enumerate() {
                out.copy_from_slice(&shear(solved, product.fields, &gradients, i));
            }
        }
        for (&e, out) in elements.iter().zip(of_block.chunks_exact_mut(2 * count)) {
            out.copy_from_slice(&strains[2 * e * count..][..2 * count]);
        }
        let of_products =
            MatRef::from_row_major_slice(&of_products[..products * width], products, width);
        let of_block = MatRef::from_row_major_slice(&of_block[..width * count], width, count);
        matmul(sums.as_mut(), Accum::Add, of_products, of_block, 1.0, Par::Seq);
    }
}

/// Computes scaled gradients, [slot, component, element], of the given elements.
fn gather(solved: &SolvedFields<'_>, elements: &[usize], gradients: &mut [f64]) {
    let fields = &solved.model.fields;
    let solves = fields.basis.nrows();
    let (triangles, _) = solved.model.dofs.element_nodes.as_chunks::<3>();
    let (coefficients, _) = solved.geometry.elements.as_chunks::<3>();
    for (i, &e) in elements.iter().enumerate() {
        let element = &coefficients[e];
        let rows = |values: &[f64], r: usize| triangles[e].map(|n| values[n as usize * solves + r]);
        for (r, out) in gradients.chunks_exact_mut(2 * BLOCK).take(solves).enumerate() {
            let [mut x, mut y] = gradient(element, rows(solved.potentials.values, r));
            if let Some(low) = solved.potentials.low {
                let [dx, dy] = gradient(element, rows(low, r));
                (x, y) = (x + dx, y + dy);
            }
            (out[i], out[BLOCK + i]) = (x, y);
        }
    }
    fields.combine(gradients, 2 * BLOCK);
}

/// Adds the contributions of the stretched electrode parts.
fn add_contacts(
    solved: &SolvedFields<'_>,
    stretches: &mut [Stretch],
    count: usize,
    sums: &mut [f64],
) {
    stretches.sort_by_key(|s| s.electrode);
    for stretches in stretches.chunk_by(|a, b| a.electrode == b.electrode) {
        let electrode = stretches[0].electrode as usize;
        let under = ContactFields::new(solved, electrode);
        let z = solved.geometry.impedance[electrode];
        let products = &solved.model.fields.products;
        for (product, sums) in products.iter().zip(sums.chunks_exact_mut(count)) {
            let [f, g] = product.fields.map(|field| under.field(solved, field));
            for stretch in stretches {
                let density = density(f, g, stretch.part as usize, z, under.measure);
                sums[stretch.displacement as usize] += stretch.change * density;
            }
        }
    }
}

/// Mean of `(U - u)(U* - u*) / z` over a part. It is zero for a shunt. For an ideal current source
/// the term in which both fields carry current is left out: such measurements have no finite
/// voltage.
fn density(f: Under<'_>, g: Under<'_>, part: usize, z: f64, measure: f64) -> f64 {
    let mean = |u: &[f64]| u.iter().sum::<f64>() / u.len() as f64;
    let (df, dg) = (f.part(part), g.part(part));
    let [jf, jg] = [f.current / measure, g.current / measure];
    let carried = if z.is_infinite() { 0.0 } else { z * jf * jg };
    let deviating = if z == 0.0 { 0.0 } else { mean_product(df, dg) / z };
    let mixed = if z == 0.0 { 0.0 } else { jf * mean(dg) + jg * mean(df) };
    carried + mixed + deviating
}
