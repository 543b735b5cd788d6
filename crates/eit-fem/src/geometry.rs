//! What a solve takes from node positions and contact impedances.
//!
//! A model has the geometry of its mesh. A skin that is touched deforms: its nodes move, its
//! electrodes with them, and their contacts change, while triangles, electrodes and patterns stay.
//! A [`Geometry`] holds the numbers that follow, so that such a solve reuses ordering and symbolic
//! factor: per frame 60 flops a triangle on top of [`ForwardModel::solve`].
//!
//! Results are those of a model built on the moved mesh (`tests/geometry.rs`: the same bits).

use crate::element::{self, Elements, area_m2};
use crate::forward::{ForwardModel, check_accuracy, check_impedances};
use crate::{FemError, Solution, Workspace, quadratic};

/// Triangles whose area is below this fraction of their longest edge squared are empty, as for
/// [`eit_mesh::Surface`]: no digit of a smaller area is right.
const ZERO_AREA: f64 = 4.0 * f64::EPSILON;

/// Node positions and contact impedances of one solve, as the numbers that assembly reads.
///
/// Make one per thread with [`ForwardModel::geometry`] and reuse it: [`ForwardModel::deform`]
/// allocates nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Coefficients of the scaled gradients, element after element.
    pub(crate) elements: Vec<f64>,
    /// Off-diagonal unit stiffness, element after element.
    pub(crate) stiffness: Vec<f64>,
    /// Electrode part of the matrix values.
    pub(crate) constant: Vec<f64>,
    /// Place of each unknown that is a node, metres.
    pub(crate) positions: Vec<[f64; 3]>,
    /// Contact impedance of each electrode.
    pub(crate) impedance: Vec<f64>,
}

impl Geometry {
    /// Memory without numbers; `pairs` of nodes in all elements.
    pub(crate) fn empty(pairs: usize, entries: usize, nodes: usize, electrodes: usize) -> Self {
        Self {
            elements: vec![0.0; pairs],
            stiffness: vec![0.0; pairs],
            constant: vec![0.0; entries],
            positions: vec![[0.0; 3]; nodes],
            impedance: Vec::with_capacity(electrodes),
        }
    }

    /// Whether a contact is a shunt or an ideal current source: not for the textbook assembly.
    pub(crate) fn has_limits(&self) -> bool {
        self.impedance.iter().any(|z| *z == 0.0 || z.is_infinite())
    }

    /// That it belongs to a model of these sizes.
    fn check(&self, model: &ForwardModel) -> Result<(), FemError> {
        let elements = self.elements.len() / model.kind.pairs();
        let checks = [
            ("elements of the geometry", elements, model.elements()),
            ("entries of the geometry", self.constant.len(), model.assembly.entry_count()),
            ("nodes of the geometry", self.positions.len(), model.unknown_of_node.len()),
        ];
        match checks.into_iter().find(|(_, found, wanted)| found != wanted) {
            None => Ok(()),
            Some((what, found, wanted)) => Err(FemError::WrongLength { what, found, wanted }),
        }
    }
}

impl ForwardModel {
    /// The geometry of the model's own mesh, to start deformations from.
    pub fn geometry(&self) -> Geometry {
        self.geometry.clone()
    }

