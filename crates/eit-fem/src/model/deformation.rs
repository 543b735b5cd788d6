//! Deforming skins: new node positions and contacts on the same triangles.

use super::checks::check_impedances;
use super::forward_model::ForwardModel;
use super::geometry::Geometry;
use crate::error::FemError;

impl ForwardModel {
    /// Returns the geometry of the undeformed mesh, as a starting point for
    /// [`ForwardModel::deform`].
    pub fn geometry(&self) -> Geometry {
        self.geometry.clone()
    }

    /// Moves the nodes and changes the contact impedances in `geometry`. Does not allocate.
    ///
    /// `nodes_m` holds node positions in mesh order, metres; `contact_impedance` holds one value
    /// per electrode, ohm metre for rim electrodes and ohm square metre for patches.
    ///
    /// Triangles may rotate and stretch in space. Whether triangles fold over each other is not
    /// checked; the caller must ensure that they do not. Curved edges of quadratic elements keep
    /// their shape in the frame of a triangle at the edge.
    ///
    /// # Errors
    /// Wrong counts; a geometry of another model; positions that are not finite; triangles without
    /// area; curved triangles that fold over; impedances that are negative or NaN (quadratic
    /// elements: also zero or infinite). After an error, `geometry` must not be used.
    pub fn deform(
        &self,
        nodes_m: &[[f64; 3]],
        contact_impedance: &[f64],
        geometry: &mut Geometry,
    ) -> Result<(), FemError> {
        geometry.check(&self.dofs, &self.assembly)?;
        let nodes = self.dofs.midside_nodes.mesh_nodes();
        FemError::check_length("node positions (one per node)", nodes_m.len(), nodes)?;
        check_impedances(self.dofs.order, self.protocol().electrodes(), contact_impedance)?;
        if let Some(node) = nodes_m.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(FemError::NonFinitePosition { node, position_m: nodes_m[node] });
        }
        geometry.fill(&self.dofs, &self.assembly, nodes_m, contact_impedance)
    }

    /// Changes the contact impedances in `geometry` and leaves the nodes where they are. Does not
    /// allocate.
    ///
    /// # Errors
    /// Wrong counts; a geometry of another model; impedances that are negative or NaN (quadratic
    /// elements: also zero or infinite).
    pub fn change_contacts(
        &self,
        contact_impedance: &[f64],
        geometry: &mut Geometry,
    ) -> Result<(), FemError> {
        geometry.check(&self.dofs, &self.assembly)?;
        check_impedances(self.dofs.order, self.protocol().electrodes(), contact_impedance)?;
        geometry.fill_contacts(&self.dofs, &self.assembly, contact_impedance);
        Ok(())
    }
}
