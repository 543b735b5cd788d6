//! Forward problem: from sheet conductivity to voltages.
//!
//! ```text
//! div (sigma grad u) = 0 in the skin,   u + z sigma du/dn = U_l on electrode l,
//! integral over electrode l of sigma du/dn = I_l,   no current elsewhere.
//! ```
//!
//! [`ForwardModel`] holds what does not change (patterns, ordering, symbolic factor) and is shared
//! between threads; [`Workspace`] holds the numbers of one solve and is reused; [`Solution`]
//! borrows both. After the first solve nothing is allocated.
//!
//! Cost of one solve at `n` nodes with factor of `f` entries: assembly 15 n flops, factorisation
//! (dominant; 27 MFLOP at 2 000 nodes and 0.5 GFLOP at 20 000), then `electrodes^2` for all
//! voltages. Fields, needed by the Jacobian only: `2 f` flops per independent pattern.

use crate::assembly::{Assembly, renumber};
use crate::electrode_model::Contact;
use crate::element::Element;
use crate::fields::Fields;
use crate::jacobian;
use crate::solver::{Factor, Solver, order};
use crate::{FemError, Protocol};
use eit_mesh::Mesh;
use faer::Mat;
use ndarray::{Array1, Array2, ArrayViewMut2};
use std::time::{Duration, Instant};

/// A skin with its electrodes, contact impedances and protocol, ready to solve.
#[derive(Debug)]
pub struct ForwardModel {
    protocol: Protocol,
    pub(crate) fields: Fields,
    pub(crate) elements: Vec<Element>,
    /// Triangles as unknowns in elimination order.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Unknown of each mesh node.
    unknown_of_node: Vec<u32>,
    assembly: Assembly,
    solver: Solver,
}

/// Memory of one solve; make one per thread and reuse it.
pub struct Workspace {
    factor: Factor,
    /// Electrode potentials [electrode but ground, stimulation or basis pattern].
    transfer: Mat<f64>,
    /// Potentials [unknown, basis pattern], row-major.
    potentials: Vec<f64>,
    pub(crate) block: jacobian::Block,
}

/// The solved forward problem of one conductivity.
pub struct Solution<'a> {
    model: &'a ForwardModel,
    workspace: &'a mut Workspace,
    fields_solved: bool,
    time: Duration,
}

/// How a forward solve went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveReport {
    /// Node and electrode potentials.
    pub unknowns: usize,
    /// Stored entries of the Cholesky factor.
    pub factor_entries: usize,
    /// Fields solved: the rank of the protocol's patterns.
    pub field_solves: usize,
    /// Largest componentwise backward error `|A x - b|_i / (|A| |x| + |b|)_i` of the fields
    /// (Oettli and Prager 1964): 1e-16 is as exact as the matrix itself.
    pub backward_error: f64,
    /// Time of assembly, factorisation and fields, seconds.
    pub time_s: f64,
}

/// Size and work of a model, known before any number is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelCost {
    /// Node and electrode potentials.
    pub unknowns: usize,
    /// Stored entries of the Cholesky factor, 8 bytes each.
    pub factor_entries: usize,
    /// Floating point operations of one factorisation.
    pub factor_flops: f64,
    /// Fields to solve for the Jacobian: the rank of the protocol's patterns.
    pub field_solves: usize,
    /// Products of fields in the Jacobian; reciprocal measurements share one.
    pub field_products: usize,
}

impl ForwardModel {
    /// Prepares the model: checks, ordering and symbolic factorisation.
    ///
    /// `contact_impedance` is one value per electrode of the mesh, ohm metre for rim electrodes
    /// and ohm square metre for patches.
    ///
    /// # Errors
    /// Counts that do not fit, impedances that are not finite and above zero, lack of memory.
    pub fn new(
        mesh: &Mesh,
        protocol: &Protocol,
        contact_impedance: &[f64],
    ) -> Result<Self, FemError> {
        check_electrodes(mesh, protocol, contact_impedance)?;
        let surface = mesh.surface();
        let nodes = surface.nodes().len();
        let ground = mesh.electrodes().len() - 1;
        let contacts: Vec<Contact> = mesh
            .electrodes()
            .iter()
            .enumerate()
            .map(|(l, electrode)| {
                let potential = (l != ground).then_some((nodes + l) as u32);
                Contact::new(surface, electrode, contact_impedance[l], potential)
            })
            .collect();
        let graph = Assembly::adjacency(surface.triangles(), &contacts, nodes);
        let unknown_of_node = order(&graph)?;
        let contacts: Vec<Contact> =
            contacts.iter().map(|c| c.renumbered(&unknown_of_node)).collect();
        let triangles = renumber(surface.triangles(), &unknown_of_node);
        let elements = Element::of_surface(surface);
        let assembly = Assembly::new(nodes + ground, &triangles, &elements, &contacts);
        let solver = Solver::new(&assembly, nodes)?;
        let (protocol, fields) = (protocol.clone(), Fields::new(protocol));
        Ok(Self { protocol, fields, elements, triangles, unknown_of_node, assembly, solver })
    }

