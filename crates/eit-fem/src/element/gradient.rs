//! Scaled gradients and stiffness, computed from an element's coefficients; see [`crate::element`].

/// Index of the pair of nodes `i < j` among all pairs; coefficient `a_ci` is stored at `pair(i, c +
/// 1)`.
#[inline(always)]
pub(crate) const fn pair(i: usize, j: usize) -> usize {
    j * (j - 1) / 2 + i
}

/// Computes the scaled gradient of nodal values.
#[inline(always)]
pub(crate) fn gradient<const NODES: usize, const PAIRS: usize, const COMPONENTS: usize>(
    coefficients: &[f64; PAIRS],
    u: [f64; NODES],
) -> [f64; COMPONENTS] {
    std::array::from_fn(|c| {
        let term = |i: usize| coefficients[pair(i, c + 1)] * (u[i + 1] - u[0]);
        (1..=c).fold(term(0), |sum, i| sum + term(i))
    })
}

/// Computes the off-diagonal stiffness entries for unit conductivity, in the order of [`pair`].
/// Each diagonal entry is minus the sum of the other entries of its row.
pub(crate) fn stiffness<const NODES: usize, const PAIRS: usize>(
    coefficients: &[f64; PAIRS],
) -> [f64; PAIRS] {
    // component c of a node's shape function, i.e. the columns of `gradient`
    let component = |node: usize, c: usize| match node {
        0 => -(0..=c).map(|i| coefficients[pair(i, c + 1)]).sum::<f64>(),
        _ => coefficients[pair(node - 1, c + 1)],
    };
    let mut entries = [0.0; PAIRS];
    for j in 1..NODES {
        for i in 0..j {
            // components before j - 1 of node j are zero
            let products = (j - 1..NODES - 1).map(|c| component(i, c) * component(j, c));
            entries[pair(i, j)] = products.sum();
        }
    }
    entries
}

/// Iterates over the pairs of an element's nodes: distinct nodes in the order of [`pair`], then
/// each node with itself.
pub(crate) fn node_pairs(nodes: &[u32]) -> impl Iterator<Item = [u32; 2]> {
    let different = (1..nodes.len()).flat_map(move |j| (0..j).map(move |i| [nodes[i], nodes[j]]));
    different.chain(nodes.iter().map(|&n| [n, n]))
}
