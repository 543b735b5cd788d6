//! Ways for nodes to move.

use crate::error::FemError;

/// A way for nodes to move: of each node that does, metres for each unit of one parameter.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Displacement {
    nodes: Vec<(u32, [f64; 3])>,
}

impl Displacement {
    /// From the nodes (mesh order, from 0) that move. What a node has several times is added up.
    pub fn new(nodes: Vec<(u32, [f64; 3])>) -> Self {
        Self { nodes }
    }

    /// From a vector at every node of a mesh.
    pub fn of_field(field: &[[f64; 3]]) -> Self {
        let moved = (0u32..).zip(field.iter().copied()).filter(|(_, v)| *v != [0.0; 3]);
        Self { nodes: moved.collect() }
    }

    /// Nodes that move, metres for each unit of the parameter.
    pub fn nodes(&self) -> &[(u32, [f64; 3])] {
        &self.nodes
    }

    /// Node positions (metres) with `amount` of this displacement added: what
    /// [`ForwardModel::deform`](crate::ForwardModel::deform) takes.
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

    /// That it is one of a mesh of so many nodes.
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