    /// The protocol.
    pub fn protocol(&self) -> &Protocol {
        &self.protocol
    }

    /// Number of elements: the length of a conductivity.
    pub fn elements(&self) -> usize {
        self.elements.len()
    }

    /// What solves of this model cost.
    pub fn cost(&self) -> ModelCost {
        ModelCost {
            unknowns: self.assembly.column_starts.len() - 1,
            factor_entries: self.solver.factor_entries(),
            factor_flops: self.solver.factor_flops(),
            field_solves: self.fields.basis.nrows(),
            field_products: self.fields.products.len(),
        }
    }

    /// Memory for solves of this model.
    ///
    /// # Errors
    /// [`FemError::OutOfMemory`].
    pub fn workspace(&self) -> Result<Workspace, FemError> {
        let electrodes = self.protocol.electrodes();
        let solves = self.fields.basis.nrows();
        Ok(Workspace {
            factor: self.solver.factor(&self.assembly)?,
            transfer: Mat::zeros(electrodes - 1, electrodes - 1),
            potentials: vec![0.0; (self.unknown_of_node.len() + electrodes - 1) * solves],
            block: jacobian::Block::new(self),
        })
    }

    /// Assembles and factorises for one conductivity per element, siemens.
    ///
    /// # Errors
    /// A wrong number of values, a value that is not finite and above zero, a workspace of
    /// another model, a matrix that rounding has made indefinite.
    pub fn solve<'a>(
        &'a self,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        let start = Instant::now();
        self.check_conductivity(conductivity_s)?;
        if workspace.factor.values.len() != self.assembly.entry_count() {
            return Err(FemError::WrongLength {
                what: "matrix entries of the workspace (it belongs to another model)",
                found: workspace.factor.values.len(),
                wanted: self.assembly.entry_count(),
            });
        }
        self.assembly.fill(conductivity_s, &mut workspace.factor.values);
        self.solver.factorise(&self.assembly, &mut workspace.factor)?;
        workspace.transfer.fill(0.0);
        workspace.transfer.diagonal_mut().column_vector_mut().fill(1.0);
        self.solver.solve_electrodes(&workspace.factor, workspace.transfer.as_mut());
        let time = start.elapsed();
        Ok(Solution { model: self, workspace, fields_solved: false, time })
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

    fn check_conductivity(&self, conductivity_s: &[f64]) -> Result<(), FemError> {
        if conductivity_s.len() != self.elements.len() {
            return Err(FemError::WrongLength {
                what: "conductivity (one per element)",
                found: conductivity_s.len(),
                wanted: self.elements.len(),
            });
        }
        match conductivity_s.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
            None => Ok(()),
            Some(element) => {
                Err(FemError::BadConductivity { element, value_s: conductivity_s[element] })
            }
        }
    }
}

fn check_electrodes(
    mesh: &Mesh,
    protocol: &Protocol,
    contact_impedance: &[f64],
) -> Result<(), FemError> {
    let count = mesh.electrodes().len();
    if protocol.electrodes() != count {
        return Err(FemError::ElectrodeCount { protocol: protocol.electrodes(), mesh: count });
    }
    if contact_impedance.len() != count {
        return Err(FemError::WrongLength {
            what: "contact impedance (one per electrode)",
            found: contact_impedance.len(),
            wanted: count,
        });
    }
    match contact_impedance.iter().position(|z| !(z.is_finite() && *z > 0.0)) {
        None => Ok(()),
        Some(l) => {
            Err(FemError::BadContactImpedance { electrode: l + 1, value: contact_impedance[l] })
        }
    }
}

