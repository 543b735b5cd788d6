//! Derivatives of the voltages with respect to contacts, node positions and electrodes.
//!
//! The discrete model is `A x = b` with currents `b` that no parameter changes. A measurement is
//! `factor x_g . A x_f` with the fields `f`, `g` of its product ([`crate::fields`]), so for every
//! parameter `p` of the matrix
//!
//! ```text
//! dV/dp = -factor x_g . (dA/dp) x_f
//! ```
//!
//! exactly, and the fields that the Jacobian with respect to conductivity solves for serve all of
//! them: no further solve. What differs is `dA/dp`: [`contact`] (one number per electrode),
//! [`movement`] (strain of triangles, stretch of electrode parts). [`electrode_motion`] says how
//! nodes move when an electrode does.

mod contact;
mod displacement;
mod electrode_motion;
mod movement;
mod vector;

pub use displacement::Displacement;
pub use electrode_motion::ElectrodeMotion;

use crate::element::Elements;
use crate::forward::ForwardModel;
use crate::geometry::Geometry;
use crate::jacobian::Potentials;
use crate::{FemError, Solution};
use ndarray::{Array2, ArrayViewMut2};

/// What derivatives are summed from: solved fields and the state they belong to.
pub(crate) struct Solved<'a> {
    pub model: &'a ForwardModel,
    pub geometry: &'a Geometry,
    pub potentials: Potentials<'a>,
    pub conductivity_s: &'a [f64],
}

impl Solution<'_> {
    /// Derivative of each voltage with respect to the contact impedance of each electrode,
    /// [measurement, electrode]: volt per ohm metre (rim) or per ohm square metre (patch).
    ///
    /// `dV/dz = (1/z^2) integral of (U - u)(U* - u*)` over the electrode, the product of the current
    /// densities under it. No further solve; `4 m` flops for each part of each electrode and product
    /// of fields, `m` corners a part.
    ///
    /// # Errors
    /// [`FemError::ContactLimit`] for a shunt or an ideal current source;
    /// [`FemError::LinearElementsOnly`].
    pub fn contact_jacobian(&mut self) -> Result<Array2<f64>, FemError> {
        let protocol = self.solved().model.protocol();
        let mut jacobian = Array2::zeros((protocol.measurements(), protocol.electrodes()));
        self.contact_jacobian_into(jacobian.view_mut())?;
        Ok(jacobian)
    }

    /// [`Solution::contact_jacobian`] into memory of the caller.
    ///
    /// # Errors
    /// Those of [`Solution::contact_jacobian`]; [`FemError::WrongLength`] if the shape is not
    /// [measurement, electrode].
    pub fn contact_jacobian_into(
        &mut self,
        jacobian: ArrayViewMut2<'_, f64>,
    ) -> Result<(), FemError> {
        let solved = self.solved();
        check_linear(solved.model, "derivatives with respect to contact impedances")?;
        let columns = ("columns of the Jacobian (one per electrode)", solved.model.contacts.len());
        check_shape(solved.model, &jacobian, columns)?;
        contact::fill(&solved, jacobian)
    }

    /// Derivative of each voltage along each displacement of the nodes, [measurement,
    /// displacement]: volt per unit of the displacement's parameter (volt per metre, for those of
    /// [`ElectrodeMotion`]).
    ///
    /// Conductivities stay with their triangles, contact impedances (per metre of rim, per square
    /// metre of patch) with their electrodes. Exact for the discrete model: it is the derivative of
    /// [`ForwardModel::deform`] followed by a solve. In two dimensions only the part of the strain
    /// counts that is no dilation, two numbers a triangle (conformal maps keep sheet resistances):
    ///
    /// ```text
    /// dV = -sigma area ( (S22 - S11)(fx gx - fy gy) - 2 S12 (fx gy + fy gx) )    strain S
    ///      - (1/z) d(measure) mean of (U - u)(U* - u*)                           electrode parts
    /// ```
    ///
    /// No further solve; 4 flops for each triangle that a displacement strains, displacement, and
    /// product of fields. Allocates lists of the triangles that are strained.
    ///
    /// # Errors
    /// A displacement of a node that does not exist, or that is not finite;
    /// [`FemError::LinearElementsOnly`].
    pub fn movement_jacobian(
        &mut self,
        displacements: &[Displacement],
    ) -> Result<Array2<f64>, FemError> {
        let rows = self.solved().model.protocol().measurements();
        let mut jacobian = Array2::zeros((rows, displacements.len()));
        self.movement_jacobian_into(displacements, jacobian.view_mut())?;
        Ok(jacobian)
    }

    /// [`Solution::movement_jacobian`] into memory of the caller.
    ///
    /// # Errors
    /// Those of [`Solution::movement_jacobian`]; [`FemError::WrongLength`] if the shape is not
    /// [measurement, displacement].
    pub fn movement_jacobian_into(
        &mut self,
        displacements: &[Displacement],
        jacobian: ArrayViewMut2<'_, f64>,
    ) -> Result<(), FemError> {
        let solved = self.solved();
        check_linear(solved.model, "derivatives along displacements")?;
        let columns = ("columns of the Jacobian (one per displacement)", displacements.len());
        check_shape(solved.model, &jacobian, columns)?;
        displacements.iter().try_for_each(|d| d.check(solved.model.unknown_of_node.len()))?;
        movement::fill(&solved, displacements, jacobian);
        Ok(())
    }
}

fn check_linear(model: &ForwardModel, what: &'static str) -> Result<(), FemError> {
    match model.kind {
        Elements::Linear => Ok(()),
        Elements::Quadratic => Err(FemError::LinearElementsOnly { what }),
    }
}

fn check_shape(
    model: &ForwardModel,
    jacobian: &ArrayViewMut2<'_, f64>,
    (columns, count): (&'static str, usize),
) -> Result<(), FemError> {
    let checks = [
        ("rows of the Jacobian", jacobian.nrows(), model.protocol().measurements()),
        (columns, jacobian.ncols(), count),
    ];
    match checks.into_iter().find(|(_, found, wanted)| found != wanted) {
        None => Ok(()),
        Some((what, found, wanted)) => Err(FemError::WrongLength { what, found, wanted }),
    }
}
