//! The forward problem: voltages from sheet conductivity.
//!
//! ```text
//! div (sigma grad u) = 0 in the skin,   u + z sigma du/dn = U_l on electrode l,
//! integral over electrode l of sigma du/dn = I_l,   no current elsewhere.
//! ```
//!
//! [`ForwardModel`] holds what does not change between solves (patterns, ordering, symbolic
//! factorisation) and is shared between threads. [`Workspace`](crate::Workspace) holds the numbers
//! of one solve and is reused. [`Solution`](crate::Solution) borrows both ([`crate::solve`]).
//!
//! Cost of one solve with `n` nodes and a factor of `f` entries: assembly takes 15 n flops; the
//! factorisation dominates (linear elements: 2.5 MFLOP at 2 000 nodes, 93 MFLOP at 20 000); all
//! voltages take `electrodes^2`. Fields, which only the Jacobian needs, take `2 f` flops per
//! independent pattern.

use super::anisotropy::Anisotropy;
use super::assembly::Assembly;
use super::checks::{check_conductivity, check_impedances};
use super::dof_map::DofMap;
use super::geometry::Geometry;
use crate::element::ElementOrder;
use crate::error::FemError;
use crate::protocol::{Fields, PatternEntries, Product, Protocol};
use crate::sparse::{Cholesky, Pattern};
use eit_core::event;
use eit_mesh::Mesh;

/// Forward model of a skin: mesh, electrodes, contact impedances and protocol, prepared for solves.
///
/// ```
/// use eit_fem::{ForwardModel, PairProtocol};
/// use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
///
/// let skin = SkinShape::Disc { radius_m: 0.1 };
/// let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
/// let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.02))?;
/// let model = ForwardModel::new(&mesh, &PairProtocol::default().protocol()?, &[1e3; 16])?;
/// let voltages = model.forward(&vec![1e-5; model.elements()])?;
/// assert_eq!(voltages.len(), 208);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct ForwardModel {
    protocol: Protocol,
    /// Non-zero entries of the protocol's patterns.
    pub(crate) patterns: PatternEntries,
    pub(crate) fields: Fields,
    pub(crate) dofs: DofMap,
    pub(crate) assembly: Assembly,
    pub(crate) cholesky: Cholesky,
    /// Geometry of the undeformed mesh with the given contact impedances.
    pub(crate) geometry: Geometry,
}

/// Size of a model and cost of its solves, known before any solve.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ModelCost {
    /// Number of unknowns: potentials of nodes (quadratic elements: also midside nodes) and
    /// electrodes.
    pub unknowns: usize,
    /// Number of stored entries of the Cholesky factor, 8 bytes each.
    pub factor_entries: usize,
    /// Floating-point operations of one factorisation.
    pub factor_flops: f64,
    /// Number of fields solved for a Jacobian: the rank of the protocol's patterns.
    pub field_solves: usize,
    /// Number of products of fields in a Jacobian; reciprocal measurements share one.
    pub field_products: usize,
    /// Floating-point operations of these products for one Jacobian.
    pub product_flops: f64,
}

/// System matrix for one conductivity on the undeformed mesh.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct SystemMatrix {
    /// Sparsity pattern. Unknowns are the potentials of nodes (quadratic elements: also midside
    /// nodes) in elimination order, then of all electrodes except the last, which is the ground.
    pub pattern: Pattern,
    /// Value of each entry, siemens.
    pub values: Vec<f64>,
    /// Number of unknowns that are nodes. The others are electrodes, where currents are applied.
    pub nodes: usize,
}

impl ForwardModel {
    /// Creates a model with linear elements: validates the input, orders the unknowns and
    /// factorises symbolically.
    ///
    /// `contact_impedance` holds one value per electrode of the mesh, ohm metre for rim electrodes
    /// and ohm square metre for patches. Zero is a shunt (the skin under the electrode has one
    /// potential); infinity is an ideal current source (current enters evenly). Models with either
    /// use the electrode-elimination path of [`ForwardModel::solve_to`].
    ///
    /// # Errors
    /// Mismatched counts; impedances that are negative or NaN; not enough memory.
    pub fn new(
        mesh: &Mesh,
        protocol: &Protocol,
        contact_impedance: &[f64],
    ) -> Result<Self, FemError> {
        Self::with_element_order(mesh, protocol, contact_impedance, ElementOrder::Linear)
    }

