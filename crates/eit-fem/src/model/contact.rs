//! Electrode terms of the complete electrode model in the system matrix.
//!
//! On an electrode with contact impedance `z` and potential `U`, the current density into the skin
//! is `(U - u) / z`. The energy, integrated over the electrode, is
//!
//! ```text
//! 1/z ( integral of u^2  -  2 U integral of u  +  U^2 measure )
//! ```
//!
//! and the total current `integral of (U - u) / z` is prescribed. (Cheng, Isaacson, Newell, Gisser
//! 1989; Somersalo, Cheney, Isaacson 1992.) For P1 elements the integrals over an edge of length
//! `h` are `h/3` (diagonal), `h/6`, `h/2`; over a triangle of area `A` they are `A/6`, `A/12`,
//! `A/3`. For quadratic elements, straight or curved, they are computed by quadrature.

use crate::element::linear::area_m2;
use crate::element::midside_nodes::MidsideNodes;
use crate::element::quadratic::{edge_points, triangle_points};
use eit_core::vector::distance;
use eit_mesh::{Electrode, Surface};

/// Largest number of nodes of a part: those of a quadratic triangle.
const MOST_NODES: usize = 6;

/// One electrode: the unknowns of its parts (edges or triangles) and of its potential.
#[derive(Debug, Clone)]
pub(crate) struct Contact {
    /// Whether the parts are triangles; otherwise they are edges.
    patch: bool,
    /// Nodes of each rim edge or triangle.
    parts: Vec<Vec<u32>>,
    /// Unknown of the electrode potential; `None` for the grounded electrode.
    potential: Option<u32>,
}

impl Contact {
    /// Creates the contact of an electrode on a surface; `potential` is the unknown of its
    /// potential.
    pub(crate) fn new(
        surface: &Surface,
        electrode: &Electrode,
        midside_nodes: &MidsideNodes,
        potential: Option<u32>,
    ) -> Self {
        let nodes = |corners: &[u32]| {
            let mut nodes = Vec::with_capacity(2 * corners.len());
            midside_nodes.extend(corners, &mut nodes);
            nodes
        };
        let (patch, parts) = match electrode {
            Electrode::Rim(edges) => (false, edges.iter().map(|e| nodes(e)).collect()),
            Electrode::Patch(triangles) => {
                let corners = triangles.iter().map(|&t| &surface.triangles()[t as usize]);
                (true, corners.map(|t| nodes(t)).collect())
            }
        };
        Self { patch, parts, potential }
    }

    /// Returns the same electrode with renumbered nodes.
    pub(crate) fn renumbered(&self, new_from_old: &[u32]) -> Self {
        let mut contact = self.clone();
        for node in contact.parts.iter_mut().flatten() {
            *node = new_from_old[*node as usize];
        }
        contact
    }

    /// Nodes of each rim edge or triangle.
    pub(crate) fn parts(&self) -> &[Vec<u32>] {
        &self.parts
    }

    /// Pairs of unknowns coupled by the electrode, in the order of [`Contact::values`].
    pub(crate) fn pairs(&self) -> Vec<[u32; 2]> {
        let mut pairs = Vec::new();
        for nodes in &self.parts {
            for (k, &i) in nodes.iter().enumerate() {
                pairs.push([i, i]);
                pairs.extend(nodes[..k].iter().map(|&j| [i, j]));
                pairs.extend(self.potential.map(|u| [u, i]));
            }
            pairs.extend(self.potential.map(|u| [u, u]));
        }
        pairs
    }

    /// Calls `visit` with the matrix values of all pairs, each unordered pair once per part.
    ///
    /// `positions` holds the position of each unknown that is a node, metres; `impedance` is in ohm
    /// metre (rim) or ohm square metre (patch).
    pub(crate) fn values(
        &self,
        positions: &[[f64; 3]],
        impedance: f64,
        mut visit: impl FnMut(f64),
    ) {
        for nodes in &self.parts {
            let part = self.integrals(nodes, positions, impedance);
            for k in 0..nodes.len() {
                visit(part.products[k][k]);
                part.products[k][..k].iter().for_each(|&mass| visit(mass));
                if self.potential.is_some() {
                    visit(-part.means[k]);
                }
            }
            if self.potential.is_some() {
                visit(part.measure);
            }
        }
    }

    fn integrals(&self, nodes: &[u32], positions: &[[f64; 3]], impedance: f64) -> Integrals {
        let place = |n: u32| positions[n as usize];
        match (self.patch, nodes) {
            (false, &[a, b, middle]) => {
                Integrals::of_points(edge_points([a, b, middle].map(place)), impedance)
            }
            (true, &[a, b, c, d, e, f]) => {
                Integrals::of_points(triangle_points([a, b, c, d, e, f].map(place)), impedance)
            }
            _ => Integrals::linear(nodes.len(), measure(nodes, positions) / impedance),
        }
    }
}

/// Integrals of shape functions over a part, divided by the impedance.
struct Integrals {
    products: [[f64; MOST_NODES]; MOST_NODES],
    means: [f64; MOST_NODES],
    measure: f64,
}

impl Integrals {
    /// Integrals of hat functions on an edge or triangle with `count` nodes; `scale` is its measure
    /// divided by the impedance.
    fn linear(count: usize, scale: f64) -> Self {
        let count = count as f64;
        // mean of a product of hat functions: 2 / (d (d+1)) on the diagonal, 1 / (d (d+1)) off it
        let mass = scale / (count * (count + 1.0));
        let mut products = [[mass; MOST_NODES]; MOST_NODES];
        (0..MOST_NODES).for_each(|k| products[k][k] = 2.0 * mass);
        Self { products, means: [scale / count; MOST_NODES], measure: scale }
    }

    /// Integrals of shape functions by quadrature, from their values at the points and each point's
    /// measure.
    fn of_points<const NODES: usize>(
        points: impl Iterator<Item = ([f64; NODES], f64)>,
        impedance: f64,
    ) -> Self {
        let mut part = Self {
            products: [[0.0; MOST_NODES]; MOST_NODES],
            means: [0.0; MOST_NODES],
            measure: 0.0,
        };
        for (values, measure) in points {
            let scale = measure / impedance;
            for (k, value) in values.iter().enumerate() {
                let products = part.products[k].iter_mut().zip(&values);
                products.for_each(|(product, other)| *product += scale * value * other);
                part.means[k] += scale * value;
            }
            part.measure += scale;
        }
        part
    }
}

/// Length of a straight edge, metres, or area of a triangle, square metres.
pub(crate) fn measure(nodes: &[u32], positions: &[[f64; 3]]) -> f64 {
    let place = |n: &u32| positions[*n as usize];
    match nodes {
        [a, b] => distance(place(a), place(b)),
        [a, b, c] => area_m2([place(a), place(b), place(c)]),
        // linear parts are edges or triangles
        _ => 0.0,
    }
}
