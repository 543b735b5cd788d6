//! Touches that were detected without an image, drawn as an image: what a net sharpens.

#[cfg(doc)]
use crate::fitted::FittedFrames;
use crate::touches::Touches;
use eit_inverse::touch::{DetectorStep, Touch, TouchState};
use eit_mesh::Raster;
use ndarray::{Array2, ArrayView2, ArrayViewMut2};
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
/// left still differs by some percent, and the net draws that. Squared error on the script `one-finger`, of the raw image's: with
/// zero 0.064 instead of 0.059 without a limit (seed 6411), with this 0.061 as without (seed 6601).
const MOST_FAR: f64 = 0.05;
/// A touch's blob has its largest value within this distance, in pixels; on the paper's skin at 64 pixels 12 mm.
const OWN: f64 = 4.0;
/// Limit of a blob that is no touch's, as a part of the largest value near touches: less than the half that makes a blob
/// in figures of merit and for eyes.
const MOST_OTHER: f64 = 0.4;

/// The touches of a frame as a net sees them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DrawnTouches {
    /// Touches that have not ended.
    pub touches: Vec<DrawnTouch>,
    /// Whether they, or the absence of any, explain the frame ([`DetectorStep::is_explained`]); a net's image of a frame
    /// that nothing explains is not shown.
    pub is_explained: bool,
}

impl DrawnTouches {
    /// Returns those of each frame of a recording; `image_per_strength`: see [`FittedFrames::image_per_strength`].
    pub(crate) fn of_frames(touches: &Touches, image_per_strength: f64) -> Vec<Self> {
        let all = touches.by_frame().into_iter().zip(&touches.steps);
        let of = |(touches, step): (Vec<Touch>, &DetectorStep)| Self {
            touches: touches
                .iter()
                .filter_map(|touch| DrawnTouch::of(touch, image_per_strength))
                .collect(),
            is_explained: step.is_explained,
        };
        all.map(of).collect()
    }
}

/// Position and size of a touch on a skin's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DrawnTouch {
    /// Position as seen from +z, metres.
    pub position_m: [f64; 2],
    /// Integral of the change in the image, S m^2, with its sign.
    pub intensity_s_m2: f64,
}

impl DrawnTouch {
    /// Returns how a touch is drawn in images of the skin; `None` for one that has ended. `image_per_strength`: see
    /// [`FittedFrames::image_per_strength`].
    pub(crate) fn of(touch: &Touch, image_per_strength: f64) -> Option<Self> {
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
        let height_s = self.intensity_s_m2 / (TAU * WIDTH * WIDTH * pixel_m * pixel_m);
        for (at, d2) in square(centre, REACH * WIDTH, image.dim()) {
            image[at] += height_s * (-0.5 * d2 / (WIDTH * WIDTH)).exp();
        }
    }
}

/// Pixels of an image of this size that are at most `reach` rows and columns from a place, row by row, with their
/// squared distance from it in pixels.
fn square(
    centre: [f64; 2],
    reach: f64,
    (rows, columns): (usize, usize),
) -> impl Iterator<Item = ([usize; 2], f64)> {
    let range = move |centre: f64, count: usize| {
        let most = (centre + reach + 1.0).clamp(0.0, count as f64) as usize;
        (((centre - reach).ceil().max(0.0) as usize).min(most))..most
    };
    let pixels = range(centre[0], rows)
        .flat_map(move |row| range(centre[1], columns).map(move |column| [row, column]));
    pixels.map(move |at| (at, d2(at, centre)))
}

/// Squared distance of a pixel from a place, in pixels.
fn d2([row, column]: [usize; 2], centre: [f64; 2]) -> f64 {
    (row as f64 - centre[0]).powi(2) + (column as f64 - centre[1]).powi(2)
}

/// The pixel of largest value, of either sign, and that value's size; `None` where all are zero or NaN (outside the skin).
fn largest(
    image: ArrayView2<'_, f64>,
    pixels: impl Iterator<Item = [usize; 2]>,
) -> Option<([usize; 2], f64)> {
    pixels.fold(None, |top, at| {
        let size = image[at].abs();
        if size > top.map_or(0.0, |(_, most)| most) { Some((at, size)) } else { top }
    })
}

/// What is near the touches of a frame.
#[derive(Debug, Clone)]
pub(super) struct Surroundings {
    /// Row and column of each touch, in pixels.
    touches: Vec<[f64; 2]>,
    /// Squared distance of each pixel from the nearest touch, in pixels.
    d2: Array2<f64>,
    /// Pixels of the touches' blobs.
    own: Array2<bool>,
    /// Pixels whose neighbours are not visited yet; never longer than the image.
    open: Vec<[usize; 2]>,
}

impl Surroundings {
    /// Creates the surroundings of no touch, for images of this size.
    pub(crate) fn new(size: (usize, usize)) -> Self {
        let (d2, own) = (Array2::from_elem(size, f64::INFINITY), Array2::from_elem(size, false));
        Self { touches: Vec::new(), d2, own, open: Vec::with_capacity(size.0 * size.1) }
    }

    /// Forgets the touches of the last frame.
    pub(crate) fn clear(&mut self) {
        self.touches.clear();
        self.d2.fill(f64::INFINITY);
    }

