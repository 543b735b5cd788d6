//! Complete electrode model: what an electrode adds to the system matrix.
//!
//! On an electrode of contact impedance `z` the current density into the skin is `(U - u) / z`,
//! with the electrode's potential `U`. Its energy, integrated over the electrode, is
//!
//! ```text
//! 1/z ( integral of u^2  -  2 U integral of u  +  U^2 measure )
//! ```
//!
//! and the total current `integral of (U - u) / z` is the prescribed one. (Cheng, Isaacson,
//! Newell, Gisser 1989; Somersalo, Cheney, Isaacson 1992.) For P1 elements the integrals over an
//! edge of length `h` are `h/3` (diagonal), `h/6`, `h/2`; over a triangle of area `A` they are
//! `A/6`, `A/12`, `A/3`.

use crate::element::area_m2;
use eit_mesh::{Electrode, Surface};

/// One electrode: its parts as lists of unknowns, and its potential's unknown.
#[derive(Debug, Clone)]
pub(crate) struct Contact {
    /// Ends of rim edges, or corners of triangles.
    parts: Vec<Vec<u32>>,
    /// Unknown of the electrode potential; `None` for the grounded electrode.
    potential: Option<u32>,
}

impl Contact {
    /// An electrode of a surface; `potential` is its unknown.
    pub fn new(surface: &Surface, electrode: &Electrode, potential: Option<u32>) -> Self {
        let parts = match electrode {
            Electrode::Rim(edges) => edges.iter().map(|e| e.to_vec()).collect(),
            Electrode::Patch(triangles) => {
                triangles.iter().map(|&t| surface.triangles()[t as usize].to_vec()).collect()
            }
        };
        Self { parts, potential }
    }

    /// The same electrode with renumbered nodes.
    pub fn renumbered(&self, new_from_old: &[u32]) -> Self {
        let mut contact = self.clone();
        for node in contact.parts.iter_mut().flatten() {
            *node = new_from_old[*node as usize];
        }
        contact
    }

    /// Ends of rim edges, or corners of triangles.
    pub fn parts(&self) -> &[Vec<u32>] {
        &self.parts
    }

    /// Pairs of unknowns that the electrode joins, in the order of [`Contact::values`].
    pub fn pairs(&self) -> Vec<[u32; 2]> {
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

    /// Hands the matrix values of all pairs to `visit`, each unordered pair once per part.
    ///
    /// `positions` holds the place of each unknown that is a node, metres; `impedance` is in ohm
    /// metre (rim) or ohm square metre (patch).
    pub fn values(&self, positions: &[[f64; 3]], impedance: f64, mut visit: impl FnMut(f64)) {
        for nodes in &self.parts {
            let (count, scale) = (nodes.len() as f64, measure(nodes, positions) / impedance);
            // mean of a product of hat functions: 2 / (d (d+1)) on, 1 / (d (d+1)) off the diagonal
            let mass = scale / (count * (count + 1.0));
            for k in 0..nodes.len() {
                visit(2.0 * mass);
                (0..k).for_each(|_| visit(mass));
                if self.potential.is_some() {
                    visit(-scale / count);
                }
            }
            if self.potential.is_some() {
                visit(scale);
            }
        }
    }
}

/// Length of an edge, metres, or area of a triangle, square metres.
pub(crate) fn measure(nodes: &[u32], positions: &[[f64; 3]]) -> f64 {
    let place = |n: &u32| positions[*n as usize];
    match nodes {
        [a, b] => {
            let (a, b) = (place(a), place(b));
            (0..3).map(|k| (b[k] - a[k]).powi(2)).sum::<f64>().sqrt()
        }
        [a, b, c] => area_m2([place(a), place(b), place(c)]),
        // parts are edges or triangles
        _ => 0.0,
    }
}
