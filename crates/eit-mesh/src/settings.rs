//! Settings of the mesh generator.

use crate::geometry::Outline;
use crate::{MeshError, SkinShape};

/// Settings of the mesh generator: edge lengths, limits and smoothing.
///
/// ```
/// use eit_mesh::MeshSettings;
///
/// let settings = MeshSettings { node_limit: 20_000, ..MeshSettings::with_edge(0.005) };
/// settings.validate()?;
/// assert!(MeshSettings::with_edge(-1.0).validate().is_err());
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct MeshSettings {
    /// Edge length away from the electrodes, metres; on a hemisphere, the length at the pole, with
    /// half of it at the rim. `None`: the side of the square that has the skin's area divided by
    /// 38, which gives about 2000 nodes.
    pub edge_m: Option<f64>,
    /// Edge length at electrode ends and re-entrant corners (such as those of a hole), where the
    /// current density is singular, metres. Also used on patch outlines, up to a twelfth of their
    /// length. `None`: a sixth of the electrode's width (a third of a patch's radius), or `edge_m`
    /// if that is smaller; at corners, the length used for the finest electrode. Gaps and other
    /// corners get shorter edges where they need them.
    pub electrode_edge_m: Option<f64>,
    /// Growth of the edge length with distance from such a point, 0.05 to 0.5. Small values give
    /// better triangles but more of them; above 0.4 the smallest angles can fall to 19 degrees.
    pub grading: f64,
    /// Maximum number of nodes; more are an error.
    pub node_limit: usize,
    /// Number of smoothing rounds; 0 leaves the refined mesh unchanged.
    pub smoothing_rounds: usize,
}

impl Default for MeshSettings {
    fn default() -> Self {
        Self {
            edge_m: None,
            electrode_edge_m: None,
            grading: 0.25,
            node_limit: 1_000_000,
            smoothing_rounds: 3,
        }
    }
}

impl MeshSettings {
    /// Returns the default settings with the given interior edge length.
    pub fn with_edge(edge_m: f64) -> Self {
        Self { edge_m: Some(edge_m), ..Self::default() }
    }

    /// Returns the settings of one member of a family of similar meshes, for convergence studies or
    /// for finding the coarsest sufficient mesh. All edge lengths are proportional to `scale`. At
    /// scale 1 the interior edges are a ninth of the side of the square that has the skin's area (a
    /// few hundred nodes). Edges at electrode ends and re-entrant corners are a quarter of that, or
    /// a third of `electrode_m` (the width of the narrowest electrode or diameter of the smallest
    /// patch) if that is smaller.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`] for a scale or width that is not positive and finite.
    pub fn similar(
        &self,
        shape: &SkinShape,
        electrode_m: f64,
        scale: f64,
    ) -> Result<Self, MeshError> {
        for (quantity, value) in [("scale", scale), ("electrode_m", electrode_m)] {
            let is_positive = value.is_finite() && value > 0.0;
            MeshError::check_range(is_positive, quantity, value, "positive and finite")?;
        }
        let edge_m = scale * shape.outline()?.area_m2().sqrt() / 9.0;
        let end_m = (0.25 * edge_m).min(scale * electrode_m / 3.0);
        Ok(Self {
            edge_m: Some(stretch(shape) * edge_m),
            electrode_edge_m: Some(end_m),
            ..self.clone()
        })
    }

    /// Returns the edge lengths that are set, with their names.
    fn edges(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let edges = [("edge_m", self.edge_m), ("electrode_edge_m", self.electrode_edge_m)];
        edges.into_iter().filter_map(|(quantity, edge)| Some((quantity, edge?)))
    }

    /// Rejects edges shorter than the resolution of the skin.
    pub(crate) fn check_edges(&self, least_m: f64, must: &'static str) -> Result<(), MeshError> {
        self.edges().try_for_each(|(quantity, value)| {
            MeshError::check_range(value >= least_m, quantity, value, must)
        })
    }

    /// Checks that all settings are valid.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`].
    pub fn validate(&self) -> Result<(), MeshError> {
        for (quantity, value) in self.edges() {
            let is_positive = value.is_finite() && value > 0.0;
            MeshError::check_range(is_positive, quantity, value, "positive and finite")?;
        }
        let is_valid = (0.05..=0.5).contains(&self.grading);
        MeshError::check_range(is_valid, "grading", self.grading, "between 0.05 and 0.5")?;
        let limit = self.node_limit;
        MeshError::check_range(limit >= 3, "node_limit", limit as f64, "at least 3")
    }

    /// Interior edge length on the outline of a shape, metres, checked against the size of the
    /// outline and the node limit.
    pub(crate) fn edge_on(&self, outline: &Outline, shape: &SkinShape) -> Result<f64, MeshError> {
        let must = "at least 1e-9 of the outline's length (shorter edges are lost in rounding)";
        self.check_edges(outline.resolution_m(), must)?;
        let wanted = self.edge_m.map(|edge_m| edge_m / stretch(shape));
        let edge_m = wanted.unwrap_or_else(|| outline.area_m2().sqrt() / 38.0);
        let expected = NODES_PER_SQUARE_EDGE * outline.area_m2() / (edge_m * edge_m);
        // the estimate is within a factor of 1.5 of the actual number
        if expected > 2.0 * self.node_limit as f64 {
            let limit = self.node_limit;
            return Err(MeshError::TooManyNodes { edge_m, expected, limit });
        }
        Ok(edge_m)
    }
}

/// Number of nodes per square whose side is the requested edge, for equilateral triangles: 2 /
/// sqrt(3).
pub(crate) const NODES_PER_SQUARE_EDGE: f64 = 1.154_700_538_379_251_7;

/// Largest ratio of a length on the skin to that in its outline: 2 at the pole of a hemisphere.
pub(crate) fn stretch(shape: &SkinShape) -> f64 {
    if matches!(shape, SkinShape::Hemisphere { .. }) { 2.0 } else { 1.0 }
}
