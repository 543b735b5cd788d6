//! Forward problem: from sheet conductivity to voltages.
//!
//! ```text
//! div (sigma grad u) = 0 in the skin,   u + z sigma du/dn = U_l on electrode l,
//! integral over electrode l of sigma du/dn = I_l,   no current elsewhere.
//! ```
//!
//! [`ForwardModel`] holds what does not change (patterns, ordering, symbolic factor) and is shared
//! between threads; [`Workspace`](crate::Workspace) holds the numbers of one solve and is reused;
//! [`Solution`] borrows both.
//!
//! Cost of one solve at `n` nodes with factor of `f` entries: assembly 15 n flops, factorisation
//! (dominant; linear elements: 2.5 MFLOP at 2 000 nodes and 93 MFLOP at 20 000), then `electrodes^2` for all
//! voltages. Fields, needed by the Jacobian only: `2 f` flops per independent pattern.
//!
//! Long, because one type and the documentation of what can be asked of it are one thing.

use crate::assembly::Assembly;
use crate::electrode_model::Contact;
use crate::element::Elements;
use crate::fields::{Fields, Product};
use crate::geometry::Geometry;
use crate::middles::Middles;
use crate::solver::{Solver, order};
use crate::workspace::Patterns;
use crate::{FemError, Protocol, Solution, Workspace};
use eit_mesh::Mesh;
use ndarray::{Array1, Array2};
use std::cmp::Ordering::{Equal, Greater};

/// A skin with its electrodes, contact impedances and protocol, ready to solve.
#[derive(Debug)]
pub struct ForwardModel {
    protocol: Protocol,
    /// Non-zero entries of the protocol's patterns.
    pub(crate) patterns: Patterns,
    pub(crate) fields: Fields,
    /// Numbers of the mesh's own node positions and of the impedances given.
    pub(crate) geometry: Geometry,
    /// Electrodes, in unknowns.
    pub(crate) contacts: Vec<Contact>,
    pub(crate) kind: Elements,
    pub(crate) middles: Middles,
    /// Nodes of element after element, as unknowns in elimination order.
    pub(crate) element_nodes: Vec<u32>,
    /// Unknown of each mesh node, then of each middle.
    pub(crate) unknown_of_node: Vec<u32>,
    pub(crate) assembly: Assembly,
    pub(crate) solver: Solver,
}

/// Size and work of a model, known before any number is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelCost {
    /// Node (quadratic elements: and middle) and electrode potentials.
    pub unknowns: usize,
    /// Stored entries of the Cholesky factor, 8 bytes each.
    pub factor_entries: usize,
    /// Floating point operations of one factorisation.
    pub factor_flops: f64,
    /// Fields to solve for the Jacobian: the rank of the protocol's patterns.
    pub field_solves: usize,
    /// Products of fields in the Jacobian; reciprocal measurements share one.
    pub field_products: usize,
    /// Floating point operations of those products for one Jacobian.
    pub product_flops: f64,
}

impl ForwardModel {
    /// Prepares the model with linear elements: checks, ordering and symbolic factorisation.
    ///
    /// `contact_impedance` is one value per electrode of the mesh, ohm metre for rim electrodes
    /// and ohm square metre for patches. Zero is a shunt (the skin under the electrode has one
    /// potential), infinity an ideal current source (current enters evenly): such models are solved
    /// as by [`ForwardModel::solve_to`].
    ///
    /// # Errors
    /// Counts that do not fit, impedances that are negative or NaN, lack of memory.
    pub fn new(
        mesh: &Mesh,
        protocol: &Protocol,
        contact_impedance: &[f64],
    ) -> Result<Self, FemError> {
        Self::with_elements(mesh, protocol, contact_impedance, Elements::Linear)
    }

