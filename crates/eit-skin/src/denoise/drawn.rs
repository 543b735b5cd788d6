//! Touches that were detected without an image, drawn as an image: what a net sharpens.

use crate::touches::Touches;
use eit_inverse::touch::{DetectorStep, Touch, TouchState};
use eit_mesh::Raster;
use ndarray::Array2;
use std::f64::consts::TAU;

/// Standard deviation of a drawn bell in pixels. On the paper's skin at 64 pixels it is 4 mm, about that of the
/// change under a finger; samples of a bell as wide as a pixel and more add up to its integral (within 1e-14).
const WIDTH: f64 = 1.3;
/// Standard deviations beyond which a bell is not drawn: 3e-4 of its height.
const REACH: f64 = 4.0;

/// The touches of a frame as a net sees them.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnTouches {
    /// All that have not ended.
    pub touches: Vec<DrawnTouch>,
    /// Whether they, or the absence of any, explain the frame ([`DetectorStep::is_explained`]); a net's image of a frame
    /// that nothing explains is not shown.
    pub is_explained: bool,
}

impl DrawnTouches {
    /// Returns those of each frame of a recording.
    pub fn of_frames(touches: &Touches) -> Vec<Self> {
        let all = touches.by_frame().into_iter().zip(&touches.steps);
        let of = |(touches, step): (Vec<Touch>, &DetectorStep)| Self {
            touches: touches.iter().filter_map(DrawnTouch::of).collect(),
            is_explained: step.is_explained(),
        };
        all.map(of).collect()
    }
}

/// A touch as it is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnTouch {
    /// Position as seen from +z, metres.
    pub position_m: [f64; 2],
    /// Integral of the conductivity change, S m^2, with its sign.
    pub intensity_s_m2: f64,
}

impl DrawnTouch {
    /// Returns how a touch is drawn; `None` for one that has ended.
    pub fn of(touch: &Touch) -> Option<Self> {
        let [x, y, _] = touch.position_m;
        (touch.state != TouchState::End)
            .then_some(Self { position_m: [x, y], intensity_s_m2: touch.intensity_s_m2 })
    }

    /// Adds it to an image [row, column], siemens: a Gaussian bell with the touch's integral.
    pub(super) fn draw(&self, raster: &Raster, image: &mut Array2<f64>) {
        let pixel_m = raster.pixel_m();
        let [x0, y0] = raster.centre_m(0, 0);
        let [x, y] = self.position_m;
        // rows run downwards
        let centre = [(y0 - y) / pixel_m, (x - x0) / pixel_m];
        let range = |centre: f64, count: usize| {
            let most = (centre + REACH * WIDTH + 1.0).clamp(0.0, count as f64) as usize;
            (((centre - REACH * WIDTH).ceil().max(0.0) as usize).min(most))..most
        };
        let height_s = self.intensity_s_m2 / (TAU * WIDTH * WIDTH * pixel_m * pixel_m);
        let (rows, columns) = image.dim();
        for row in range(centre[0], rows) {
            for column in range(centre[1], columns) {
                let d2 = (row as f64 - centre[0]).powi(2) + (column as f64 - centre[1]).powi(2);
                image[[row, column]] += height_s * (-0.5 * d2 / (WIDTH * WIDTH)).exp();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;
    use eit_mesh::Surface;

    /// A square of four triangles.
    fn raster() -> Raster {
        let corners = [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.2, 0.0], [0.0, 0.2, 0.0]];
        let surface = Surface::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        Raster::new(&surface, 40).unwrap()
    }

    /// A bell inside the image has the touch's integral, its centre of mass at the touch, and its sign; one that has
    /// left the image leaves nothing.
    #[test]
    fn a_drawn_touch_has_its_integral_and_place() {
        let raster = raster();
        let mut image = Array2::zeros(raster.mask().dim());
        let touch = DrawnTouch { position_m: [0.061, 0.127], intensity_s_m2: -3e-10 };
        touch.draw(&raster, &mut image);
        let area = raster.pixel_m().powi(2);
        let (mut sum, mut place) = (0.0, [0.0; 2]);
        for ((row, column), value) in image.indexed_iter() {
            let [x, y] = raster.centre_m(row, column);
            sum += value * area;
            place = [place[0] + x * value * area, place[1] + y * value * area];
        }
        // the tail beyond four standard deviations: 3e-4
        assert!((sum / -3e-10 - 1.0).abs() < 1e-3, "{sum}");
        assert!((place[0] / sum - 0.061).abs() < 1e-5 && (place[1] / sum - 0.127).abs() < 1e-5);
        let mut image = Array2::zeros(raster.mask().dim());
        DrawnTouch { position_m: [0.5, -0.5], intensity_s_m2: 1e-10 }.draw(&raster, &mut image);
        assert!(image.iter().all(|value| *value == 0.0));
    }
}
