//! Where the fingers of a sequence are, and what the skin is like under them.

use super::paths;
use super::settings::{Finger, FingerShape, SequenceSettings};
use super::voltages::SequenceVoltages;
use crate::error::ReportError;
use eit_mesh::Raster;
use eit_skin::scene::MeshSource;
use eit_skin::{Progress, Skin, rounding_warning};
use ndarray::{Array2, Array3, Axis};

/// Where the fingers are in each frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TouchSequence {
    /// Places, metres, `[frame][finger]`; a frame may be without fingers.
    pub positions_m: Vec<Vec<[f64; 2]>>,
    /// All fingers are alike.
    pub finger: Finger,
    /// Frames a second, for displays.
    pub rate_hz: f64,
}

impl TouchSequence {
    /// Fingers on random closed paths, each with the same way from frame to frame.
    ///
    /// All places lie within 0.8 of the radius (of the largest circle around the centroid of the
    /// skin that meets no rim) and at least four standard deviations of the bell from each other.
    /// The path seed decides alone, whatever mesh is used; fewer frames are the first ones of more.
    pub fn random(source: &MeshSource, settings: &SequenceSettings) -> Result<Self, ReportError> {
        let SequenceSettings { finger, rate_hz, .. } = *settings;
        let positions_m = paths::positions_m(source, settings)?;
        Ok(Self { positions_m, finger, rate_hz })
    }

    /// Relative conductivity change at a point.
    fn change(&self, point: [f64; 2], fingers: &[[f64; 2]]) -> f64 {
        let Finger { shape, sigma_m, change } = self.finger;
        let of_one = |finger: &[f64; 2]| {
            let square = (point[0] - finger[0]).powi(2) + (point[1] - finger[1]).powi(2);
            match shape {
                FingerShape::Bell => change * (-0.5 * square / sigma_m.powi(2)).exp(),
                FingerShape::Pad if square <= 2.0 * sigma_m.powi(2) => change,
                FingerShape::Pad => 0.0,
            }
        };
        fingers.iter().map(of_one).sum()
    }

    /// Sheet conductivity with fingers at these places: of each element that at its centroid, siemens.
    pub fn conductivity_s(
        &self,
        background_s: f64,
        centroids: &[[f64; 3]],
        fingers: &[[f64; 2]],
    ) -> Vec<f64> {
        let of = |c: &[f64; 3]| background_s * (1.0 + self.change([c[0], c[1]], fingers));
        centroids.iter().map(of).collect()
    }

    /// Voltages of the untouched skin and of each frame, without noise.
    pub fn voltages(
        &self,
        skin: &Skin,
        progress: &mut Progress,
    ) -> Result<SequenceVoltages, ReportError> {
        let background_s = skin.conductivity_s;
        let centroids = skin.mesh.surface().centroids();
        let mut workspace = skin.model.workspace()?;
        let mut solution = skin.model.solve(&skin.background_s(), &mut workspace)?;
        let reference = solution.measurements();
        let notes = rounding_warning(&solution.report())?.into_iter().collect();
        let mut frames = Array2::zeros((self.positions_m.len(), reference.len()));
        progress.steps("simulate", self.positions_m.len(), |bar| {
            // what the last solve showed, and its voltages
            let mut shown: &[[f64; 2]] = &[];
            let mut solved = reference.clone();
            for (mut frame, fingers) in frames.rows_mut().into_iter().zip(&self.positions_m) {
                if shown != fingers.as_slice() {
                    let conductivity = self.conductivity_s(background_s, &centroids, fingers);
                    solved = skin.model.solve(&conductivity, &mut workspace)?.measurements();
                    shown = fingers;
                }
                frame.assign(&solved);
                bar.inc();
            }
            Ok::<(), ReportError>(())
        })?;
        Ok(SequenceVoltages { frames, reference, rate_hz: self.rate_hz, notes })
    }

    /// True conductivity change, siemens, [frame, row, column], NaN outside the skin: the mean of
    /// each pixel, on 4 x 4 points.
    pub fn truth(&self, background_s: f64, raster: &Raster) -> Array3<f64> {
        let (side, pixel_m) = (raster.pixels(), raster.pixel_m());
        let offsets = [-0.375, -0.125, 0.125, 0.375].map(|part| part * pixel_m);
        let mut images = Array3::from_elem((self.positions_m.len(), side, side), f64::NAN);
        for (mut image, fingers) in images.axis_iter_mut(Axis(0)).zip(&self.positions_m) {
            for &[row, column] in raster.masked_pixels() {
                let [x, y] = raster.centre_m(row, column);
                let points = offsets.iter().flat_map(|dx| offsets.map(|dy| [x + dx, y + dy]));
                let sum: f64 = points.map(|point| self.change(point, fingers)).sum();
                image[[row, column]] = background_s * sum / 16.0;
            }
        }
        images
    }
}
