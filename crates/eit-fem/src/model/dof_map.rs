//! Degrees of freedom: the unknown potentials of nodes and electrodes.
//!
//! Node potentials come first, then all electrode potentials except the last, which is the ground
//! (0 V). Unknowns are numbered in elimination order, so a solve needs no permutation.

use super::contact::Contact;
use crate::element::ElementOrder;
use crate::element::gradient::node_pairs;
use crate::element::midside_nodes::MidsideNodes;
use crate::error::FemError;
use crate::sparse::graph::Adjacency;
use crate::sparse::ordering::fill_reducing;
use eit_mesh::Mesh;

/// Maps the nodes of elements and electrodes to unknowns.
#[derive(Debug, Clone)]
pub(crate) struct DofMap {
    pub order: ElementOrder,
    pub midside_nodes: MidsideNodes,
    /// Electrodes, expressed in unknowns.
    pub contacts: Vec<Contact>,
    /// Unknowns of the nodes of all elements, in order.
    pub element_nodes: Vec<u32>,
    /// Unknown of each mesh node, then of each midside node.
    pub unknown_of_node: Vec<u32>,
}

impl DofMap {
    /// Numbers the unknowns of a mesh.
    pub(crate) fn new(mesh: &Mesh, order: ElementOrder) -> Result<Self, FemError> {
        let surface = mesh.surface();
        let midside_nodes = MidsideNodes::new(mesh, order);
        let nodes = midside_nodes.all_nodes();
        let ground = mesh.electrodes().len() - 1;
        let contacts: Vec<Contact> = mesh
            .electrodes()
            .iter()
            .enumerate()
            .map(|(l, electrode)| {
                let potential = (l != ground).then_some((nodes + l) as u32);
                Contact::new(surface, electrode, &midside_nodes, potential)
            })
            .collect();
        let mut element_nodes = Vec::with_capacity(surface.triangles().len() * order.nodes());
        surface.triangles().iter().for_each(|t| midside_nodes.extend(t, &mut element_nodes));
        let graph = adjacency(order, &element_nodes, &contacts, nodes);
        let mut positions_m = surface.nodes().to_vec();
        positions_m.resize(nodes, [0.0; 3]);
        let (of_nodes, of_midside_nodes) = positions_m.split_at_mut(surface.nodes().len());
        midside_nodes.places(of_nodes, |middle, position_m| of_midside_nodes[middle] = position_m);
        let unknown_of_node = fill_reducing(&graph, &positions_m)?;
        let contacts = contacts.iter().map(|c| c.renumbered(&unknown_of_node)).collect();
        element_nodes.iter_mut().for_each(|node| *node = unknown_of_node[*node as usize]);
        Ok(Self { order, midside_nodes, contacts, element_nodes, unknown_of_node })
    }

    /// Number of elements.
    pub(crate) fn elements(&self) -> usize {
        self.element_nodes.len() / self.order.nodes()
    }

    /// Number of unknowns that are nodes; they come first.
    pub(crate) fn nodes(&self) -> usize {
        self.unknown_of_node.len()
    }

    /// Number of unknowns: node and electrode potentials.
    pub(crate) fn unknowns(&self) -> usize {
        self.nodes() + self.contacts.len() - 1
    }

    /// Pairs of unknowns coupled by elements, in element order.
    pub(crate) fn element_pairs(&self) -> impl Iterator<Item = [u32; 2]> {
        self.element_nodes.chunks_exact(self.order.nodes()).flat_map(node_pairs)
    }
}

/// Adjacency of the nodes (the first `count` unknowns) through elements and electrodes, without the
/// diagonal; the input of the fill-reducing ordering.
fn adjacency(
    order: ElementOrder,
    element_nodes: &[u32],
    contacts: &[Contact],
    count: usize,
) -> Adjacency {
    let triangles = element_nodes.len() / order.nodes();
    let mut links: Vec<(u32, u32)> = Vec::with_capacity(2 * order.pairs() * triangles);
    let mut join = |i: u32, j: u32| {
        if i != j && (i.max(j) as usize) < count {
            links.push((i, j));
            links.push((j, i));
        }
    };
    let element_pairs = element_nodes.chunks_exact(order.nodes()).flat_map(node_pairs);
    element_pairs.for_each(|[i, j]| join(i, j));
    contacts.iter().flat_map(|c| c.pairs()).for_each(|[i, j]| join(i, j));
    Adjacency::from_links(count, links)
}
