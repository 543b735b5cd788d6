//! Geometry of a solve: the numbers derived from node positions and contact impedances.
//!
//! A model has the geometry of its mesh. When a skin is touched, its nodes and electrodes move and
//! the contact impedances change, but the triangles, electrodes and patterns stay the same. A
//! [`Geometry`] holds the numbers that change, so a solve on the deformed skin reuses the ordering
//! and the symbolic factorisation. Updating it takes 60 flops per triangle and frame in addition to
//! the solve.
//!
//! Results are bit-identical to those of a model built on the moved mesh (`tests/all/geometry.rs`).

use super::anisotropy::{Anisotropy, Grain};
use super::assembly::Assembly;
use super::dof_map::DofMap;
use crate::element::gradient::stiffness;
use crate::element::linear::{area_m2, linear};
use crate::element::{ElementOrder, quadratic};
use crate::error::FemError;

/// Triangles whose area is at most this fraction of their longest edge squared are rejected, as by
/// [`eit_mesh::Surface`]: rounding leaves no correct digit in a smaller area.
const ZERO_AREA: f64 = 4.0 * f64::EPSILON;

/// Node positions and contact impedances of one solve, in the form that assembly needs.
///
/// Create one per thread with [`ForwardModel::geometry`](crate::ForwardModel::geometry) and reuse
/// it; [`ForwardModel::deform`](crate::ForwardModel::deform) does not allocate.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Coefficients of the scaled gradients, in element order.
    pub(crate) elements: Vec<f64>,
    /// Direction and ratio of the conductivity of each element, unless it is a scalar everywhere.
    pub(crate) anisotropy: Option<Anisotropy>,
    /// Off-diagonal unit stiffness, in element order.
    stiffness: Vec<f64>,
    /// Electrode part of the matrix values.
    contact_values: Vec<f64>,
    /// Position of each unknown that is a node, metres.
    pub(crate) positions: Vec<[f64; 3]>,
    /// Contact impedance of each electrode.
    pub(crate) impedance: Vec<f64>,
}

impl Geometry {
    /// Creates the geometry of nodes at `nodes_m` (mesh order) with validated contact impedances.
    pub(crate) fn new(
        dofs: &DofMap,
        assembly: &Assembly,
        nodes_m: &[[f64; 3]],
        contact_impedance: &[f64],
    ) -> Result<Self, FemError> {
        let pairs = dofs.elements() * dofs.order.pairs();
        let mut geometry = Self {
            elements: vec![0.0; pairs],
            anisotropy: None,
            stiffness: vec![0.0; pairs],
            contact_values: vec![0.0; assembly.pattern.entries()],
            positions: vec![[0.0; 3]; dofs.nodes()],
            impedance: Vec::with_capacity(contact_impedance.len()),
        };
        geometry.fill(dofs, assembly, nodes_m, contact_impedance)?;
        Ok(geometry)
    }

    /// Recomputes all numbers for nodes at `nodes_m` (mesh order) and validated contact impedances.
    pub(crate) fn fill(
        &mut self,
        dofs: &DofMap,
        assembly: &Assembly,
        nodes_m: &[[f64; 3]],
        contact_impedance: &[f64],
    ) -> Result<(), FemError> {
        let (of_nodes, of_midside_nodes) = dofs.unknown_of_node.split_at(nodes_m.len());
        for (position, &unknown) in nodes_m.iter().zip(of_nodes) {
            self.positions[unknown as usize] = *position;
        }
        dofs.midside_nodes.places(nodes_m, |middle, position| {
            self.positions[of_midside_nodes[middle] as usize] = position;
        });
        self.fill_all_elements(dofs)?;
        self.fill_contacts(dofs, assembly, contact_impedance);
        Ok(())
    }

    /// Returns the same geometry with another direction and ratio of the conductivity of each element.
    pub(crate) fn with_anisotropy(
        mut self,
        dofs: &DofMap,
        anisotropy: Anisotropy,
    ) -> Result<Self, FemError> {
        self.anisotropy = Some(anisotropy);
        self.fill_all_elements(dofs)?;
        Ok(self)
    }

