//! Fill-reducing elimination orders.
//!
//! Uses faer's approximate minimum degree (Amestoy, Davis, Duff 1996), and nested dissection by
//! coordinates for large graphs with coordinates.

mod nested_dissection;

use super::elimination_tree::postordered;
use super::error::SparseError;
use super::graph::Adjacency;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

/// Number of vertices from which nested dissection is tried. Below it, minimum degree needs less
/// work.
const LARGE: usize = 4_000;

/// Computes an elimination order, `new_from_old`, by minimum degree. If the graph is large and its
/// vertices have coordinates (`positions_m`, otherwise empty), also tries nested dissection with
/// minimum degree on the leaves, and returns the order that takes less work.
pub(crate) fn fill_reducing(
    graph: &Adjacency,
    positions_m: &[[f64; 3]],
) -> Result<Vec<u32>, SparseError> {
    let (whole, flops) = postordered(graph, &minimum_degree(graph)?);
    let count = graph.vertices();
    if count < LARGE || positions_m.len() != count {
        return Ok(whole);
    }
    let dissected = nested_dissection::order(graph, positions_m, minimum_degree)?;
    let (dissected, dissected_flops) = postordered(graph, &dissected);
    Ok(if dissected_flops < flops { dissected } else { whole })
}

fn minimum_degree(graph: &Adjacency) -> Result<Vec<u32>, SparseError> {
    let unknowns = graph.vertices();
    let too_large = SparseError::OutOfMemory { unknowns };
    let (mut old_from_new, mut new_from_old) = (vec![0u32; unknowns], vec![0u32; unknowns]);
    let (starts, neighbours) = (graph.starts(), graph.neighbours());
    let pattern =
        SymbolicSparseColMatRef::<u32>::new_checked(unknowns, unknowns, starts, None, neighbours);
    let scratch = amd::order_maybe_unsorted_scratch::<u32>(unknowns, neighbours.len());
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| too_large)?;
    amd::order_maybe_unsorted(
        &mut old_from_new,
        &mut new_from_old,
        pattern,
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .map_err(|_| too_large)?;
    Ok(new_from_old)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a square grid of 200 x 200 nodes, dissection must number every node once and take less
    /// work than minimum degree.
    #[test]
    fn large_meshes_are_dissected() {
        let side = 200;
        let at = |i: usize, j: usize| (i * side + j) as u32;
        let mut links = Vec::new();
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            let next = [(i + 1, j), (i, j + 1), (i + 1, j + 1)].into_iter();
            for (k, l) in next.filter(|(k, l)| *k < side && *l < side) {
                links.extend([(at(i, j), at(k, l)), (at(k, l), at(i, j))]);
            }
        }
        let graph = Adjacency::from_links(side * side, links);
        let places = (0..side).flat_map(|i| (0..side).map(move |j| [i as f64, 0.1, j as f64]));
        let places: Vec<[f64; 3]> = places.collect();
        let flops = |order: &[u32]| {
            let mut sorted = order.to_vec();
            sorted.sort_unstable();
            assert!(sorted.iter().zip(0..).all(|(a, b)| *a == b));
            postordered(&graph, order).1
        };
        let dissected = fill_reducing(&graph, &places).unwrap();
        let whole = fill_reducing(&graph, &[]).unwrap();
        assert!(flops(&dissected) < flops(&whole), "{} {}", flops(&dissected), flops(&whole));
        // all nodes at one point: nothing to cut along, but the order must still be valid
        let order = fill_reducing(&graph, &vec![[0.5; 3]; side * side]).unwrap();
        flops(&order);
    }
}
