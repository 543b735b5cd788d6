//! Displacements of the nodes.

use crate::error::FemError;

/// Displacement of the nodes per unit of one parameter; nodes that are not listed do not move.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Displacement {
    nodes: Vec<(u32, [f64; 3])>,
}

impl Displacement {
    /// Creates a displacement from the nodes that move (index in mesh order, from 0) and their
    /// vectors, metres per unit of the parameter. Vectors of repeated nodes are added.
    pub fn new(nodes: Vec<(u32, [f64; 3])>) -> Self {
        Self { nodes }
    }

    /// Creates a displacement from one vector per mesh node.
    pub fn of_field(field: &[[f64; 3]]) -> Self {
        let moved = (0u32..).zip(field.iter().copied()).filter(|(_, v)| *v != [0.0; 3]);
        Self { nodes: moved.collect() }
    }

    /// Nodes that move and their vectors, metres per unit of the parameter.
    pub fn nodes(&self) -> &[(u32, [f64; 3])] {
        &self.nodes
    }

    /// Adds `amount` times this displacement to the node positions (metres), for use with
    /// [`ForwardModel::deform`](crate::ForwardModel::deform).
    ///
    /// # Errors
    /// [`FemError::NoSuchNode`], [`FemError::NonFinitePosition`].
    pub fn apply(&self, amount: f64, nodes_m: &mut [[f64; 3]]) -> Result<(), FemError> {
        self.check(nodes_m.len())?;
        for &(node, vector) in &self.nodes {
            let position = &mut nodes_m[node as usize];
            position.iter_mut().zip(vector).for_each(|(p, v)| *p += amount * v);
        }
        Ok(())
    }

    /// Checks that all nodes exist in a mesh of `nodes` nodes and that all vectors are finite.
    pub(crate) fn check(&self, nodes: usize) -> Result<(), FemError> {
        for &(node, position_m) in &self.nodes {
            let node = node as usize;
            if node >= nodes {
                return Err(FemError::NoSuchNode { node, nodes });
            }
            if position_m.iter().any(|x| !x.is_finite()) {
                return Err(FemError::NonFinitePosition { node, position_m });
            }
        }
        Ok(())
    }
}
