//! Which finite elements potentials are made of.

/// The order of the finite elements: how potentials run inside a triangle.
///
/// Conductivity is one value per triangle with either.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ElementOrder {
    /// Linear potentials, three nodes, straight edges (P1).
    #[default]
    Linear,
    /// Quadratic potentials, six nodes (P2). Edges follow the curve that the mesh knows
    /// ([`Mesh::midpoint_m`](eit_mesh::Mesh::midpoint_m)) as parabolas through its midpoint. Solved in
    /// `f64` only, with contact impedances above zero and finite.
    Quadratic,
}

impl ElementOrder {
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
