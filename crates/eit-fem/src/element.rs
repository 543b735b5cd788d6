//! Elements: scaled gradients and stiffness of linear and quadratic triangles.
//!
//! The energy of an element of `n` nodes vanishes for constants only: it is a sum of `n - 1` squares.
//! Its components, the scaled gradient of nodal values `u`, are
//!
//! ```text
//! g_c = sum over i <= c of a_ci (u_(i+1) - u_0),   c = 0 .. n - 2
//! ```
//!
//! so that an element of conductivity `sigma` contributes `sigma g(u) . g(w)` to the energy, and
//! `-g(u) . g(w)` is its Jacobian entry. The `n (n - 1) / 2` coefficients of an element serve
//! assembly and Jacobian, on flat and curved skins alike.
//!
//! **Linear**, 3 nodes and 3 coefficients. In the triangle's own plane let `e1 = p1 - p0` lie on the
//! first axis, `l = |e1|`, and let `e2 = p2 - p0 = (c, h)`. The gradient of nodal values `u`, times
//! the square root of the area `A = l h / 2`, is
//!
//! ```text
//! g = sqrt(A) grad u = ( alpha (u1 - u0),  beta (u2 - u0) - gamma (u1 - u0) )
//! alpha = sqrt(A) / l,   beta = sqrt(A) / h,   gamma = sqrt(A) c / (h l)
//! ```
//!
//! (Linear triangle: any finite element text, for example Hughes, The Finite Element Method, section
//! 3.) **Quadratic**, 6 nodes and 15 coefficients: module [`quadratic`](crate::quadratic).

/// The kind of finite elements: how potentials run inside a triangle.
///
/// Conductivity is one value per triangle with either.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Elements {
    /// Linear potentials, three nodes, straight edges (P1).
    #[default]
    Linear,
    /// Quadratic potentials, six nodes (P2). Edges follow the curve that the mesh knows
    /// ([`Mesh::midpoint_m`](eit_mesh::Mesh::midpoint_m)) as parabolas through its middle. Solved in
    /// `f64` only, with contact impedances above zero and finite.
    Quadratic,
}

impl Elements {
    /// Nodes of one element.
    pub(crate) fn nodes(self) -> usize {
        match self {
            Self::Linear => 3,
            Self::Quadratic => 6,
        }
    }

    /// Components of a scaled gradient.
    pub(crate) fn components(self) -> usize {
        self.nodes() - 1
    }

    /// Pairs of different nodes: coefficients of an element, and its off-diagonal stiffness.
    pub(crate) fn pairs(self) -> usize {
        self.nodes() * (self.nodes() - 1) / 2
    }
}

/// Place of the pair of nodes `i < j` among all pairs; coefficient `a_ci` stands at `pair(i, c + 1)`.
#[inline(always)]
pub(crate) const fn pair(i: usize, j: usize) -> usize {
    j * (j - 1) / 2 + i
}

/// Coefficients of a linear triangle, dimensionless: `alpha`, `-gamma`, `beta`.
pub(crate) fn linear(corners: [[f64; 3]; 3]) -> [f64; 3] {
    let edge = |k: usize| sub(corners[k], corners[0]);
    let (e1, e2) = (edge(1), edge(2));
    let l = dot(e1, e1).sqrt();
    let double_area = norm(cross(e1, e2));
    let h = double_area / l;
    let root = (0.5 * double_area).sqrt();
    [root / l, -(root * dot(e1, e2) / (l * l * h)), root / h]
}

/// Scaled gradient of nodal values.
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

/// Off-diagonal stiffness entries for unit conductivity, in the order of [`pair`]; the diagonal is
/// minus the sum of its row.
pub(crate) fn stiffness<const NODES: usize, const PAIRS: usize>(
    coefficients: &[f64; PAIRS],
) -> [f64; PAIRS] {
    // component c of the shape function of a node: columns of the map above
    let component = |node: usize, c: usize| match node {
        0 => -(0..=c).map(|i| coefficients[pair(i, c + 1)]).sum::<f64>(),
        _ => coefficients[pair(node - 1, c + 1)],
    };
    let mut entries = [0.0; PAIRS];
    for j in 1..NODES {
        for i in 0..j {
            // node j has no components before j - 1
            let products = (j - 1..NODES - 1).map(|c| component(i, c) * component(j, c));
            entries[pair(i, j)] = products.sum();
        }
    }
    entries
}

/// Area of a triangle, square metres.
pub(crate) fn area_m2(corners: [[f64; 3]; 3]) -> f64 {
    0.5 * norm(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])))
}

pub(crate) fn sub(b: [f64; 3], a: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| b[i] - a[i])
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stiffness_of_the_right_triangle_is_the_textbook_one() {
        let k = stiffness::<3, 3>(&linear([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
        // exact numbers, a few roundings
        for (found, wanted) in k.iter().zip([-0.5, -0.5, 0.0]) {
            assert!((found - wanted).abs() < 4.0 * f64::EPSILON);
        }
    }

    #[test]
    fn gradient_of_a_linear_function_on_a_tilted_triangle() {
        let corners = [[0.1, 0.2, 0.3], [1.0, -0.4, 0.5], [0.3, 0.9, -0.7]];
        let slope = [0.7, -1.1, 0.4];
        let u = corners.map(|p| dot(p, slope));
        let g: [f64; 2] = gradient(&linear(corners), u);
        // |g|^2 = A |tangential slope|^2, computed with the unit normal
        let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let along = dot(slope, normal) / norm(normal);
        let wanted = 0.5 * norm(normal) * (dot(slope, slope) - along * along);
        assert!((g[0] * g[0] + g[1] * g[1] - wanted).abs() < 1e-14 * wanted.max(1.0));
    }
}