    /// [`ForwardModel::new`] with a kind of elements.
    ///
    /// Quadratic elements have four times the unknowns of linear ones on the same mesh, and in equal time
    /// 20 times smaller an error and more (`docs/PERFORMANCE.md`): take a coarser mesh. They follow curved rims and curved
    /// skins as far as the mesh knows them ([`Mesh::midpoint_m`]).
    ///
    /// # Errors
    /// Those of [`ForwardModel::new`]; with quadratic elements impedances of zero and infinity, and
    /// elements that the curve of an edge turns over.
    pub fn with_elements(
        mesh: &Mesh,
        protocol: &Protocol,
        contact_impedance: &[f64],
        elements: Elements,
    ) -> Result<Self, FemError> {
        check_electrodes(mesh, protocol, contact_impedance, elements)?;
        let surface = mesh.surface();
        let middles = Middles::new(mesh, elements);
        let nodes = middles.all_nodes();
        let ground = mesh.electrodes().len() - 1;
        let contacts: Vec<Contact> = mesh
            .electrodes()
            .iter()
            .enumerate()
            .map(|(l, electrode)| {
                let potential = (l != ground).then_some((nodes + l) as u32);
                Contact::new(surface, electrode, &middles, potential)
            })
            .collect();
        let mut element_nodes = Vec::with_capacity(surface.triangles().len() * elements.nodes());
        surface.triangles().iter().for_each(|t| middles.extend(t, &mut element_nodes));
        let graph = Assembly::adjacency(elements, &element_nodes, &contacts, nodes);
        let mut positions_m = surface.nodes().to_vec();
        positions_m.resize(nodes, [0.0; 3]);
        let (of_nodes, of_middles) = positions_m.split_at_mut(surface.nodes().len());
        middles.places(of_nodes, |middle, position_m| of_middles[middle] = position_m);
        let unknown_of_node = order(&graph, &positions_m)?;
        let contacts: Vec<Contact> =
            contacts.iter().map(|c| c.renumbered(&unknown_of_node)).collect();
        element_nodes.iter_mut().for_each(|node| *node = unknown_of_node[*node as usize]);
        let assembly = Assembly::new(nodes + ground, elements, &element_nodes, &contacts);
        let solver = Solver::new(&assembly, nodes);
        let pairs = surface.triangles().len() * elements.pairs();
        let mut geometry = Geometry::empty(pairs, assembly.entry_count(), nodes, ground + 1);
        let mut model = Self {
            protocol: protocol.clone(),
            patterns: Patterns::new(protocol),
            fields: Fields::new(protocol),
            geometry: Geometry::empty(0, 0, 0, 0),
            contacts,
            kind: elements,
            middles,
            element_nodes,
            unknown_of_node,
            assembly,
            solver,
        };
        model.fill_geometry(surface.nodes(), contact_impedance, &mut geometry)?;
        model.geometry = geometry;
        Ok(model)
    }

    /// The protocol.
    pub fn protocol(&self) -> &Protocol {
        &self.protocol
    }

    /// The kind of elements.
    pub fn element_kind(&self) -> Elements {
        self.kind
    }

    /// Number of elements: the length of a conductivity.
    pub fn elements(&self) -> usize {
        self.element_nodes.len() / self.kind.nodes()
    }

    /// Node and electrode potentials.
    pub(crate) fn unknowns(&self) -> usize {
        self.assembly.column_starts.len() - 1
    }

    /// Sets of measurements that are multiples of each other, by reciprocity or because patterns
    /// are: (measurement, factor) with the first measurement's factor 1, in the order of the first
    /// measurements. The Jacobian's row of a measurement is the factor times the set's row
    /// ([`Solution::unique_jacobian`]); so are its voltages.
    pub fn unique_measurements(&self) -> Vec<Vec<(usize, f64)>> {
        let set = |product: &Product| {
            let first = product.data.first().map_or(1.0, |first| first.1);
            product.data.iter().map(|&(datum, factor)| (datum as usize, factor / first)).collect()
        };
        self.fields.products.iter().map(set).collect()
    }

    /// What solves of this model cost.
    pub fn cost(&self) -> ModelCost {
        let products = self.fields.products.len();
        // a multiplication for each component, and one addition less
        let per_element = (2 * self.kind.components() - 1) * products;
        ModelCost {
            unknowns: self.unknowns(),
            factor_entries: self.solver.factor_entries(),
            factor_flops: self.solver.factor_flops(),
            field_solves: self.fields.basis.nrows(),
            field_products: products,
            product_flops: per_element as f64 * self.elements() as f64,
        }
    }

    /// Memory for solves of this model.
    ///
    /// # Errors
    /// [`FemError::OutOfMemory`].
    pub fn workspace(&self) -> Result<Workspace, FemError> {
        Workspace::new(self)
    }

