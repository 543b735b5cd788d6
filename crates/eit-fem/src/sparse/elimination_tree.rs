//! Elimination tree: parents, column counts and postorder.

use super::graph::Adjacency;

/// Parent of a root: no column.
pub(super) const NONE: u32 = u32::MAX;

/// Turns a fill-reducing order into a postorder, which keeps subtrees contiguous. Returns
/// `new_from_old` and the floating-point operations of a factorisation in that order.
pub(super) fn postordered(graph: &Adjacency, new_from_old: &[u32]) -> (Vec<u32>, f64) {
    let count = new_from_old.len();
    let mut links = Vec::with_capacity(graph.neighbours().len() / 2);
    for old in 0..count {
        let new = new_from_old[old];
        let others = graph.list(old).iter().map(|&o| new_from_old[o as usize]);
        links.extend(others.filter(|other| *other < new).map(|other| (new, other)));
    }
    let earlier = Adjacency::from_links(count, links);
    let parents = parents(&earlier);
    let counts = counts(&earlier, &parents);
    let mut places = vec![0u32; count];
    for (place, column) in (0u32..).zip(postorder(&parents, &counts)) {
        places[column as usize] = place;
    }
    let flops = counts.iter().map(|&below| (f64::from(below) + 1.0).powi(2)).sum();
    (new_from_old.iter().map(|&new| places[new as usize]).collect(), flops)
}

/// Computes the parent of each column in the elimination tree (Liu 1986, with path compression).
pub(super) fn parents(earlier: &Adjacency) -> Vec<u32> {
    let count = earlier.vertices();
    let (mut parents, mut ancestors) = (vec![NONE; count], vec![NONE; count]);
    for k in 0..count {
        for &start in earlier.list(k) {
            let mut i = start;
            while i != NONE && i != k as u32 {
                let next = std::mem::replace(&mut ancestors[i as usize], k as u32);
                if next == NONE {
                    parents[i as usize] = k as u32;
                }
                i = next;
            }
        }
    }
    parents
}

/// Counts the entries below the diagonal of each column of the factor.
pub(super) fn counts(earlier: &Adjacency, parents: &[u32]) -> Vec<u32> {
    let (mut counts, mut seen) = (vec![0u32; parents.len()], vec![NONE; parents.len()]);
    for k in 0..parents.len() {
        seen[k] = k as u32;
        for &start in earlier.list(k) {
            let mut i = start as usize;
            while seen[i] != k as u32 {
                seen[i] = k as u32;
                counts[i] += 1;
                i = parents[i] as usize;
            }
        }
    }
    counts
}

/// Postorder: children before parents, each subtree contiguous, the heaviest child next to its
/// parent.
pub(super) fn postorder(parents: &[u32], weights: &[u32]) -> Vec<u32> {
    let count = parents.len();
    let mut by_parent: Vec<u32> = (0..count as u32).collect();
    by_parent.sort_by_key(|&i| (parents[i as usize], weights[i as usize], i));
    let mut starts = vec![0usize; count + 1];
    parents.iter().filter(|p| **p != NONE).for_each(|&p| starts[p as usize + 1] += 1);
    (0..count).for_each(|k| starts[k + 1] += starts[k]);
    let roots = &by_parent[starts[count]..];
    let mut order = Vec::with_capacity(count);
    // this visits parents before children, last child first; the postorder is the reverse
    let mut waiting: Vec<u32> = roots.to_vec();
    while let Some(i) = waiting.pop() {
        order.push(i);
        waiting.extend(&by_parent[starts[i as usize]..starts[i as usize + 1]]);
    }
    order.reverse();
    order
}