impl Solution<'_> {
    /// Voltages in protocol order, volt.
    pub fn measurements(&self) -> Array1<f64> {
        let potentials = self.electrode_potentials();
        let protocol = &self.model.protocol;
        let patterns = protocol.measurement_patterns();
        let voltage =
            |&[s, m]: &[u32; 2]| potentials.row(s as usize).dot(&patterns.row(m as usize));
        protocol.data().iter().map(voltage).collect()
    }

    /// Electrode potentials [stimulation, electrode], volt; each row sums to zero.
    pub fn electrode_potentials(&self) -> Array2<f64> {
        let protocol = &self.model.protocol;
        let electrodes = protocol.electrodes();
        let transfer = &self.workspace.transfer;
        let mut potentials = Array2::zeros((protocol.stimulations_a().nrows(), electrodes));
        for (mut row, currents) in
            potentials.rows_mut().into_iter().zip(protocol.stimulations_a().rows())
        {
            for l in 0..electrodes - 1 {
                row[l] = (0..electrodes - 1).map(|k| transfer[(l, k)] * currents[k]).sum();
            }
            let mean = row.sum() / electrodes as f64;
            row -= mean;
        }
        potentials
    }

    /// Potentials inside the skin [stimulation, node], volt, on the scale of
    /// [`Solution::electrode_potentials`].
    pub fn node_potentials(&mut self) -> Array2<f64> {
        self.solve_fields();
        let model = self.model;
        let solves = model.fields.basis.nrows();
        let electrode_potentials = self.electrode_potentials();
        let stimulations = model.protocol.stimulations_a();
        // the ground electrode's potential is the constant between the two scales
        let ground = model.protocol.electrodes() - 1;
        let mut result = Array2::zeros((stimulations.nrows(), model.unknown_of_node.len()));
        for (s, mut row) in result.rows_mut().into_iter().enumerate() {
            let (field, factor) = model.fields.stimulations[s];
            let weights = &model.fields.combinations[field as usize];
            for (value, &unknown) in row.iter_mut().zip(&model.unknown_of_node) {
                let at = unknown as usize * solves;
                let u = &self.workspace.potentials[at..at + solves];
                *value = electrode_potentials[[s, ground]]
                    + factor * weights.iter().map(|&(r, c)| c * u[r as usize]).sum::<f64>();
            }
        }
        result
    }

    /// Jacobian [measurement, element] in volt per siemens: the derivative of each voltage with
    /// respect to the conductivity of each element,
    /// `-area grad u_stimulation . grad u_measurement` with the adjoint field of the measurement
    /// pattern driven by one ampere (Geselowitz 1971; Polydorides and Lionheart 2002).
    pub fn jacobian(&mut self) -> Array2<f64> {
        let shape = (self.model.protocol.measurements(), self.model.elements.len());
        let mut jacobian = Array2::zeros(shape);
        self.fill_jacobian(jacobian.view_mut());
        jacobian
    }

    /// [`Solution::jacobian`] into memory of the caller.
    ///
    /// # Errors
    /// [`FemError::WrongLength`] if the shape is not [measurement, element].
    pub fn jacobian_into(&mut self, jacobian: ArrayViewMut2<'_, f64>) -> Result<(), FemError> {
        let model = self.model;
        let checks = [
            ("rows of the Jacobian", jacobian.nrows(), model.protocol.measurements()),
            ("columns of the Jacobian", jacobian.ncols(), model.elements.len()),
        ];
        for (what, found, wanted) in checks {
            if found != wanted {
                return Err(FemError::WrongLength { what, found, wanted });
            }
        }
        self.fill_jacobian(jacobian);
        Ok(())
    }

    fn fill_jacobian(&mut self, jacobian: ArrayViewMut2<'_, f64>) {
        self.solve_fields();
        let Workspace { potentials, block, .. } = &mut *self.workspace;
        jacobian::fill(self.model, potentials, block, jacobian);
    }

    /// How the solve went; solves the fields if nothing has needed them yet.
    pub fn report(&mut self) -> SolveReport {
        self.solve_fields();
        SolveReport {
            unknowns: self.model.assembly.column_starts.len() - 1,
            factor_entries: self.model.solver.factor_entries(),
            field_solves: self.model.fields.basis.nrows(),
            backward_error: self.backward_error(),
            time_s: self.time.as_secs_f64(),
        }
    }

    fn solve_fields(&mut self) {
        if self.fields_solved {
            return;
        }
        let start = Instant::now();
        let basis = &self.model.fields.basis;
        let (solves, nodes) = (basis.nrows(), self.model.unknown_of_node.len());
        let Workspace { potentials, factor, .. } = &mut *self.workspace;
        for (k, row) in potentials[nodes * solves..].chunks_exact_mut(solves).enumerate() {
            row.iter_mut().zip(basis.column(k)).for_each(|(x, i)| *x = *i);
        }
        self.model.solver.solve_fields(factor, potentials, solves);
        self.fields_solved = true;
        self.time += start.elapsed();
    }

    fn backward_error(&self) -> f64 {
        let basis = &self.model.fields.basis;
        let (solves, nodes) = (basis.nrows(), self.model.unknown_of_node.len());
        let unknowns = self.model.assembly.column_starts.len() - 1;
        let mut x = vec![0.0; unknowns];
        let (mut product, mut size) = (x.clone(), x.clone());
        let mut worst = 0.0_f64;
        for r in 0..solves {
            for (x, row) in x.iter_mut().zip(self.workspace.potentials.chunks_exact(solves)) {
                *x = row[r];
            }
            let values = &self.workspace.factor.values;
            self.model.assembly.multiply(values, &x, &mut product, &mut size);
            for i in 0..unknowns {
                let b = if i < nodes { 0.0 } else { basis[[r, i - nodes]] };
                let scale = size[i] + b.abs();
                if scale > 0.0 {
                    worst = worst.max((product[i] - b).abs() / scale);
                }
            }
        }
        worst
    }
}
