//! Places of a skin that its protocol cannot tell apart.

use crate::error::SkinError;
use crate::skin::Skin;
use eit_hw::{Finding, Trouble};
use eit_inverse::touch::{ScoreSettings, Twins};

impl Skin {
    /// Finds the places that the model's measurements cannot tell apart. Solves the model and its Jacobian.
    ///
    /// # Errors
    ///
    /// A model that cannot be solved.
    pub fn twins(&self) -> Result<Twins, SkinError> {
        let mut workspace = self.model.workspace()?;
        let jacobian = self.solve(&self.background_s(), &mut workspace)?.jacobian();
        let used = vec![true; self.protocol.measurements()];
        Ok(Twins::find(self.mesh.surface(), &jacobian, &used, self.touch_radius_m())?)
    }

    /// Radius of a touch, metres.
    pub(crate) fn touch_radius_m(&self) -> f64 {
        self.settings.touch.radius_m.unwrap_or(ScoreSettings::default().bell_m)
    }
}

/// Returns the finding that a share of the skin has twins; `None` for a share of 0.
pub fn finding(share: f64) -> Option<Finding> {
    (share > 0.0).then(|| Finding::of_whole(Trouble::Twins { share }))
}
