//! What was mended, for people.

use super::same_sense;
use crate::Surface;
use crate::surface::middle;
use std::fmt;

/// Triangles below this [quality](Surface::triangle_quality) are mentioned as slivers: angles
/// below a degree or so. The forward solve loses about as many digits as the worst is below one.
const SLIVER: f64 = 0.02;

/// What was mended in a mesh from a file, and what else its user should know.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Repairs {
    /// Nodes that lay at the place of another one and became one with it. In an STL file every
    /// triangle brings its own corners: there all of them, and no note is made of it.
    pub merged_nodes: usize,
    /// Distance up to which nodes are at one place, metres.
    pub merge_distance_m: f64,
    /// Nodes that lie at the place of another one and were kept: where a Gmsh mesh hangs
    /// together without them being one, they are a cut in the skin.
    pub coincident_nodes: usize,
    /// Nodes that no triangle uses: dropped.
    pub dropped_nodes: usize,
    /// Triangles with two corners on one node, or of the same nodes as another: dropped.
    pub dropped_triangles: usize,
    /// Triangles that ran against the others: turned.
    pub turned_triangles: usize,
    /// Triangles so flat that they cost digits: kept.
    pub slivers: usize,
    /// The flattest: index, centroid in metres, [quality](Surface::triangle_quality).
    pub worst: Option<(usize, [f64; 3], f64)>,
    /// Whether every triangle of the file brings its own corners.
    pub(crate) unshared: bool,
}

impl Repairs {
    /// One line for each thing that its user should know; none for a clean mesh.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let within = format!("(within {:.1e} m)", self.merge_distance_m);
        let counted = [
            (
                if self.unshared { 0 } else { self.merged_nodes },
                format!("nodes at the place of another one {within} were merged with it"),
            ),
            (
                self.coincident_nodes,
                format!(
                    "nodes lie at the place of another one {within} and were kept apart: the skin \
                     is cut there; if it is not, merge them"
                ),
            ),
            (self.dropped_nodes, "nodes belong to no triangle and were dropped".to_owned()),
            (
                self.dropped_triangles,
                "triangles were collapsed or repeated and were dropped".to_owned(),
            ),
            (self.turned_triangles, "triangles ran against the others and were turned".to_owned()),
        ];
        for (count, what) in counted {
            if count > 0 {
                notes.push(format!("{count} {what}"));
            }
        }
        if let (Some((triangle, at, quality)), 1..) = (self.worst, self.slivers) {
            notes.push(format!(
                "{} triangles are slivers; the flattest, triangle {triangle} at {at:?}, has the \
                 quality {quality:.1e}: voltages may lose digits, mesh the surface anew",
                self.slivers
            ));
        }
        notes
    }

    /// Looks at the finished surface: turned triangles and slivers.
    pub(crate) fn inspect(&mut self, surface: &Surface, before: &[[u32; 3]]) {
        let turned = |(a, b): &(&[u32; 3], &[u32; 3])| !same_sense(**a, **b);
        let turned = surface.triangles().iter().zip(before).filter(turned).count();
        // a file that is consistent in itself may look away from +z: nothing was wrong with it
        self.turned_triangles = turned.min(before.len() - turned);
        for triangle in 0..surface.triangles().len() {
            let quality = surface.triangle_quality(triangle);
            self.slivers += usize::from(quality < SLIVER);
            if self.worst.is_none_or(|worst| quality < worst.2) {
                self.worst = Some((triangle, middle(&surface.corners(triangle)), quality));
            }
        }
    }
}

impl fmt::Display for Repairs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.notes().join("\n"))
    }
}