    /// Moves nodes and changes contacts: `geometry` becomes that of the model's triangles and
    /// electrodes with nodes at `nodes_m` (mesh order, metres) and one contact impedance per
    /// electrode (ohm metre for rim electrodes, ohm square metre for patches). Allocates nothing.
    ///
    /// Triangles may turn and stretch in space, but whether they fold over each other is the
    /// caller's affair: three corners do not tell it. Curved edges of quadratic elements keep their
    /// shape in the frame of a triangle at the edge.
    ///
    /// # Errors
    /// Wrong counts, a geometry of another model, positions that are not finite, triangles without
    /// area, curved ones that fold over, impedances that are negative or NaN (quadratic elements:
    /// zero or infinite). `geometry` is then not to be used.
    pub fn deform(
        &self,
        nodes_m: &[[f64; 3]],
        contact_impedance: &[f64],
        geometry: &mut Geometry,
    ) -> Result<(), FemError> {
        geometry.check(self)?;
        if nodes_m.len() != self.middles.mesh_nodes() {
            return Err(FemError::WrongLength {
                what: "node positions (one per node)",
                found: nodes_m.len(),
                wanted: self.middles.mesh_nodes(),
            });
        }
        check_impedances(self.kind, self.protocol().electrodes(), contact_impedance)?;
        if let Some(node) = nodes_m.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(FemError::NonFinitePosition { node, position_m: nodes_m[node] });
        }
        self.fill_geometry(nodes_m, contact_impedance, geometry)
    }

    /// [`ForwardModel::deform`] after its checks of single values.
    pub(crate) fn fill_geometry(
        &self,
        nodes_m: &[[f64; 3]],
        contact_impedance: &[f64],
        geometry: &mut Geometry,
    ) -> Result<(), FemError> {
        let (of_nodes, of_middles) = self.unknown_of_node.split_at(nodes_m.len());
        for (position, &unknown) in nodes_m.iter().zip(of_nodes) {
            geometry.positions[unknown as usize] = *position;
        }
        self.middles.places(nodes_m, |middle, position| {
            geometry.positions[of_middles[middle] as usize] = position;
        });
        match self.kind {
            Elements::Linear => self.fill_elements(geometry, element::linear, |_| 1.0)?,
            Elements::Quadratic => {
                self.fill_elements(geometry, quadratic::coefficients, quadratic::least_stretch)?;
            }
        }
        self.fill_contacts(contact_impedance, geometry);
        Ok(())
    }

    /// Changes contacts alone: nodes stay where `geometry` has them. Allocates nothing.
    ///
    /// # Errors
    /// Wrong counts, a geometry of another model, impedances that are negative or NaN.
    pub fn change_contacts(
        &self,
        contact_impedance: &[f64],
        geometry: &mut Geometry,
    ) -> Result<(), FemError> {
        geometry.check(self)?;
        check_impedances(self.kind, self.protocol().electrodes(), contact_impedance)?;
        self.fill_contacts(contact_impedance, geometry);
        Ok(())
    }

    /// The electrode part of a geometry, from its own positions.
    fn fill_contacts(&self, contact_impedance: &[f64], geometry: &mut Geometry) {
        geometry.impedance.clear();
        geometry.impedance.extend_from_slice(contact_impedance);
        let Geometry { positions, constant, .. } = geometry;
        self.assembly.fill_contacts(&self.contacts, positions, contact_impedance, constant);
    }

    /// Coefficients and stiffness of elements of `NODES` nodes, after checks of area and stretch.
    fn fill_elements<const NODES: usize, const PAIRS: usize>(
        &self,
        geometry: &mut Geometry,
        coefficients: impl Fn([[f64; 3]; NODES]) -> [f64; PAIRS],
        least_stretch: impl Fn([[f64; 3]; NODES]) -> f64,
    ) -> Result<(), FemError> {
        let Geometry { elements, stiffness, positions, .. } = geometry;
        let (elements, _) = elements.as_chunks_mut::<PAIRS>();
        let (stiffness, _) = stiffness.as_chunks_mut::<PAIRS>();
        let (nodes, _) = self.element_nodes.as_chunks::<NODES>();
        let numbers = elements.iter_mut().zip(stiffness).zip(nodes);
        for (triangle, ((element, stiffness), nodes)) in numbers.enumerate() {
            let places = nodes.map(|u| positions[u as usize]);
            check_area(triangle, [places[0], places[1], places[2]])?;
            let stretch = least_stretch(places);
            if stretch <= 0.0 || stretch.is_nan() {
                return Err(FemError::FoldedElement { triangle, stretch });
            }
            *element = coefficients(places);
            *stiffness = element::stiffness::<NODES, PAIRS>(element);
        }
        Ok(())
    }

    /// [`ForwardModel::solve`] on a geometry of [`ForwardModel::deform`].
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`], and a geometry of another model.
    pub fn solve_deformed<'a>(
        &'a self,
        geometry: &'a Geometry,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        geometry.check(self)?;
        self.check_conductivity(conductivity_s)?;
        Solution::new(self, geometry, conductivity_s, workspace, None)
    }

    /// [`ForwardModel::solve_to`] on a geometry of [`ForwardModel::deform`].
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve_to`], and a geometry of another model.
    pub fn solve_deformed_to<'a>(
        &'a self,
        geometry: &'a Geometry,
        conductivity_s: &[f64],
        required_accuracy: f64,
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        geometry.check(self)?;
        self.check_conductivity(conductivity_s)?;
        check_accuracy(required_accuracy)?;
        Solution::new(self, geometry, conductivity_s, workspace, Some(required_accuracy))
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
