//! Order of the finite elements.

/// Order of the finite elements: how the potential varies inside a triangle.
///
/// Conductivity is constant in each triangle for both orders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum ElementOrder {
    /// Linear potential, three nodes, straight edges (P1).
    #[default]
    Linear,
    /// Quadratic potential, six nodes (P2). Where the mesh gives the midpoint of a curved edge
    /// ([`Mesh::midpoint_m`](eit_mesh::Mesh::midpoint_m)), the edge is a parabola through it.
    /// Solves use `f64` only and need finite contact impedances above zero.
    Quadratic,
}

impl ElementOrder {
    /// Number of nodes per element.
    pub(crate) fn nodes(self) -> usize {
        match self {
            Self::Linear => 3,
            Self::Quadratic => 6,
        }
    }

    /// Number of components of a scaled gradient.
    pub(crate) fn components(self) -> usize {
        self.nodes() - 1
    }

    /// Number of pairs of distinct nodes: the number of coefficients and of off-diagonal stiffness
    /// entries.
    pub(crate) fn pairs(self) -> usize {
        self.nodes() * (self.nodes() - 1) / 2
    }
}
