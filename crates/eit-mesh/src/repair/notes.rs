//! A summary of repairs, with notes for the user.

use super::same_sense;
use crate::Surface;
use crate::surface::middle;
use std::fmt;

/// Triangles below this [quality](Surface::triangle_quality) are reported as slivers: they have
/// angles below about a degree. The forward solve loses about as many digits as the worst quality
/// is orders of magnitude below one.
const SLIVER: f64 = 0.02;

/// Repairs made to a mesh from a file, and other facts that its user should know.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Repairs {
    /// Nodes merged with another one at the same position. In an STL file each triangle has its own
    /// corners, so this counts all shared ones, and [`Repairs::notes`] omits it.
    pub merged_nodes: usize,
    /// Distance up to which nodes are at the same position, metres.
    pub merge_distance_m: f64,
    /// Nodes at the position of another one that were kept: if a Gmsh mesh is connected without
    /// merging them, they form a cut in the skin.
    pub coincident_nodes: usize,
    /// Nodes dropped because no triangle uses them.
    pub dropped_nodes: usize,
    /// Triangles dropped because two corners are one node, or because another triangle has the same
    /// nodes.
    pub dropped_triangles: usize,
    /// Triangles reversed because their orientation differed from the others'.
    pub turned_triangles: usize,
    /// Triangles so flat that they reduce accuracy; they are kept.
    pub slivers: usize,
    /// The triangle of lowest quality: index, centroid in metres,
    /// [quality](Surface::triangle_quality).
    pub worst: Option<(usize, [f64; 3], f64)>,
    /// Whether every triangle of the file has its own corners.
    pub(crate) unshared: bool,
}

impl Repairs {
    /// Returns one line for each fact that the user should know; empty for a clean mesh.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let within = format!("(within {:.1e} m)", self.merge_distance_m);
        let counted = [
            (
                if self.unshared { 0 } else { self.merged_nodes },
                format!("nodes at the position of another one {within} were merged with it"),
            ),
            (
                self.coincident_nodes,
                format!(
                    "nodes are at the position of another one {within} and were kept separate: the \
                     skin is cut there; if it should not be, merge them"
                ),
            ),
            (self.dropped_nodes, "nodes belong to no triangle and were dropped".to_owned()),
            (self.dropped_triangles, "collapsed or repeated triangles were dropped".to_owned()),
            (
                self.turned_triangles,
                "triangles were oriented against the others and were reversed".to_owned(),
            ),
        ];
        for (count, what) in counted {
            if count > 0 {
                notes.push(format!("{count} {what}"));
            }
        }
        if let (Some((triangle, at, quality)), 1..) = (self.worst, self.slivers) {
            notes.push(format!(
                "{} triangles are slivers; the worst, triangle {triangle} at {at:?}, has a quality \
                 of {quality:.1e}: voltages may lose accuracy; remesh the surface",
                self.slivers
            ));
        }
        notes
    }

    /// Counts reversed triangles and slivers of the finished surface.
    pub(crate) fn inspect(&mut self, surface: &Surface, before: &[[u32; 3]]) {
        let turned = |(a, b): &(&[u32; 3], &[u32; 3])| !same_sense(**a, **b);
        let turned = surface.triangles().iter().zip(before).filter(turned).count();
        // a file that is consistent but faces away from +z is not at fault
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
