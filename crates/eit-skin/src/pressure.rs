//! Pressure of touches: the force that was learnt, over the area that the touch has in its image.
//!
//! The area A of a touch is that of the pixels around its place whose value is at least half of the peak there. The
//! mean pressure is F / A; the map spreads F over these pixels in proportion to the image. Images of total variation
//! and one-step images are wider than the contact, so that their pressures are too small; a U-net trained with the
//! tips that touch the skin restores the width (`docs/validation/unet.md`).

use crate::error::SkinError;
use crate::reconstruct::Reconstruction;
use eit_inverse::touch::{Touch, TouchState};
use ndarray::{Array2, Array3, ArrayView2, Axis};

/// Standard deviation of a place that is rounded to whole steps, in steps: uniform within half a step.
const ROUNDING: f64 = 0.288_675_134_594_812_9;

/// Number of pixels within which an image has the peak of a touch: places are off by 3 mm (95 %) on the paper's skin, whose
/// 64 pixels are 3 mm wide.
const BESIDE: usize = 2;

/// Pressure images of a recording, and the mean pressure of each touch.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Pressures {
    /// Pressure, pascal, [frame, row, column]; NaN outside the skin.
    pub images_pa: Array3<f64>,
    /// Mean pressure for each row of the touches; `None` without a force, and where the image does not show the touch.
    pub touches: Vec<Option<MeanPressure>>,
}

/// Mean pressure of a touch in a frame.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MeanPressure {
    /// Area of the touch in the image, square metres.
    pub area_m2: f64,
    /// Force over area, pascal.
    pub pressure_pa: f64,
    /// Its standard deviation, pascal: that of the force, and an outline of the area that is rounded to pixels. `None`
    /// where no U-net trained for this skin has restored the width of the contact: then the pressure is a lower bound.
    pub std_pa: Option<f64>,
}

/// The pixels of a touch.
struct Print {
    pixels: Vec<[usize; 2]>,
    /// Number of sides of these pixels on the outline.
    sides: usize,
}

impl Reconstruction {
    /// Returns the pressures; `None` if no valid touch has a force.
    ///
    /// # Errors
    ///
    /// The errors of the raster.
    pub fn pressures(&self) -> Result<Option<Pressures>, SkinError> {
        let Some(found) = &self.touches else { return Ok(None) };
        let is_shown = |touch: &Touch| touch.valid && touch.state != TouchState::End;
        if !found.rows.iter().any(|row| is_shown(&row.touch) && row.touch.force_n().is_some()) {
            return Ok(None);
        }
        let raster = &self.images.raster;
        let areas_m2 = raster.image_from_pixels(raster.covered_areas_m2())?;
        let sign = self.fitted.skin.skin.settings.touch.sign.factor();
        let mut images_pa =
            self.images.values.mapv(|value| if value.is_nan() { value } else { 0.0 });
        let mut touches = Vec::with_capacity(found.rows.len());
        for rows in found.rows.chunk_by(|a, b| a.frame == b.frame) {
            let frame = rows[0].frame;
            let image = self.images.values.index_axis(Axis(0), frame).mapv(|value| sign * value);
            let place = |touch: &Touch| raster.pixel_at([touch.position_m[0], touch.position_m[1]]);
            let shown = rows.iter().map(|row| &row.touch).filter(|touch| is_shown(touch));
            let places: Vec<[usize; 2]> = shown.filter_map(place).collect();
            for touch in rows.iter().map(|row| &row.touch) {
                let force = touch.force_n().zip(touch.force_std_n()).filter(|_| is_shown(touch));
                let of_touch = force.zip(place(touch)).and_then(|(force, start)| {
                    let print = Print::around(image.view(), start, &places)?;
                    let mut pressures = images_pa.index_axis_mut(Axis(0), frame);
                    let sum: f64 = print.pixels.iter().map(|&at| image[at] * areas_m2[at]).sum();
                    print.pixels.iter().for_each(|&at| pressures[at] += force.0 * image[at] / sum);
                    let mean = print.mean(force, &areas_m2, raster.pixel_m());
                    let std_pa = mean.std_pa.filter(|_| self.cleaned_frames[frame]);
                    Some(MeanPressure { std_pa, ..mean })
                });
                touches.push(of_touch);
            }
        }
        Ok(Some(Pressures { images_pa, touches }))
    }
}

