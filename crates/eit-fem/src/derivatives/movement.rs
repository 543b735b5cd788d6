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
use crate::protocol::Product;
use eit_core::vector::{Vector, cross, dot, norm, scaled, sub};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
#[cfg(feature = "fabric")]
use ndarray::Array2;
use ndarray::ArrayViewMut2;

/// Elements per block: 16 fields x 2 components x 64 x 8 bytes = 16 KiB of gradients.
const BLOCK: usize = 64;
/// Derivatives along single coordinates that are held in memory at a time, or those of one product: 16 MB.
const HELD: usize = 1 << 21;
/// Displacements that are multiplied with them at a time.
const AT_ONCE: usize = 64;

/// Fills `jacobian`, [measurement, displacement], for validated displacements: the derivatives along each node that moves, times the
/// displacements. With `P` products of fields, `E` elements, `N` coordinates that move and `K` displacements, `30 P E + 2 P N K` flops.
pub(crate) fn fill(
    solved: &SolvedFields<'_>,
    displacements: &[Displacement],
    mut jacobian: ArrayViewMut2<'_, f64>,
) {
    let moves = Moves::new(solved, displacements);
    let rows = (HELD / moves.width).max(1);
    for products in solved.model.fields.products.chunks(rows) {
        let mut of_nodes = vec![0.0; products.len() * moves.width];
        add_elements(solved, &moves, products, &mut of_nodes);
        add_contacts(solved, &moves, products, &mut of_nodes);
        let of_nodes = MatRef::from_row_major_slice(&of_nodes, products.len(), moves.width);
        for (chunk, displacements) in displacements.chunks(AT_ONCE).enumerate() {
            let along = moves.vectors(solved, displacements);
            // derivative of the energy, [product, displacement]
            let mut sums = Mat::zeros(products.len(), displacements.len());
            matmul(sums.as_mut(), Accum::Replace, of_nodes, &along, 1.0, Par::Seq);
            for (product, sums) in products.iter().zip(sums.row_iter()) {
                for &(datum, factor) in &product.data {
                    for (k, sum) in sums.iter().enumerate() {
                        jacobian[[datum as usize, AT_ONCE * chunk + k]] = -factor * sum;
                    }
                }
            }
        }
    }
}

/// Coordinates that at least one displacement changes.
struct Moves {
    /// Column of each coordinate of each unknown that is a node; those that stay share the last one.
    columns: Vec<[usize; 3]>,
    width: usize,
}

impl Moves {
    fn new(solved: &SolvedFields<'_>, displacements: &[Displacement]) -> Self {
        let mut moves = vec![[false; 3]; solved.geometry.positions.len()];
        for &(node, vector) in displacements.iter().flat_map(Displacement::nodes) {
            let moves = &mut moves[unknown(solved, node)];
            (0..3).for_each(|k| moves[k] |= vector[k] != 0.0);
        }
        let last = moves.as_flattened().iter().filter(|moves| **moves).count();
        let mut next = 0;
        let mut column = |moves: bool| {
            next += usize::from(moves);
            if moves { next - 1 } else { last }
        };
        let columns = moves.into_iter().map(|moves| moves.map(&mut column)).collect();
        Self { columns, width: last + 1 }
    }

    fn any(&self, nodes: &[u32]) -> bool {
        let moves = |n: &u32| self.columns[*n as usize].iter().any(|&c| c + 1 < self.width);
        nodes.iter().any(moves)
    }

    /// Adds a vector for each of some nodes to a row of derivatives.
    fn add(&self, row: &mut [f64], node: u32, vector: Vector) {
        self.columns[node as usize].iter().zip(vector).for_each(|(&c, v)| row[c] += v);
    }

    /// Displacements as columns.
    fn vectors(&self, solved: &SolvedFields<'_>, displacements: &[Displacement]) -> Mat<f64> {
        let mut vectors = Mat::zeros(self.width, displacements.len());
        for (k, displacement) in displacements.iter().enumerate() {
            for &(node, vector) in displacement.nodes() {
                let columns = self.columns[unknown(solved, node)];
                columns.iter().zip(vector).for_each(|(&c, v)| vectors[(c, k)] += v);
            }
        }
        vectors
    }
}

