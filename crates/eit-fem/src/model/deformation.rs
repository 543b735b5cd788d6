//! Skins that deform: other node positions and contacts on the same triangles.

use super::checks::check_impedances;
use super::forward_model::ForwardModel;
use super::geometry::Geometry;
use crate::error::FemError;

impl ForwardModel {
    /// The geometry of the model's own mesh, to start deformations from.
    pub fn geometry(&self) -> Geometry {
        self.geometry.clone()
    }

    /// Moves nodes and changes contacts: `geometry` becomes that of the model's triangles and
    /// electrodes with nodes at `nodes_m` (mesh order, metres) and one contact impedance per
    /// electrode (ohm metre for rim electrodes, ohm square metre for patches). Allocates nothing.
    ///
    /// Triangles may turn and stretch in space, but whether they fold over each other is the
    /// caller's affair: three corners do not tell it. Curved edges of quadratic elements keep their
    /// shape in the frame of a triangle at the edge.
    ///
    /// # Errors
    /// Wrong counts, a geometry of another model, positions that are not finite, triangles without
    /// area, curved ones that fold over, impedances that are negative or NaN (quadratic elements:
    /// zero or infinite). `geometry` is then not to be used.
    pub fn deform(
        &self,
        nodes_m: &[[f64; 3]],
        contact_impedance: &[f64],
        geometry: &mut Geometry,
    ) -> Result<(), FemError> {
        geometry.check(&self.dofs, &self.assembly)?;
        if nodes_m.len() != self.dofs.midside_nodes.mesh_nodes() {
            return Err(FemError::WrongLength {
                what: "node positions (one per node)",
                found: nodes_m.len(),
                wanted: self.dofs.midside_nodes.mesh_nodes(),
            });
        }
        check_impedances(self.dofs.order, self.protocol().electrodes(), contact_impedance)?;
        if let Some(node) = nodes_m.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(FemError::NonFinitePosition { node, position_m: nodes_m[node] });
        }
        geometry.fill(&self.dofs, &self.assembly, nodes_m, contact_impedance)
    }

    /// Changes contacts alone: nodes stay where `geometry` has them. Allocates nothing.
    ///
    /// # Errors
    /// Wrong counts, a geometry of another model, impedances that are negative or NaN.
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