impl Print {
    /// Finds the pixels of the touch at `start`: from the largest value within [`BESIDE`] to all neighbours of at least
    /// half of it and at most it, which artefacts at electrodes exceed, that are not nearer to another touch. `None` where
    /// the image has no positive value there.
    fn around(
        image: ArrayView2<'_, f64>,
        start: [usize; 2],
        places: &[[usize; 2]],
    ) -> Option<Self> {
        let squared = |[r, c]: [usize; 2], [row, column]: [usize; 2]| {
            r.abs_diff(row).pow(2) + c.abs_diff(column).pow(2)
        };
        let is_nearest =
            |at: [usize; 2]| places.iter().all(|&other| squared(at, start) <= squared(at, other));
        let (rows, columns) = image.dim();
        let within =
            |at: usize, most: usize| at.saturating_sub(BESIDE)..(at + BESIDE + 1).min(most);
        let near = within(start[0], rows)
            .flat_map(|row| within(start[1], columns).map(move |column| [row, column]));
        let peak = near
            .filter(|&at| image[at].is_finite() && is_nearest(at))
            .max_by(|&a, &b| image[a].total_cmp(&image[b]))?;
        let (most, level) = (image[peak], image[peak] / 2.0);
        if level <= 0.0 {
            return None;
        }
        let is_own = |at: [usize; 2]| (level..=most).contains(&image[at]) && is_nearest(at);
        let mut seen = Array2::from_elem(image.dim(), false);
        seen[peak] = true;
        let (mut pixels, mut next) = (vec![peak], 0);
        while let Some(&at) = pixels.get(next) {
            next += 1;
            for near in neighbours(at, image.dim()) {
                if !seen[near] && is_own(near) {
                    seen[near] = true;
                    pixels.push(near);
                }
            }
        }
        let inner = |&at: &[usize; 2]| neighbours(at, image.dim()).filter(|&at| seen[at]).count();
        let sides = pixels.iter().map(|at| 4 - inner(at)).sum();
        Some(Self { pixels, sides })
    }

    /// Mean pressure for a force and its standard deviation, newtons.
    fn mean(
        &self,
        (force_n, std_n): (f64, f64),
        areas_m2: &Array2<f64>,
        pixel_m: f64,
    ) -> MeanPressure {
        let area_m2: f64 = self.pixels.iter().map(|&at| areas_m2[at]).sum();
        let outline_m = self.sides as f64 * pixel_m;
        let pressure_pa = force_n / area_m2;
        let std = (std_n / force_n).hypot(ROUNDING * pixel_m * outline_m / area_m2);
        MeanPressure { area_m2, pressure_pa, std_pa: Some(pressure_pa * std) }
    }
}

/// The pixels, at most four, beside a pixel of an image of this size.
fn neighbours(
    [row, column]: [usize; 2],
    (rows, columns): (usize, usize),
) -> impl Iterator<Item = [usize; 2]> {
    let above = row.checked_sub(1).map(|row| [row, column]);
    let left = column.checked_sub(1).map(|column| [row, column]);
    let below = (row + 1 < rows).then_some([row + 1, column]);
    let right = (column + 1 < columns).then_some([row, column + 1]);
    [above, left, below, right].into_iter().flatten()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;

    /// A square of 5 x 4 pixels beside a weaker one: pixels, outline, mean pressure and its error in closed form.
    #[test]
    fn a_square_has_its_own_area() {
        let mut image = Array2::from_shape_fn((20, 20), |place| match place {
            (3..8, 4..8) => 2.0,
            (3..8, 8..12) => 1.9,
            _ => 0.0,
        });
        let places = [[5, 5], [5, 10]];
        let print = Print::around(image.view(), places[0], &places).unwrap();
        // pixels that are nearer to the other touch are the other's
        assert_eq!((print.pixels.len(), print.sides), (5 * 4, 18));
        let areas_m2 = Array2::from_elem((20, 20), 4e-6);
        let mean = print.mean((1.6, 0.16), &areas_m2, 2e-3);
        assert!((mean.pressure_pa - 2e4).abs() < 1e-9 * 2e4, "{mean:?}");
        let rounding = 2e-3 / 12.0_f64.sqrt() * 18.0 * 2e-3 / 8e-5;
        assert!((mean.std_pa.unwrap() / 2e4 - 0.1_f64.hypot(rounding)).abs() < 1e-12, "{mean:?}");
        // a spot at an electrode is stronger than the touch and is not part of it
        image[[4, 3]] = 1.5;
        for column in 0..3 {
            image[[4, column]] = 9.0;
        }
        let beside = Print::around(image.view(), places[0], &places).unwrap();
        assert_eq!((beside.pixels.len(), beside.sides), (5 * 4 + 1, 18 + 2));
        // nothing positive, or nothing at all
        assert!(Print::around(image.view(), [15, 15], &[[15, 15]]).is_none());
        image.fill(f64::NAN);
        assert!(Print::around(image.view(), places[0], &places).is_none());
    }
}
