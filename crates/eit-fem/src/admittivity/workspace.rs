//! Working memory of a solve with complex admittivity.

use super::jacobian::Block;
use super::model::AdmittivityModel;
use crate::error::FemError;
use crate::sparse::Factor;
use faer::{Mat, c64};
use num_complex::Complex64;
use std::fmt;

/// Working memory of a solve with complex admittivity. Create one per thread and reuse it.
#[derive(Clone)]
pub struct AdmittivityWorkspace {
    /// Values of the system matrix.
    pub(super) matrix: Vec<c64>,
    pub(super) factor: Factor<c64>,
    /// Real or imaginary parts of the admittivity, siemens.
    part_s: Vec<f64>,
    /// Assembled element terms: real parts, imaginary parts.
    assembled: [Vec<f64>; 2],
    /// Electrode potentials for unit currents, [electrode except ground, electrode except ground].
    pub(super) transfer: Mat<c64>,
    /// Electrode potentials, [stimulation, electrode], row-major.
    pub(super) electrode_potentials: Vec<c64>,
    /// Potentials, [unknown, basis pattern], row-major.
    pub(super) potentials: Vec<c64>,
    pub(super) block: Block,
}

impl fmt::Debug for AdmittivityWorkspace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (factor_entries, _) = self.factor.sizes();
        f.debug_struct("AdmittivityWorkspace")
            .field("matrix_entries", &self.matrix.len())
            .field("factor_entries", &factor_entries)
            .finish_non_exhaustive()
    }
}

impl AdmittivityWorkspace {
    /// Allocates the memory for a model.
    pub(super) fn new(model: &AdmittivityModel) -> Result<Self, FemError> {
        let real = &model.real;
        let (electrodes, entries) = (real.protocol().electrodes(), real.assembly.pattern.entries());
        let stimulations = real.patterns.stimulations_a.len();
        let zero = c64::new(0.0, 0.0);
        Ok(Self {
            matrix: vec![zero; entries],
            factor: real.cholesky.memory()?,
            part_s: vec![0.0; real.elements()],
            assembled: [vec![0.0; entries], vec![0.0; entries]],
            transfer: Mat::zeros(electrodes - 1, electrodes - 1),
            electrode_potentials: vec![zero; stimulations * electrodes],
            potentials: vec![zero; real.unknowns() * real.fields.basis.nrows()],
            block: Block::new(real),
        })
    }

    /// Checks every size that a solve of `model` relies on.
    pub(super) fn check(&self, model: &AdmittivityModel) -> Result<(), FemError> {
        let real = &model.real;
        let (factor, scratch) = self.factor.sizes();
        let (matrix, entries) = (self.matrix.len(), real.assembly.pattern.entries());
        let electrodes = real.protocol().electrodes();
        let potentials = real.patterns.stimulations_a.len() * electrodes;
        let fields = real.unknowns() * real.fields.basis.nrows();
        let checks = [
            ("workspace of another model: its matrix", matrix, entries),
            ("workspace of another model: its factor", factor, real.cholesky.factor_entries()),
            ("workspace of another model: its scratch", scratch, real.cholesky.scratch_entries()),
            ("workspace of another model: its elements", self.part_s.len(), real.elements()),
            ("workspace of another model: its electrodes", self.transfer.nrows() + 1, electrodes),
            (
                "workspace of another model: its electrode potentials",
                self.electrode_potentials.len(),
                potentials,
            ),
            ("workspace of another model: its fields", self.potentials.len(), fields),
            ("workspace of another model: its gradients", self.block.size(), Block::size_for(real)),
        ];
        match checks.into_iter().find(|(_, found, wanted)| found != wanted) {
            None => Ok(()),
            Some((what, found, wanted)) => Err(FemError::WrongLength { what, found, wanted }),
        }
    }

    /// Assembles the matrix; the code of the real model computes its real and imaginary parts.
    pub(super) fn assemble(&mut self, model: &AdmittivityModel, admittivity_s: &[Complex64]) {
        let Self { matrix, part_s, assembled, .. } = self;
        let parts: [fn(&Complex64) -> f64; 2] = [|y| y.re, |y| y.im];
        for (part, values) in parts.iter().zip(assembled.iter_mut()) {
            part_s.iter_mut().zip(admittivity_s).for_each(|(s, y)| *s = part(y));
            model.real.geometry.fill_matrix(&model.real.assembly, part_s, values);
        }
        let [conductances, susceptances] = assembled;
        let elements = conductances.iter().zip(susceptances.iter());
        for ((value, contact), (g, b)) in matrix.iter_mut().zip(&model.contacts).zip(elements) {
            *value = contact + Complex64::new(*g, *b);
        }
    }

    /// Checks that no electrode potential overflowed.
    pub(super) fn check_potentials(&self) -> Result<(), FemError> {
        let electrodes = self.transfer.nrows() + 1;
        match self.electrode_potentials.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(at) => Err(FemError::NonFinitePotential {
                stimulation: at / electrodes,
                electrode: at % electrodes + 1,
                value_v: self.electrode_potentials[at].norm(),
            }),
        }
    }
}
