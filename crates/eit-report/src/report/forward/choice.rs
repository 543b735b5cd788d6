//! Chooses the cheapest mesh for an error.

use super::results::ForwardPoint;

/// Errors for which a mesh is chosen.
pub(super) const TARGETS: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// Returns the mesh and element order that take the least time for an error, among those accepted
/// by `is_tried`. A mesh counts only if every finer one on its curve also achieves the error: the
/// error of coarse meshes changes sign, so it may be small by chance.
pub(super) fn cheapest(
    points: &[ForwardPoint],
    target: f64,
    is_tried: impl Fn(&ForwardPoint) -> bool,
) -> Option<&ForwardPoint> {
    let tried = || points.iter().filter(|p| is_tried(p));
    let lasts = |point: &&ForwardPoint| {
        let finer = tried().filter(|p| p.curve() == point.curve() && p.nodes >= point.nodes);
        finer.fold(0.0, |most: f64, p| most.max(p.error)) <= target
    };
    tried().filter(lasts).min_by(|a, b| a.time.median_s.total_cmp(&b.time.median_s))
}

#[cfg(test)]
mod tests {
    use super::super::super::work_precision::Spread;
    use super::*;

    fn point(elements: &'static str, nodes: usize, values: [f64; 2]) -> ForwardPoint {
        let time = Spread::of(vec![values[0]], 1);
        ForwardPoint {
            elements,
            mesh: "even",
            edge_m: None,
            electrode_edge_m: None,
            nodes,
            triangles: 2 * nodes,
            unknowns: nodes,
            time,
            voltages_time: time,
            floor_s: 0.0,
            voltages_floor_s: 0.0,
            error: values[1],
        }
    }

    /// A lucky coarse mesh is not chosen.
    #[test]
    fn the_cheapest_stays_within_the_error_on_finer_meshes() {
        let points = [
            point("linear", 500, [1.0, 5e-4]),
            point("linear", 1000, [2.0, 3e-3]),
            point("linear", 2000, [4.0, 9e-4]),
            point("quadratic", 500, [3.0, 2e-4]),
            point("quadratic", 1000, [5.0, 2e-5]),
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
