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

use eit_mesh::{Electrode, Surface};

/// One electrode: its parts as node lists, its potential's unknown, its impedance.
#[derive(Debug, Clone)]
pub(crate) struct Contact {
    parts: Vec<Part>,
    /// Unknown of the electrode potential; `None` for the grounded electrode.
    potential: Option<u32>,
    /// Ohm metre (rim) or ohm square metre (patch).
    impedance: f64,
}

#[derive(Debug, Clone)]
struct Part {
    nodes: Vec<u32>,
    measure: f64,
}

impl Contact {
    /// An electrode of a surface; `potential` is its unknown.
    pub fn new(
        surface: &Surface,
        electrode: &Electrode,
        impedance: f64,
        potential: Option<u32>,
    ) -> Self {
        let length = |e: &[u32; 2]| {
            let [a, b] = e.map(|n| surface.nodes()[n as usize]);
            (0..3).map(|k| (b[k] - a[k]).powi(2)).sum::<f64>().sqrt()
        };
        let parts = match electrode {
            Electrode::Rim(edges) => {
                edges.iter().map(|e| Part { nodes: e.to_vec(), measure: length(e) }).collect()
            }
            Electrode::Patch(triangles) => triangles
                .iter()
                .map(|&t| Part {
                    nodes: surface.triangles()[t as usize].to_vec(),
                    measure: surface.areas_m2()[t as usize],
                })
                .collect(),
        };
        Self { parts, potential, impedance }
    }

    /// The same electrode with renumbered nodes.
    pub fn renumbered(&self, new_from_old: &[u32]) -> Self {
        let mut contact = self.clone();
        for node in contact.parts.iter_mut().flat_map(|p| &mut p.nodes) {
            *node = new_from_old[*node as usize];
        }
        contact
    }

    /// Matrix terms ([unknown, unknown], value), each unordered pair once per part.
    pub fn terms(&self) -> Vec<([u32; 2], f64)> {
        let mut terms = Vec::new();
        for Part { nodes, measure } in &self.parts {
            let (count, scale) = (nodes.len() as f64, measure / self.impedance);
            // mean of a product of hat functions: 2 / (d (d+1)) on, 1 / (d (d+1)) off the diagonal
            let mass = scale / (count * (count + 1.0));
            for (k, &i) in nodes.iter().enumerate() {
                terms.push(([i, i], 2.0 * mass));
                terms.extend(nodes[..k].iter().map(|&j| ([i, j], mass)));
                terms.extend(self.potential.map(|u| ([u, i], -scale / count)));
            }
            terms.extend(self.potential.map(|u| ([u, u], scale)));
        }
        terms
    }
}
