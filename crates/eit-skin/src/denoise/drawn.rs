//! Touches that were detected without an image, drawn as an image: what a net sharpens.

#[cfg(doc)]
use crate::fitted::FittedFrames;
use crate::touches::Touches;
use eit_inverse::touch::{DetectorStep, Touch, TouchState};
use eit_mesh::Raster;
use ndarray::{Array2, ArrayViewMut2};
use std::f64::consts::TAU;

/// Standard deviation of a drawn bell in pixels. On the paper's skin at 64 pixels it is 4 mm, about that of the
/// change under a finger; samples of a bell as wide as a pixel and more add up to its integral (within 1e-14).
const WIDTH: f64 = 1.3;
/// Standard deviations beyond which a bell is not drawn: 3e-4 of its height.
const REACH: f64 = 4.0;
/// A net's image is kept up to the first distance from a drawn touch and limited from the second on, in pixels; on the
/// paper's skin at 64 pixels 25 and 34 mm. The net corrects a drawing; a blob that it shows far from every touch comes
/// from the artefacts of the raw image, above all beside a lost electrode, where those reach 80 mm.
const KEPT: [f64; 2] = [8.0, 11.0];
/// Limit of an image far from every touch, as a part of its largest value near them. Not zero: fabric that fingers have
/// left still differs by some percent, and the net draws that. Squared error on the paper's script, of the raw image's: with
/// zero 0.064 instead of 0.059 without a limit (seed 6411), with this 0.061 as without (seed 6601).
const MOST_FAR: f64 = 0.05;

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
    /// Returns those of each frame of a recording; `image_per_strength`: see [`FittedFrames::image_per_strength`].
    pub fn of_frames(touches: &Touches, image_per_strength: f64) -> Vec<Self> {
        let all = touches.by_frame().into_iter().zip(&touches.steps);
        let of = |(touches, step): (Vec<Touch>, &DetectorStep)| Self {
            touches: touches
                .iter()
                .filter_map(|touch| DrawnTouch::of(touch, image_per_strength))
                .collect(),
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
    /// Integral of the change in the image, S m^2, with its sign.
    pub intensity_s_m2: f64,
}

impl DrawnTouch {
    /// Returns how a touch is drawn in images of the skin; `None` for one that has ended. `image_per_strength`: see
    /// [`FittedFrames::image_per_strength`].
    pub fn of(touch: &Touch, image_per_strength: f64) -> Option<Self> {
        let [x, y, _] = touch.position_m;
        let intensity_s_m2 = image_per_strength * touch.intensity_s_m2;
        (touch.state != TouchState::End).then_some(Self { position_m: [x, y], intensity_s_m2 })
    }

    /// Row and column of its position, in pixels.
    fn pixel(&self, raster: &Raster) -> [f64; 2] {
        let [x0, y0] = raster.centre_m(0, 0);
        let [x, y] = self.position_m;
        // rows run downwards
        [(y0 - y) / raster.pixel_m(), (x - x0) / raster.pixel_m()]
    }

    /// Adds it to an image [row, column], siemens: a Gaussian bell with the touch's integral.
    pub(super) fn draw(&self, raster: &Raster, image: &mut Array2<f64>) {
        let pixel_m = raster.pixel_m();
        let centre = self.pixel(raster);
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

/// Squared distance of each pixel from the nearest touch of a frame, in pixels.
#[derive(Debug, Clone)]
pub(super) struct Surroundings(Array2<f64>);

impl Surroundings {
    /// Of no touch, for images of this size.
    pub fn new(size: (usize, usize)) -> Self {
        Self(Array2::from_elem(size, f64::INFINITY))
    }

    /// Forgets the touches of the last frame.
    pub fn clear(&mut self) {
        self.0.fill(f64::INFINITY);
    }

    /// Takes a touch of the frame.
    pub fn add(&mut self, touch: &DrawnTouch, raster: &Raster) {
        let [row, column] = touch.pixel(raster);
        for ((r, c), nearest) in self.0.indexed_iter_mut() {
            let d2 = (r as f64 - row).powi(2) + (c as f64 - column).powi(2);
            *nearest = nearest.min(d2);
        }
    }

    /// Limits an image [row, column] far from the touches ([`KEPT`], [`MOST_FAR`]), and sets it to zero if there are none.
    pub fn limit(&self, mut image: ArrayViewMut2<'_, f64>) {
        let [near, far] = KEPT;
        let near_values = image.iter().zip(&self.0).filter(|(_, d2)| **d2 <= near * near);
        // NaN outside the skin is not larger
        let peak = near_values.fold(0.0_f64, |peak, (value, _)| peak.max(value.abs()));
        image.zip_mut_with(&self.0, |value, d2| {
            if *d2 > near * near {
                let nearness = ((far - d2.sqrt()) / (far - near)).max(0.0);
                let most = peak * (MOST_FAR + (1.0 - MOST_FAR) * nearness);
                *value = value.clamp(-most, most);
            }
        });
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

    /// An image stays near each touch, is limited far from all, and NaN outside the skin; without touches it is zero.
    #[test]
    fn an_image_is_limited_far_from_touches() {
        let raster = raster();
        let touch = |row: usize, column: usize| {
            let [x, y] = raster.centre_m(row, column);
            DrawnTouch { position_m: [x, y], intensity_s_m2: 1e-10 }
        };
        let mut near = Surroundings::new(raster.mask().dim());
        near.add(&touch(3, 3), &raster);
        near.clear();
        let mut image = Array2::from_elem(raster.mask().dim(), 2.0);
        near.limit(image.view_mut());
        assert!(image.iter().all(|value| *value == 0.0));
        for (row, column) in [(10, 10), (10, 35)] {
            near.add(&touch(row, column), &raster);
        }
        image.fill(-2.0);
        (image[[10, 11]], image[[30, 30]]) = (f64::NAN, 0.04);
        near.limit(image.view_mut());
        assert!(image[[10, 11]].is_nan());
        // from the nearest touch: 0, 8, 7, 10, 11, 20 and, with a small value, 20.6 pixels
        let places = [(10, 10), (18, 10), (10, 28), (10, 20), (10, 21), (30, 10), (30, 30)];
        let kept = places.map(|(row, column)| image[[row, column]]);
        let between = -2.0 * (0.05 + 0.95 / 3.0);
        let wanted = [-2.0, -2.0, -2.0, between, -0.1, -0.1, 0.04];
        // rounding of places and roots
        let is_off = kept.iter().zip(wanted).any(|(a, b)| (a - b).abs() > 1e-9);
        assert!(!is_off, "{kept:?} {wanted:?}");
    }
}