    /// Assembles and factorises for one conductivity per element, siemens.
    ///
    /// # Errors
    /// A wrong number of values, a value that is not finite and above zero, a workspace of
    /// another model, a matrix that rounding has made indefinite, potentials that overflow.
    pub fn solve<'a>(
        &'a self,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        self.check_conductivity(conductivity_s)?;
        Solution::new(self, &self.geometry, conductivity_s, workspace, None)
    }

    /// [`ForwardModel::solve`] to a required accuracy of the voltages, relative to the largest.
    ///
    /// The cheapest path that meets it is taken: the textbook assembly where
    /// [`SolveReport::expected_loss`](crate::SolveReport::expected_loss) suffices; else means and
    /// deviations on electrodes (module `accurate`), first in `f64`, which contact impedances cannot
    /// spoil, then in twice the precision, for contrast and flat triangles. Both also serve shunts and
    /// ideal current sources, have a bound for every voltage, and allocate. At 2 000 nodes they cost
    /// about 50 and 200 times the first path (18 and 75 ms on a loaded machine), at 20 000 20 and 100
    /// times.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`]; an accuracy that is not between `4 eps` and 1;
    /// [`FemError::AccuracyNotReached`]; electrodes without a node of their own; with quadratic
    /// elements [`FemError::PlainPathOnly`] where the first path does not suffice.
    pub fn solve_to<'a>(
        &'a self,
        conductivity_s: &[f64],
        required_accuracy: f64,
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        self.check_conductivity(conductivity_s)?;
        check_accuracy(required_accuracy)?;
        Solution::new(self, &self.geometry, conductivity_s, workspace, Some(required_accuracy))
    }

    /// Voltages of every measurement for one conductivity per element; allocates a workspace.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`].
    pub fn forward(&self, conductivity_s: &[f64]) -> Result<Array1<f64>, FemError> {
        Ok(self.solve(conductivity_s, &mut self.workspace()?)?.measurements())
    }

    /// Jacobian [measurement, element], volt per siemens; allocates a workspace.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`].
    pub fn jacobian(&self, conductivity_s: &[f64]) -> Result<Array2<f64>, FemError> {
        Ok(self.solve(conductivity_s, &mut self.workspace()?)?.jacobian())
    }

    pub(crate) fn check_conductivity(&self, conductivity_s: &[f64]) -> Result<(), FemError> {
        if conductivity_s.len() != self.elements() {
            return Err(FemError::WrongLength {
                what: "conductivity (one per element)",
                found: conductivity_s.len(),
                wanted: self.elements(),
            });
        }
        let bad = |s: &f64| !(s.is_finite() && *s > 0.0);
        match conductivity_s.iter().position(bad) {
            None => Ok(()),
            Some(element) => {
                let count = conductivity_s.iter().filter(|s| bad(s)).count();
                Err(FemError::BadConductivity { element, value_s: conductivity_s[element], count })
            }
        }
    }
}

fn check_electrodes(
    mesh: &Mesh,
    protocol: &Protocol,
    contact_impedance: &[f64],
    elements: Elements,
) -> Result<(), FemError> {
    let count = mesh.electrodes().len();
    if protocol.electrodes() != count {
        return Err(FemError::ElectrodeCount { protocol: protocol.electrodes(), mesh: count });
    }
    check_impedances(elements, count, contact_impedance)
}

/// A wish that `f64` results can meet.
pub(crate) fn check_accuracy(required_accuracy: f64) -> Result<(), FemError> {
    if (4.0 * f64::EPSILON..1.0).contains(&required_accuracy) {
        return Ok(());
    }
    Err(FemError::OutOfRange {
        quantity: "required_accuracy",
        value: required_accuracy,
        must: "at least 9e-16 and below 1",
    })
}

/// One impedance per electrode, not negative; quadratic elements: above zero and finite.
pub(crate) fn check_impedances(
    elements: Elements,
    count: usize,
    contact_impedance: &[f64],
) -> Result<(), FemError> {
    if contact_impedance.len() != count {
        return Err(FemError::WrongLength {
            what: "contact impedance (one per electrode)",
            found: contact_impedance.len(),
            wanted: count,
        });
    }
    // not a number is not at least zero
    let bad = |z: &f64| !matches!(z.partial_cmp(&0.0), Some(Equal | Greater));
    if let Some(l) = contact_impedance.iter().position(bad) {
        let (electrode, value) = (l + 1, contact_impedance[l]);
        return Err(FemError::BadContactImpedance { electrode, value });
    }
    let limit = |z: &f64| elements == Elements::Quadratic && (*z == 0.0 || z.is_infinite());
    match contact_impedance.iter().position(limit) {
        None => Ok(()),
        Some(l) => {
            Err(FemError::LimitOfImpedance { electrode: l + 1, value: contact_impedance[l] })
        }
    }
}
