//! Working memory of a solve with complex admittivity.

use super::jacobian::Block;
use super::model::AdmittivityModel;
use crate::error::FemError;
use crate::solve::nodal::Nodal;
use num_complex::Complex64;
use std::fmt;

/// Working memory of a solve with complex admittivity. Create one per thread and reuse it.
#[derive(Clone)]
pub struct AdmittivityWorkspace {
    pub(super) nodal: Nodal<Complex64>,
    /// Real or imaginary parts of the admittivity, siemens.
    part_s: Vec<f64>,
    /// Assembled element terms: real parts, imaginary parts.
    assembled: [Vec<f64>; 2],
    pub(super) block: Block,
}

impl fmt::Debug for AdmittivityWorkspace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (factor_entries, _) = self.nodal.factor.sizes();
        f.debug_struct("AdmittivityWorkspace")
            .field("matrix_entries", &self.nodal.matrix.len())
            .field("factor_entries", &factor_entries)
            .finish_non_exhaustive()
    }
}

impl AdmittivityWorkspace {
    /// Allocates the memory for a model.
    pub(super) fn new(model: &AdmittivityModel) -> Result<Self, FemError> {
        let real = &model.real;
        let entries = real.assembly.pattern.entries();
        Ok(Self {
            nodal: Nodal::new(real)?,
            part_s: vec![0.0; real.elements()],
            assembled: [vec![0.0; entries], vec![0.0; entries]],
            block: Block::new(real),
        })
    }

    /// Checks every size that a solve of `model` relies on.
    pub(super) fn check(&self, model: &AdmittivityModel) -> Result<(), FemError> {
        self.nodal.check(&model.real, self.part_s.len(), self.block.sizes(&model.real))
    }

    /// Assembles the matrix; the code of the real model computes its real and imaginary parts.
    pub(super) fn assemble(&mut self, model: &AdmittivityModel, admittivity_s: &[Complex64]) {
        let Self { nodal, part_s, assembled, .. } = self;
        let parts: [fn(&Complex64) -> f64; 2] = [|y| y.re, |y| y.im];
        for (part, values) in parts.iter().zip(assembled.iter_mut()) {
            part_s.iter_mut().zip(admittivity_s).for_each(|(s, y)| *s = part(y));
            model.real.geometry.fill_matrix(&model.real.assembly, part_s, values);
        }
        let [conductances, susceptances] = assembled;
        let elements = conductances.iter().zip(susceptances.iter());
        for ((value, contact), (g, b)) in nodal.matrix.iter_mut().zip(&model.contacts).zip(elements)
        {
            *value = contact + Complex64::new(*g, *b);
        }
    }
}
