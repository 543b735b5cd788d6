//! Forward problem: from sheet conductivity to voltages.
//!
//! ```text
//! div (sigma grad u) = 0 in the skin,   u + z sigma du/dn = U_l on electrode l,
//! integral over electrode l of sigma du/dn = I_l,   no current elsewhere.
//! ```
//!
//! [`ForwardModel`] holds what does not change (patterns, ordering, symbolic factor) and is shared
//! between threads; [`Workspace`](crate::Workspace) holds the numbers of one solve and is reused;
//! [`Solution`](crate::Solution) borrows both ([`crate::solve`]).
//!
//! Cost of one solve at `n` nodes with factor of `f` entries: assembly 15 n flops, factorisation
//! (dominant; linear elements: 2.5 MFLOP at 2 000 nodes and 93 MFLOP at 20 000), then `electrodes^2` for all
//! voltages. Fields, needed by the Jacobian only: `2 f` flops per independent pattern.

use super::assembly::Assembly;
use super::checks::{check_conductivity, check_impedances};
use super::dof_map::DofMap;
use super::geometry::Geometry;
use crate::element::ElementOrder;
use crate::error::FemError;
use crate::protocol::{Fields, PatternEntries, Product, Protocol};
use crate::sparse::{Cholesky, Pattern};
use eit_mesh::Mesh;

/// A skin with its electrodes, contact impedances and protocol, ready to solve.
#[derive(Debug)]
pub struct ForwardModel {
    protocol: Protocol,
    /// Non-zero entries of the protocol's patterns.
    pub(crate) patterns: PatternEntries,
    pub(crate) fields: Fields,
    pub(crate) dofs: DofMap,
    pub(crate) assembly: Assembly,
    pub(crate) cholesky: Cholesky,
    /// Numbers of the mesh's own node positions and of the impedances given.
    pub(crate) geometry: Geometry,
}

/// Size and work of a model, known before any number is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelCost {
    /// Node (quadratic elements: and midside node) and electrode potentials.
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

/// The system matrix of one conductivity, on the mesh's own node positions.
#[derive(Debug, Clone, PartialEq)]
pub struct SystemMatrix {
    /// Where it has entries. Unknowns are node potentials (quadratic elements: and midside nodes) in
    /// elimination order, then the potentials of all electrodes but the last, which is the ground.
    pub pattern: Pattern,
    /// One value for each entry, siemens.
    pub values: Vec<f64>,
    /// Unknowns that are nodes; the rest are electrodes, into which currents go.
    pub nodes: usize,
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
        Self::with_element_order(mesh, protocol, contact_impedance, ElementOrder::Linear)
    }

    /// [`ForwardModel::new`] with elements of an order.
    ///
    /// Quadratic elements have four times the unknowns of linear ones on the same mesh, and in equal time
    /// 20 times smaller an error and more (`docs/PERFORMANCE.md`): take a coarser mesh. They follow curved rims and curved
    /// skins as far as the mesh knows them ([`Mesh::midpoint_m`]).
    ///
    /// # Errors
    /// Those of [`ForwardModel::new`]; with quadratic elements impedances of zero and infinity, and
    /// elements that the curve of an edge turns over.
    pub fn with_element_order(
        mesh: &Mesh,
        protocol: &Protocol,
        contact_impedance: &[f64],
        order: ElementOrder,
    ) -> Result<Self, FemError> {
        check_electrodes(mesh, protocol, contact_impedance, order)?;
        let dofs = DofMap::new(mesh, order)?;
        let assembly = Assembly::new(&dofs);
        let geometry = Geometry::new(&dofs, &assembly, mesh.surface().nodes(), contact_impedance)?;
        Ok(Self {
            protocol: protocol.clone(),
            patterns: PatternEntries::new(protocol),
            fields: Fields::new(protocol),
            cholesky: Cholesky::new(&assembly.pattern, dofs.nodes())?,
            dofs,
            assembly,
            geometry,
        })
    }

    /// The protocol.
    pub fn protocol(&self) -> &Protocol {
        &self.protocol
    }

    /// The order of the elements.
    pub fn element_order(&self) -> ElementOrder {
        self.dofs.order
    }

    /// Number of elements: the length of a conductivity.
    pub fn elements(&self) -> usize {
        self.dofs.elements()
    }

    /// Node and electrode potentials.
    pub(crate) fn unknowns(&self) -> usize {
        self.dofs.unknowns()
    }

    /// Sets of measurements that are multiples of each other, by reciprocity or because patterns
    /// are: (measurement, factor) with the first measurement's factor 1, in the order of the first
    /// measurements. The Jacobian's row of a measurement is the factor times the set's row
    /// ([`Solution::unique_jacobian`](crate::Solution::unique_jacobian)); so are its voltages.
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
        let per_element = (2 * self.dofs.order.components() - 1) * products;
        ModelCost {
            unknowns: self.unknowns(),
            factor_entries: self.cholesky.factor_entries(),
            factor_flops: self.cholesky.factor_flops(),
            field_solves: self.fields.basis.nrows(),
            field_products: products,
            product_flops: per_element as f64 * self.elements() as f64,
        }
    }

    /// The system matrix of one conductivity per element, siemens: to look at, or to solve by other
    /// means. [`ForwardModel::solve`] makes no copy of it.
    ///
    /// # Errors
    /// A wrong number of values, a value that is not finite and above zero, contact impedances that
    /// are zero or infinite: shunts and ideal current sources are not solved by this matrix.
    pub fn system_matrix(&self, conductivity_s: &[f64]) -> Result<SystemMatrix, FemError> {
        check_conductivity(self.elements(), conductivity_s)?;
        if let Some(&value) = self.geometry.impedance.iter().find(|z| **z == 0.0 || z.is_infinite())
        {
            let quantity = "the contact impedance of an assembled electrode";
            return Err(FemError::OutOfRange { quantity, value, must: "above zero and finite" });
        }
        let mut values = vec![0.0; self.assembly.pattern.entries()];
        self.geometry.fill_matrix(&self.assembly, conductivity_s, &mut values);
        Ok(SystemMatrix {
            pattern: self.assembly.pattern.clone(),
            values,
            nodes: self.dofs.nodes(),
        })
    }
}

fn check_electrodes(
    mesh: &Mesh,
    protocol: &Protocol,
    contact_impedance: &[f64],
    order: ElementOrder,
) -> Result<(), FemError> {
    let count = mesh.electrodes().len();
    if protocol.electrodes() != count {
        return Err(FemError::ElectrodeCount { protocol: protocol.electrodes(), mesh: count });
    }
    check_impedances(order, count, contact_impedance)
}
