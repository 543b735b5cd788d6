//! The numbers of a solve by nodal assembly, real or complex: matrix, factor, potentials.
//!
//! Electrodes come last in the elimination order, so the trailing block of the factor gives the
//! transfer matrix from electrode currents to electrode potentials. All voltages are sums over it.

use crate::error::FemError;
use crate::model::ForwardModel;
use crate::sparse::{Factor, Scalar, SparseError};
use faer::Mat;
use ndarray::Array2;

/// Matrix, factor and potentials of one solve. Allocated once for a model's sizes.
#[derive(Clone)]
pub(crate) struct Nodal<T> {
    /// Values of the system matrix.
    pub(crate) matrix: Vec<T>,
    pub(crate) factor: Factor<T>,
    /// Electrode potentials for unit currents, [electrode except ground, electrode except ground].
    transfer: Mat<T>,
    /// Electrode potentials, [stimulation, electrode], row-major.
    pub(crate) electrode_potentials: Vec<T>,
    /// Potentials, [unknown, basis pattern], row-major.
    pub(crate) potentials: Vec<T>,
}

impl<T: Scalar> Nodal<T> {
    pub(crate) fn new(model: &ForwardModel) -> Result<Self, FemError> {
        let electrodes = model.protocol().electrodes();
        let (stimulations, zero) = (model.patterns.stimulations_a.len(), T::from(0.0));
        Ok(Self {
            matrix: vec![zero; model.assembly.pattern.entries()],
            factor: model.cholesky.memory()?,
            transfer: Mat::zeros(electrodes - 1, electrodes - 1),
            electrode_potentials: vec![zero; stimulations * electrodes],
            potentials: vec![zero; model.unknowns() * model.fields.basis.nrows()],
        })
    }

    /// Checks every size that a solve of `model` relies on. `elements` is the number of elements of the workspace,
    /// `gradients` that of its gradients and of those needed.
    pub(crate) fn check(
        &self,
        model: &ForwardModel,
        elements: usize,
        gradients: [usize; 2],
    ) -> Result<(), FemError> {
        let electrodes = model.protocol().electrodes();
        let (factor, scratch) = self.factor.sizes();
        let (matrix, entries) = (self.matrix.len(), model.assembly.pattern.entries());
        let found = self.electrode_potentials.len();
        let potentials = model.patterns.stimulations_a.len() * electrodes;
        let fields = model.unknowns() * model.fields.basis.nrows();
        [
            ("workspace of another model: its matrix", matrix, entries),
            ("workspace of another model: its factor", factor, model.cholesky.factor_entries()),
            ("workspace of another model: its scratch", scratch, model.cholesky.scratch_entries()),
            ("workspace of another model: its electrodes", self.transfer.nrows() + 1, electrodes),
            ("workspace of another model: its electrode potentials", found, potentials),
            ("workspace of another model: its fields", self.potentials.len(), fields),
            ("workspace of another model: its elements", elements, model.elements()),
            ("workspace of another model: its gradients", gradients[0], gradients[1]),
        ]
        .into_iter()
        .try_for_each(|(what, found, wanted)| FemError::check_length(what, found, wanted))
    }

    /// Factorises the matrix and computes the electrode potentials.
    pub(crate) fn solve_electrodes(
        &mut self,
        model: &ForwardModel,
        direction: T,
    ) -> Result<(), SparseError> {
        model.cholesky.factorise(&self.matrix, &mut self.factor, direction)?;
        self.transfer.fill(T::from(0.0));
        self.transfer.diagonal_mut().column_vector_mut().fill(T::from(1.0));
        model.cholesky.solve_trailing(&self.factor, self.transfer.as_mut());
        let transfer = self.transfer.as_ref();
        model.patterns.electrode_potentials(transfer, &mut self.electrode_potentials);
        Ok(())
    }

    /// Checks that no electrode potential overflowed.
    pub(crate) fn check_potentials(&self, value_of: impl Fn(T) -> f64) -> Result<(), FemError> {
        let electrodes = self.transfer.nrows() + 1;
        match self.electrode_potentials.iter().position(|v| !T::is_finite_impl(v)) {
            None => Ok(()),
            Some(at) => Err(FemError::NonFinitePotential {
                stimulation: at / electrodes,
                electrode: at % electrodes + 1,
                value_v: value_of(self.electrode_potentials[at]),
            }),
        }
    }