    /// Creates a model with elements of the given order; otherwise like [`ForwardModel::new`].
    ///
    /// On the same mesh, quadratic elements have four times the unknowns of linear ones. For equal
    /// run time, their error is smaller by a factor of 20 or more (`docs/performance/forward.md`), so use a
    /// coarser mesh. They follow curved rims and curved skins where the mesh provides edge
    /// midpoints ([`Mesh::midpoint_m`]).
    ///
    /// # Errors
    /// Those of [`ForwardModel::new`]; with quadratic elements also impedances of zero or infinity,
    /// and elements inverted by a curved edge.
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
        let cholesky = Cholesky::new(&assembly.pattern, dofs.nodes())?;
        event!(
            DEBUG,
            "set up the forward model",
            unknowns = dofs.nodes() + protocol.electrodes(),
            matrix_entries = assembly.pattern.entries(),
            factor_flops = cholesky.factor_flops(),
            measurements = protocol.measurements(),
        );
        Ok(Self {
            protocol: protocol.clone(),
            patterns: PatternEntries::new(protocol),
            fields: Fields::new(protocol),
            cholesky,
            dofs,
            assembly,
            geometry,
        })
    }

    /// Returns the same model of a sheet that conducts better along one direction than across.
    ///
    /// Conductivities of solves are then the geometric means of those along and across.
    ///
    /// # Errors
    /// An anisotropy of another number of elements; a direction at right angles to its element.
    pub fn with_anisotropy(mut self, anisotropy: &Anisotropy) -> Result<Self, FemError> {
        let what = "elements of the anisotropy";
        FemError::check_length(what, anisotropy.elements(), self.elements())?;
        self.geometry = self.geometry.with_anisotropy(&self.dofs, anisotropy.clone())?;
        Ok(self)
    }

    /// Returns the direction and ratio of the conductivity of each element, unless it is a scalar
    /// everywhere.
    pub fn anisotropy(&self) -> Option<&Anisotropy> {
        self.geometry.anisotropy.as_ref()
    }

    /// Returns the protocol whose voltages the model computes.
    pub fn protocol(&self) -> &Protocol {
        &self.protocol
    }

    /// Returns whether potentials are linear or quadratic in each element.
    pub fn element_order(&self) -> ElementOrder {
        self.dofs.order
    }

    /// Number of elements, which is the length of a conductivity vector.
    pub fn elements(&self) -> usize {
        self.dofs.elements()
    }

    /// Number of unknowns: node and electrode potentials.
    pub(crate) fn unknowns(&self) -> usize {
        self.dofs.unknowns()
    }

    /// Returns the sets of measurements that are multiples of each other, by reciprocity or because
    /// their patterns are multiples.
    ///
    /// Each set lists (measurement, factor); the factor of its first measurement is 1. Sets are
    /// ordered by their first measurement. The voltage of a measurement is its factor times that of
    /// the first, and its Jacobian row is its factor times the set's row
    /// ([`Solution::unique_jacobian`](crate::Solution::unique_jacobian)).
    pub fn unique_measurements(&self) -> Vec<Vec<(usize, f64)>> {
        let set = |product: &Product| {
            let first = product.data.first().map_or(1.0, |first| first.1);
            product.data.iter().map(|&(datum, factor)| (datum as usize, factor / first)).collect()
        };
        self.fields.products.iter().map(set).collect()
    }

    /// Returns the size of the model and the cost of its solves.
    pub fn cost(&self) -> ModelCost {
        let products = self.fields.products.len();
        // per product: one multiplication per component, and one addition fewer
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

    /// Returns the system matrix for one conductivity per element, siemens, for inspection or for
    /// use with another solver. [`ForwardModel::solve`] does not need it.
    ///
    /// # Errors
    /// A wrong number of values; a value that is not finite and above zero; contact impedances that
    /// are zero or infinite, because shunts and ideal current sources are not solved with this
    /// matrix.
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
