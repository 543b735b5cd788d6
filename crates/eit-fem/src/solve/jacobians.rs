//! Derivatives of the voltages of a [`Solution`].

use super::solution::Solution;
use crate::derivatives::conductivity::{self, JacobianValue};
use crate::derivatives::displacement::Displacement;
use crate::derivatives::{anisotropy, contact, movement};
use crate::element::ElementOrder;
use crate::error::FemError;
use crate::model::ForwardModel;
use ndarray::{Array2, ArrayViewMut2};

impl Solution<'_> {
    /// Returns the Jacobian, [measurement, element], in volt per siemens: the derivative of each
    /// voltage with respect to the conductivity of each element.
    ///
    /// An entry is `-area grad u_stimulation . grad u_measurement`, where `u_measurement` is the
    /// adjoint field, i.e. that of the measurement pattern driven with one ampere (Geselowitz 1971;
    /// Polydorides and Lionheart 2002).
    pub fn jacobian(&mut self) -> Array2<f64> {
        let shape = (self.model.protocol().measurements(), self.model.elements());
        let mut jacobian = Array2::zeros(shape);
        let (solved, block) = self.solved_fields();
        conductivity::fill(&solved, block, jacobian.view_mut());
        jacobian
    }

    /// Writes [`Solution::jacobian`] into the caller's memory.
    ///
    /// # Errors
    /// [`FemError::WrongLength`] if the shape is not [measurement, element].
    pub fn jacobian_into(&mut self, jacobian: ArrayViewMut2<'_, f64>) -> Result<(), FemError> {
        let measurements = self.model.protocol().measurements();
        FemError::check_length("rows of the Jacobian", jacobian.nrows(), measurements)?;
        FemError::check_length("columns of the Jacobian", jacobian.ncols(), self.model.elements())?;
        let (solved, block) = self.solved_fields();
        conductivity::fill(&solved, block, jacobian);
        Ok(())
    }

    /// Returns one Jacobian row per set of measurements that are multiples of each other (see
    /// [`ForwardModel::unique_measurements`]): [set, element], volt per siemens.
    ///
    /// Each row is that of the first measurement of the set. With 208 reciprocal measurements there
    /// are 104 rows. As `f32`, they take a quarter of the memory of the full Jacobian, and each
    /// value is rounded to `f32`.
    pub fn unique_jacobian<T: JacobianValue>(&mut self) -> Array2<T> {
        let shape = (self.model.fields.products.len(), self.model.elements());
        let mut jacobian = Array2::default(shape);
        let (solved, block) = self.solved_fields();
        conductivity::fill_unique(&solved, block, jacobian.view_mut());
        jacobian
    }

    /// Writes [`Solution::unique_jacobian`] into the caller's memory.
    ///
    /// # Errors
    /// [`FemError::WrongLength`] if the shape is not [set, element].
    pub fn unique_jacobian_into<T: JacobianValue>(
        &mut self,
        jacobian: ArrayViewMut2<'_, T>,
    ) -> Result<(), FemError> {
        let products = self.model.fields.products.len();
        FemError::check_length("rows of the unique Jacobian", jacobian.nrows(), products)?;
        FemError::check_length("columns of the Jacobian", jacobian.ncols(), self.model.elements())?;
        let (solved, block) = self.solved_fields();
        conductivity::fill_unique(&solved, block, jacobian);
        Ok(())
    }

    /// Returns the derivative of each voltage with respect to ratio and direction of an anisotropic
    /// sheet ([`Anisotropy`](crate::Anisotropy)), [measurement, 2], in volt.
    ///
    /// Column 0 is the derivative with respect to `ln(ratio)`, all directions and scales kept. Column 1
    /// is that with respect to the logarithm of a further ratio at 45 degrees, counter-clockwise, from each
    /// direction; times `2 ln(ratio)` it is the derivative with respect to the angle, radians. It remains
    /// defined at a ratio of 1, where the angle has no effect.
    ///
    /// # Errors
    /// [`FemError::NoAnisotropy`] for a scalar conductivity (a ratio of 1 will do).
    pub fn anisotropy_jacobian(&mut self) -> Result<Array2<f64>, FemError> {
        let (solved, _) = self.solved_fields();
        let mut jacobian = Array2::zeros((solved.model.protocol().measurements(), 2));
        anisotropy::fill(&solved, jacobian.view_mut())?;
        Ok(jacobian)
    }

    /// Returns the derivative of each voltage with respect to the contact impedance of each
    /// electrode, [measurement, electrode], in volt per ohm metre (rim) or per ohm square metre
    /// (patch).
    ///
    /// `dV/dz = (1/z^2) integral of (U - u)(U* - u*)` over the electrode, which is the integral of
    /// the product of the two current densities. Needs no further solve; takes `4 m` flops per
    /// electrode part and product of fields, for parts with `m` corners.
    ///
    /// # Errors
    /// [`FemError::ContactLimit`] for a shunt or an ideal current source;
    /// [`FemError::LinearElementsOnly`].
    pub fn contact_jacobian(&mut self) -> Result<Array2<f64>, FemError> {
        let (solved, _) = self.solved_fields();
        let (model, protocol) = (solved.model, solved.model.protocol());
        check_linear(model, "derivatives with respect to contact impedances")?;
        let mut jacobian = Array2::zeros((protocol.measurements(), protocol.electrodes()));
        contact::fill(&solved, jacobian.view_mut())?;
        Ok(jacobian)
    }

    /// Returns the derivative of each voltage along each displacement of the nodes, [measurement,
    /// displacement], in volt per unit of the displacement's parameter (volt per metre for an
    /// [`ElectrodeMotion`](crate::ElectrodeMotion)).
    ///
    /// Conductivities stay with their triangles, and contact impedances (ohm metre for rim
    /// electrodes, ohm square metre for patches) with their electrodes. The result is exact for the
    /// discrete model: it is the derivative of [`ForwardModel::deform`] followed by a solve. In two
    /// dimensions only the part of the strain without dilation matters, two numbers per triangle
    /// (conformal maps preserve sheet resistance):
    ///
    /// ```text
    /// dV = -sigma area ( (S22 - S11)(fx gx - fy gy) - 2 S12 (fx gy + fy gx) )    strain S
    ///      - (1/z) d(measure) mean of (U - u)(U* - u*)                           electrode parts
    /// ```
    ///
    /// Needs no further solve; takes 2 flops for each coordinate that moves, displacement and product of
    /// fields, and 30 for each triangle and product. Allocates what it needs, some 20 MB at most.
    ///
    /// # Errors
    /// A displacement that refers to a node that does not exist or is not finite;
    /// [`FemError::LinearElementsOnly`].
    pub fn movement_jacobian(
        &mut self,
        displacements: &[Displacement],
    ) -> Result<Array2<f64>, FemError> {
        let (solved, _) = self.solved_fields();
        let model = solved.model;
        check_linear(model, "derivatives along displacements")?;
        displacements.iter().try_for_each(|d| d.check(model.dofs.nodes()))?;
        let rows = model.protocol().measurements();
        let mut jacobian = Array2::zeros((rows, displacements.len()));
        movement::fill(&solved, displacements, jacobian.view_mut());
        Ok(jacobian)
    }

    /// Derivatives with respect to shears of the elements, one row per set of measurements ([`movement::shears`]).
    #[cfg(feature = "fabric")]
    pub(crate) fn shear_jacobian(&mut self) -> Result<Array2<f64>, FemError> {
        let (solved, _) = self.solved_fields();
        check_linear(solved.model, "derivatives along shears")?;
        Ok(movement::shears(&solved))
    }
}

fn check_linear(model: &ForwardModel, what: &'static str) -> Result<(), FemError> {
    match model.dofs.order {
        ElementOrder::Linear => Ok(()),
        ElementOrder::Quadratic => Err(FemError::LinearElementsOnly { what }),
    }
}