    /// Computes the fields of the basis patterns.
    pub(crate) fn solve_fields(&mut self, model: &ForwardModel) {
        let basis = &model.fields.basis;
        let (solves, nodes) = (basis.nrows(), model.dofs.nodes());
        let currents = self.potentials[nodes * solves..].chunks_exact_mut(solves);
        for (k, row) in currents.enumerate() {
            row.iter_mut().zip(basis.column(k)).for_each(|(x, i)| *x = T::from(*i));
        }
        model.cholesky.solve_checked(&mut self.factor, &mut self.potentials, solves);
    }

    /// Returns the voltage of one measurement, volt.
    pub(crate) fn voltage(&self, model: &ForwardModel, datum: usize) -> T {
        let [stimulation, pattern] = model.protocol().data()[datum].map(|i| i as usize);
        let electrodes = model.protocol().electrodes();
        let potentials = &self.electrode_potentials[stimulation * electrodes..];
        let weights = &model.patterns.measurements[pattern];
        weights.iter().map(|&(l, weight)| potentials[l as usize] * weight).sum()
    }

    /// Returns the electrode potentials, [stimulation, electrode], volt.
    pub(crate) fn electrode_potentials(&self, model: &ForwardModel) -> Array2<T> {
        let electrodes = model.protocol().electrodes();
        let stimulations = model.patterns.stimulations_a.len();
        let values = &self.electrode_potentials;
        Array2::from_shape_fn((stimulations, electrodes), |(s, l)| values[s * electrodes + l])
    }

    /// Returns the potentials at the mesh nodes, [stimulation, node], volt. `level_of` is the
    /// potential of a stimulation's field where that field is zero; without it, that of the ground
    /// electrode.
    pub(crate) fn node_potentials(
        &self,
        model: &ForwardModel,
        level_of: Option<&[T]>,
    ) -> Array2<T> {
        let (solves, electrodes) = (model.fields.basis.nrows(), model.protocol().electrodes());
        let shape = (model.patterns.stimulations_a.len(), model.dofs.midside_nodes.mesh_nodes());
        let mut result = Array2::from_elem(shape, T::from(0.0));
        for (s, mut row) in result.rows_mut().into_iter().enumerate() {
            let ground = self.electrode_potentials[(s + 1) * electrodes - 1];
            let level = level_of.map_or(ground, |levels| levels[s]);
            let (field, factor) = model.fields.stimulations[s];
            let weights = &model.fields.combinations[field as usize];
            for (value, &unknown) in row.iter_mut().zip(&model.dofs.unknown_of_node) {
                let u = &self.potentials[unknown as usize * solves..][..solves];
                let sum: T = weights.iter().map(|&(r, c)| u[r as usize] * c).sum();
                *value = level + sum * factor;
            }
        }
        result
    }

    /// Returns the largest componentwise backward error of the fields.
    pub(crate) fn backward_error(&self, model: &ForwardModel) -> f64 {
        let basis = &model.fields.basis;
        let (solves, nodes, unknowns) = (basis.nrows(), model.dofs.nodes(), model.unknowns());
        let mut x = vec![T::from(0.0); unknowns];
        let (mut product, mut size) = (x.clone(), vec![0.0; unknowns]);
        let mut worst = 0.0_f64;
        for r in 0..solves {
            for (x, row) in x.iter_mut().zip(self.potentials.chunks_exact(solves)) {
                *x = row[r];
            }
            model.assembly.pattern.multiply(&self.matrix, &x, &mut product, &mut size);
            for i in 0..unknowns {
                let b = if i < nodes { 0.0 } else { basis[[r, i - nodes]] };
                let scale = size[i] + b.abs();
                if scale > 0.0 {
                    worst = worst.max((product[i] - T::from(b)).modulus() / scale);
                }
            }
        }
        worst
    }

    /// Returns the ratio of the largest to the smallest entry of the assembled diagonal.
    pub(crate) fn spread(&self, model: &ForwardModel) -> f64 {
        let diagonal = model.assembly.pattern.diagonal().map(|entry| self.matrix[entry].modulus());
        let (least, most) =
            diagonal.fold((f64::INFINITY, 0.0_f64), |(least, most), d| (least.min(d), most.max(d)));
        most / least
    }
}
