//! Positions of the fingers in a sequence and their effect on the skin.

use super::settings::SequenceSettings;
use super::voltages::SequenceVoltages;
use crate::error::ReportError;
use eit_fem::fabric::{
    FabricSettings, LinearResponse, PlayCircle, SimulationSettings, TouchScript,
};
use eit_mesh::{Raster, SkinShape};
use eit_skin::scene::MeshSource;
use eit_skin::{Progress, Skin, rounding_warning};
use ndarray::{Array3, Axis};

/// Fingers on a linear skin: their position in each frame and the conductivity response.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchSequence {
    /// Positions and shapes; a frame may have no fingers.
    pub script: TouchScript,
    /// The conductivity response, the same for all fingers.
    pub response: LinearResponse,
}

impl TouchSequence {
    /// Creates fingers on random closed paths, which depend only on the path seed, not on the mesh.
    ///
    /// # Errors
    /// A skin that is not flat.
    pub fn random(source: &MeshSource, settings: &SequenceSettings) -> Result<Self, ReportError> {
        let script = settings.paths().script(&play_circle(source)?)?;
        Ok(Self { script, response: settings.finger.response() })
    }

    /// Positions of the fingers, metres, `[frame][finger]`.
    pub fn positions_m(&self) -> Vec<Vec<[f64; 2]>> {
        let of = |frame| self.script.touches(frame).iter().map(|touch| touch.position_m).collect();
        (0..self.script.frames).map(of).collect()
    }

    /// Simulates the voltages of the untouched skin and of each frame, without noise.
    ///
    /// # Errors
    /// A frame that cannot be solved.
    pub fn voltages(
        &self,
        skin: &Skin,
        progress: &mut Progress,
    ) -> Result<SequenceVoltages, ReportError> {
        let settings = FabricSettings::linear(self.response.change_per_newton);
        let fabric = skin.fabric_with(&settings)?;
        // its true images are not used: they depend on the raster
        let raster = Raster::new(skin.mesh.surface(), 8)?;
        let how = SimulationSettings::default();
        let made = progress.steps("simulate", self.script.frames, |bar| {
            fabric.simulate(&self.script, &raster, &how, &mut |done| bar.set_position(done))
        })?;
        Ok(SequenceVoltages {
            frames: made.exact_v,
            reference: made.reference_v,
            rate_hz: self.script.frame_rate_hz,
            notes: rounding_warning(&made.report.untouched)?.into_iter().collect(),
        })
    }

    /// True conductivity change, siemens, [frame, row, column], NaN outside the skin: the mean over
    /// each pixel of any raster of the skin.
    pub fn truth(&self, background_s: f64, raster: &Raster) -> Array3<f64> {
        let side = raster.pixels();
        let mut images = Array3::from_elem((self.script.frames, side, side), f64::NAN);
        let mut changes = vec![0.0; raster.masked_pixels().len()];
        for (frame, mut image) in images.axis_iter_mut(Axis(0)).enumerate() {
            let touches = self.script.touches(frame);
            self.response.pixel_changes_into(&touches, raster, &mut changes);
            for (&[row, column], change) in raster.masked_pixels().iter().zip(&changes) {
                image[[row, column]] = background_s * change;
            }
        }
        images
    }
}

/// The circle in which fingers move. It depends only on the outline, so that changing the mesh does
/// not move the fingers.
fn play_circle(source: &MeshSource) -> Result<PlayCircle, ReportError> {
    let MeshSource::Generated { shape, .. } = source else {
        return Err(ReportError::input(
            "a touch sequence needs a flat skin with an outline: disc, rectangle or polygon, not a mesh \
             file",
        ));
    };
    if let SkinShape::Hemisphere { .. } = shape {
        return Err(ReportError::input("a touch sequence needs a flat skin, not a hemisphere"));
    }
    Ok(PlayCircle::of_outline(&shape.outline()?)?)
}
