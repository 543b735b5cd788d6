//! The cheapest mesh for an error.

use super::results::{ForwardPoint, OURS};

/// Errors that a mesh is chosen for.
pub(super) const TARGETS: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// The mesh and kind of elements that take the least time for an error, of those that `is_tried`
/// tells. A mesh counts only if every finer one of its curve has the error as well: errors of
/// coarse meshes cross zero, and a good one may be luck.
pub(super) fn cheapest(
    points: &[ForwardPoint],
    target: f64,
    is_tried: impl Fn(&ForwardPoint) -> bool,
) -> Option<&ForwardPoint> {
    let ours = || points.iter().filter(|p| p.solver == OURS && is_tried(p));
    let lasts = |point: &&ForwardPoint| {
        let finer = ours().filter(|p| p.curve() == point.curve() && p.nodes >= point.nodes);
        finer.fold(0.0, |most: f64, p| most.max(p.error)) <= target
    };
    ours().filter(lasts).min_by(|a, b| a.time.median_s.total_cmp(&b.time.median_s))
}

#[cfg(test)]
mod tests {
    use super::super::super::work_precision::Spread;
    use super::*;

    fn point(solver: &str, elements: &'static str, nodes: usize, values: [f64; 2]) -> ForwardPoint {
        let time = Spread::of(vec![values[0]], 1);
        ForwardPoint {
            solver: solver.to_owned(),
            elements,
            mesh: "even",
            edge_m: None,
            electrode_edge_m: None,
            nodes,
            triangles: 2 * nodes,
            unknowns: nodes,
            time,
            voltages_time: None,
            floor_s: 0.0,
            voltages_floor_s: 0.0,
            error: values[1],
        }
    }

    /// Luck on a coarse mesh is not chosen, nor a peer.
    #[test]
    fn the_cheapest_stays_within_the_error_on_finer_meshes() {
        let points = [
            point(OURS, "linear", 500, [1.0, 5e-4]),
            point("peer", "linear", 500, [0.1, 5e-4]),
            point(OURS, "linear", 1000, [2.0, 3e-3]),
            point(OURS, "linear", 2000, [4.0, 9e-4]),
            point(OURS, "quadratic", 500, [3.0, 2e-4]),
            point(OURS, "quadratic", 1000, [5.0, 2e-5]),
        ];
        let nodes = |target, elements: &str| {
            let found =
                cheapest(&points, target, |p| elements.is_empty() || p.elements == elements);
            found.map(|p| (p.elements, p.nodes))
        };
        assert_eq!(nodes(1e-2, ""), Some(("linear", 500)));
        assert_eq!(nodes(1e-3, ""), Some(("quadratic", 500)));
        assert_eq!(nodes(1e-3, "linear"), Some(("linear", 2000)));
        assert_eq!(nodes(1e-4, ""), Some(("quadratic", 1000)));
        assert_eq!(nodes(1e-4, "linear"), None);
    }
}