fn unknown(solved: &SolvedFields<'_>, node: u32) -> usize {
    solved.model.dofs.unknown_of_node[node as usize] as usize
}

/// Derivative of the length of an edge or the area of a triangle along each of its corners.
fn stretch(solved: &SolvedFields<'_>, nodes: &[u32]) -> Vec<Vector> {
    let place = |n: u32| solved.geometry.positions[n as usize];
    match *nodes {
        [a, b] => {
            let e = sub(place(b), place(a));
            let towards = scaled(1.0 / norm(e), e);
            vec![scaled(-1.0, towards), towards]
        }
        [a, b, c] => {
            let corners = [a, b, c].map(place);
            let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
            let half = scaled(0.5 / norm(normal), normal);
            let of = |k: usize| cross(sub(corners[(k + 2) % 3], corners[(k + 1) % 3]), half);
            (0..3).map(|k| scaled(-1.0, of(k))).collect()
        }
        // parts are edges or triangles
        _ => Vec::new(),
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

/// Adds the derivatives of the energy of the triangles along their corners, [product, coordinate].
fn add_elements(
    solved: &SolvedFields<'_>,
    moves: &Moves,
    products: &[Product],
    of_nodes: &mut [f64],
) {
    let (triangles, _) = solved.model.dofs.element_nodes.as_chunks::<3>();
    let mut gradients = vec![0.0; solved.model.fields.slot_count() * 2 * BLOCK];
    let strained: Vec<usize> = (0..triangles.len()).filter(|&e| moves.any(&triangles[e])).collect();
    for elements in strained.chunks(BLOCK) {
        gather(solved, elements, &mut gradients);
        let strains: Vec<_> = elements.iter().map(|&e| strains(solved, e)).collect();
        for (product, row) in products.iter().zip(of_nodes.chunks_exact_mut(moves.width)) {
            for (i, (&e, [along, across])) in elements.iter().zip(&strains).enumerate() {
                let [f, g] = shear(solved, product.fields, &gradients, i);
                for (corner, &node) in triangles[e].iter().enumerate() {
                    let [along, across] = [along[corner], across[corner]];
                    moves.add(row, node, std::array::from_fn(|k| f * along[k] + g * across[k]));
                }
            }
        }
    }
}

/// Derivatives of [`strain`] of a triangle along its corners, times its conductivity.
fn strains(solved: &SolvedFields<'_>, element: usize) -> [[Vector; 3]; 2] {
    let (triangles, _) = solved.model.dofs.element_nodes.as_chunks::<3>();
    let corners = triangles[element].map(|n| solved.geometry.positions[n as usize]);
    let grain = solved.geometry.anisotropy.as_ref();
    let grain = grain.map(|anisotropy| &anisotropy.grains()[element]);
    let mut strains = [[[0.0; 3]; 3]; 2];
    for (corner, k) in (0..9).map(|i| (i / 3, i % 3)) {
        let mut vectors = [[0.0; 3]; 3];
        vectors[corner][k] = solved.conductivity_s[element];
        let [along, across] = strain(corners, vectors, grain);
        (strains[0][corner][k], strains[1][corner][k]) = (along, across);
    }
    strains
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

/// Adds the derivatives of the energy of the contacts along the corners of their parts.
fn add_contacts(
    solved: &SolvedFields<'_>,
    moves: &Moves,
    products: &[Product],
    of_nodes: &mut [f64],
) {
    for (electrode, contact) in solved.model.dofs.contacts.iter().enumerate() {
        if !contact.parts().iter().any(|nodes| moves.any(nodes)) {
            continue;
        }
        let stretches: Vec<_> =
            contact.parts().iter().map(|nodes| stretch(solved, nodes)).collect();
        let under = ContactFields::new(solved, electrode);
        let z = solved.geometry.impedance[electrode];
        for (product, row) in products.iter().zip(of_nodes.chunks_exact_mut(moves.width)) {
            let [f, g] = product.fields.map(|field| under.field(solved, field));
            for (part, (nodes, stretch)) in contact.parts().iter().zip(&stretches).enumerate() {
                let density = density(f, g, part, z, under.measure);
                let corners = nodes.iter().zip(stretch);
                corners.for_each(|(&node, s)| moves.add(row, node, scaled(density, *s)));
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