    /// Adds a touch of the frame.
    pub(crate) fn add(&mut self, touch: &DrawnTouch, raster: &Raster) {
        let place = touch.pixel(raster);
        self.touches.push(place);
        for ((row, column), nearest) in self.d2.indexed_iter_mut() {
            *nearest = nearest.min(d2([row, column], place));
        }
    }

    /// Limits an image [row, column] far from the touches ([`KEPT`], [`MOST_FAR`]) and in blobs that are no touch's
    /// ([`OWN`], [`MOST_OTHER`]), and sets it to zero if there are no touches.
    pub(crate) fn limit(&mut self, mut image: ArrayViewMut2<'_, f64>) {
        let [near, far] = KEPT;
        let near_touches = self.d2.indexed_iter().filter(|(_, d2)| **d2 <= near * near);
        let top = largest(image.view(), near_touches.map(|((row, column), _)| [row, column]));
        let peak = top.map_or(0.0, |(_, peak)| peak);
        image.zip_mut_with(&self.d2, |value, d2| {
            if *d2 > near * near {
                let nearness = ((far - d2.sqrt()) / (far - near)).max(0.0);
                let most = peak * (MOST_FAR + (1.0 - MOST_FAR) * nearness);
                *value = value.clamp(-most, most);
            }
        });
        let most = MOST_OTHER * peak;
        self.find_own(image.view(), top.map(|(at, _)| at), most);
        image.zip_mut_with(&self.own, |value, own| {
            if !own {
                *value = value.clamp(-most, most);
            }
        });
    }

    /// Finds the pixels above `level` that are connected, across sides, with the largest near a touch or of all.
    fn find_own(&mut self, image: ArrayView2<'_, f64>, top: Option<[usize; 2]>, level: f64) {
        let Self { touches, own, open, .. } = self;
        let is_high = |at: [usize; 2]| image.get(at).is_some_and(|value| value.abs() > level);
        own.fill(false);
        let mut add = |open: &mut Vec<[usize; 2]>, at: [usize; 2]| {
            if is_high(at) && !own[at] {
                own[at] = true;
                open.push(at);
            }
        };
        top.into_iter().for_each(|at| add(open, at));
        for touch in touches.iter() {
            let near = square(*touch, OWN, image.dim()).filter(|(_, d2)| *d2 <= OWN * OWN);
            let own_top = largest(image, near.map(|(at, _)| at));
            own_top.into_iter().for_each(|(at, _)| add(open, at));
        }
        while let Some([row, column]) = open.pop() {
            // one before the first row or column is far outside
            let before = |k: usize| k.wrapping_sub(1);
            let around = [
                [before(row), column],
                [row + 1, column],
                [row, before(column)],
                [row, column + 1],
            ];
            around.into_iter().for_each(|at| add(open, at));
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

    /// The touch at (10, 10) has the largest value, and its own blob, which extends 7 pixels, is kept. Other blobs 2
    /// or 6 pixels away, separate or joined by a low bridge, are limited, and so is one of the other sign. The blob
    /// of the second touch is kept. If no blob is near a touch, the blob with the largest value is kept.
    #[test]
    fn a_blob_of_no_touch_is_limited() {
        let raster = raster();
        let touch = |row: usize, column: usize| {
            let [x, y] = raster.centre_m(row, column);
            DrawnTouch { position_m: [x, y], intensity_s_m2: 1e-10 }
        };
        let mut near = Surroundings::new(raster.mask().dim());
        near.add(&touch(10, 10), &raster);
        near.add(&touch(30, 30), &raster);
        let mut image = Array2::zeros(raster.mask().dim());
        let mut line = |row: usize, columns: std::ops::Range<usize>, value: f64| {
            columns.for_each(|column| image[[row, column]] = value);
        };
        line(10, 10..18, 1.0);
        line(16, 10..13, 0.9);
        line(8, 4..5, -0.8);
        line(11, 3..5, 0.7);
        line(11, 5..11, 0.3);
        line(12, 10..11, 0.8);
        line(30, 30..31, 0.5);
        // by a corner only
        line(11, 18..19, 0.6);
        let before = image.clone();
        near.limit(image.view_mut());
        let places = [(10, 17), (12, 10), (16, 10), (8, 4), (11, 3), (11, 6), (30, 30), (11, 18)];
        let kept = places.map(|(row, column)| image[[row, column]]);
        assert_eq!(kept, [1.0, 0.4, 0.4, -0.4, 0.4, 0.3, 0.5, 0.4]);
        // the second frame is independent of the first
        image.assign(&before);
        near.limit(image.view_mut());
        assert_eq!(image[[10, 17]], 1.0);
        image.fill(0.0);
        (image[[10, 16]], image[[16, 10]]) = (1.0, 0.9);
        near.limit(image.view_mut());
        assert_eq!([image[[10, 16]], image[[16, 10]]], [1.0, 0.4]);
        // a touch without a blob of its own keeps none elsewhere, as in the first corner
        near.clear();
        near.add(&touch(3, 3), &raster);
        near.add(&touch(30, 30), &raster);
        image.fill(0.0);
        (image[[0, 0]], image[[30, 30]]) = (0.9, 1.0);
        near.limit(image.view_mut());
        assert_eq!([image[[0, 0]], image[[30, 30]]], [0.4, 1.0]);
    }
}