    fn fill_all_elements(&mut self, dofs: &DofMap) -> Result<(), FemError> {
        match dofs.order {
            ElementOrder::Linear => self.fill_elements(dofs, linear, |_| 1.0),
            ElementOrder::Quadratic => {
                self.fill_elements(dofs, quadratic::coefficients, quadratic::least_stretch)
            }
        }
    }

    /// Recomputes the contact terms for the current positions.
    pub(crate) fn fill_contacts(
        &mut self,
        dofs: &DofMap,
        assembly: &Assembly,
        contact_impedance: &[f64],
    ) {
        self.impedance.clear();
        self.impedance.extend_from_slice(contact_impedance);
        let Self { positions, contact_values, .. } = self;
        assembly.fill_contacts(&dofs.contacts, positions, contact_impedance, contact_values);
    }

    /// Computes coefficients and stiffness of elements with `NODES` nodes after checking area and
    /// stretch.
    fn fill_elements<const NODES: usize, const PAIRS: usize>(
        &mut self,
        dofs: &DofMap,
        coefficients: impl Fn([[f64; 3]; NODES], Option<&Grain>) -> [f64; PAIRS],
        least_stretch: impl Fn([[f64; 3]; NODES]) -> f64,
    ) -> Result<(), FemError> {
        let (elements, _) = self.elements.as_chunks_mut::<PAIRS>();
        let (stiffnesses, _) = self.stiffness.as_chunks_mut::<PAIRS>();
        let (nodes, _) = dofs.element_nodes.as_chunks::<NODES>();
        let numbers = elements.iter_mut().zip(stiffnesses).zip(nodes);
        for (triangle, ((element, entries), nodes)) in numbers.enumerate() {
            let places = nodes.map(|u| self.positions[u as usize]);
            check_area(triangle, [places[0], places[1], places[2]])?;
            let stretch = least_stretch(places);
            if stretch <= 0.0 || stretch.is_nan() {
                return Err(FemError::FoldedElement { triangle, stretch });
            }
            let grain = self.anisotropy.as_ref().map(|anisotropy| &anisotropy.grains()[triangle]);
            *element = coefficients(places, grain);
            if grain.is_some() && !element.iter().all(|a| a.is_finite()) {
                return Err(FemError::NoDirection { triangle });
            }
            *entries = stiffness::<NODES, PAIRS>(element);
        }
        Ok(())
    }

    /// Writes the values of the system matrix for one conductivity per element, siemens.
    pub(crate) fn fill_matrix(
        &self,
        assembly: &Assembly,
        conductivity_s: &[f64],
        values: &mut [f64],
    ) {
        assembly.fill(&self.stiffness, &self.contact_values, conductivity_s, values);
    }

    /// Leaves the contacts out of the matrix.
    pub(crate) fn leave_out_contacts(&mut self) {
        self.contact_values.fill(0.0);
    }

    /// Whether any contact is a shunt or an ideal current source, which nodal assembly does not
    /// support.
    pub(crate) fn has_limits(&self) -> bool {
        self.impedance.iter().any(|z| *z == 0.0 || z.is_infinite())
    }

    /// Checks that the geometry has the sizes of this model.
    pub(crate) fn check(&self, dofs: &DofMap, assembly: &Assembly) -> Result<(), FemError> {
        let elements = self.elements.len() / dofs.order.pairs();
        let (values, entries) = (self.contact_values.len(), assembly.pattern.entries());
        let checks = [
            ("elements of the geometry", elements, dofs.elements()),
            ("entries of the geometry", values, entries),
            ("nodes of the geometry", self.positions.len(), dofs.nodes()),
        ];
        checks
            .into_iter()
            .try_for_each(|(what, found, wanted)| FemError::check_length(what, found, wanted))
    }
}

fn check_area(triangle: usize, corners: [[f64; 3]; 3]) -> Result<(), FemError> {
    let area_m2 = area_m2(corners);
    let square = |k: usize| -> f64 {
        (0..3).map(|i| (corners[(k + 1) % 3][i] - corners[k][i]).powi(2)).sum()
    };
    let longest = square(0).max(square(1)).max(square(2));
    if !area_m2.is_finite() || area_m2 <= ZERO_AREA * longest {
        return Err(FemError::ZeroArea { triangle, area_m2 });
    }
    Ok(())
}
