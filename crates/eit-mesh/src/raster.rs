//! Conversion between surface and pixels: a square grid over the skin and two area-weighted
//! operators.
//!
//! Let `A[p, t]` be the area shared by pixel `p` and triangle `t`, computed by exact clipping
//! (`raster/overlap.rs`), `c[p] = sum_t A[p, t]` the covered area of a pixel and
//! `a[t] = sum_{p in mask} A[p, t]` the part of a triangle under the mask. Then
//!
//! ```text
//! pixel_from_element[p, t] = A[p, t] / c[p]        element_from_pixel[t, p] = A[p, t] / a[t]
//! ```
//!
//! Rows sum to one, so constants are preserved, and no value leaves the range of its sources.
//!
//! **Conservation.** `sum_p c[p] y[p] = sum_t a[t] x[t]` holds for `y = pixel_from_element x` and
//! for `x = element_from_pixel y`: the integral over the part of the skin under the mask is
//! preserved. If every touched pixel is in the mask, `a[t]` is the whole triangle and the integral
//! over the skin is preserved. Rim pixels that are less than half covered are outside the mask, and
//! the skin under them belongs to no pixel.
//!
//! **Order.** Sampling a linear function at the centroids and converting it to pixels gives an
//! error of at most `|gradient| h` (h the longest edge) at the centres of fully covered pixels, and
//! O(h^2 / pixel) once triangles are smaller than pixels: only the triangles cut by a pixel's sides
//! contribute an error, O(h) each, and they make up O(h / pixel) of the pixel. For the opposite
//! direction the same holds with the two sizes exchanged.
//!
//! **Curved surfaces** are projected along z: all areas above are areas in the x-y plane. A surface
//! that overlaps itself in this view is rejected, because a pixel would mix two layers.

mod operators;
mod overlap;

use crate::{CsrMatrix, MeshError, Surface};
use ndarray::{Array2, Array3, ArrayView2, ArrayViewMut2};
use operators::{element_from_pixel, masked_area, masked_numbers, pixel_from_element};
use overlap::{Grid, Overlaps};

/// Minimum covered fraction of a pixel in the mask. It is reduced by the rounding of the sum, so
/// that pixels covered exactly by half are treated alike everywhere.
const MASK_COVERAGE: f64 = 0.5 - 1e-9;

/// A grid of n x n square pixels over a skin, with operators between its pixels and triangles.
///
/// The grid is centred on the skin's bounding box and as wide as its longer side; row 0 is at the
/// top (largest y), column 0 at the left (smallest x). A pixel belongs to the mask if the skin
/// covers at least half of its area. Masked pixels are numbered in row-major order.
///
/// # Example
/// ```
/// use eit_mesh::{Raster, Surface};
///
/// let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let surface = Surface::new(corners, vec![[0, 1, 2], [0, 2, 3]])?;
/// let raster = Raster::new(&surface, 2)?;
/// let image = raster.image_from_elements(&[3.0, 5.0])?;
/// // upper left in the second triangle, upper right half in each
/// assert_eq!((image[[0, 0]], image[[0, 1]]), (5.0, 4.0));
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    pixel_m: f64,
    extent_m: [f64; 4],
    coverage: Array2<f64>,
    mask: Array2<bool>,
    masked_pixels: Vec<[usize; 2]>,
    covered_areas_m2: Vec<f64>,
    masked_areas_m2: Vec<f64>,
    pixel_from_element: CsrMatrix,
    element_from_pixel: CsrMatrix,
}

impl Raster {
    /// Creates a raster of `pixels` x `pixels` over the surface.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`] unless `pixels` is from 1 to 4096, [`MeshError::NoMaskedPixel`] if
    /// no pixel is half covered, [`MeshError::UprightSurface`], [`MeshError::FoldedSurface`] or
    /// [`MeshError::OverlappingSheets`] if the surface is edge-on or overlaps itself when seen from
    /// +z.
    pub fn new(surface: &Surface, pixels: usize) -> Result<Self, MeshError> {
        // at 4096 squared, coverage alone takes 134 MB
        let is_valid = (1..=4096).contains(&pixels);
        MeshError::check_range(is_valid, "pixels", pixels as f64, "from 1 to 4096")?;
        let grid = Grid::new(surface, pixels);
        let (overlaps, coverage) = Overlaps::new(surface, &grid)?;
        let mask = coverage.mapv(|c| c >= MASK_COVERAGE);
        let masked_pixels: Vec<[usize; 2]> =
            mask.indexed_iter().filter(|(_, m)| **m).map(|((r, c), _)| [r, c]).collect();
        if masked_pixels.is_empty() {
            let largest = coverage.iter().copied().fold(0.0, f64::max);
            return Err(MeshError::NoMaskedPixel { pixels, largest });
        }
        let numbers = masked_numbers(&mask);
        let pixel_m2 = grid.pixel_m * grid.pixel_m;
        let masked_areas_m2 =
            (0..surface.triangles().len()).map(|t| pixel_m2 * masked_area(&overlaps, t, &numbers));
        Ok(Self {
            pixel_m: grid.pixel_m,
            extent_m: grid.extent_m(),
            covered_areas_m2: masked_pixels.iter().map(|&p| coverage[p] * pixel_m2).collect(),
            masked_areas_m2: masked_areas_m2.collect(),
            pixel_from_element: pixel_from_element(&overlaps, &numbers, masked_pixels.len()),
            element_from_pixel: element_from_pixel(surface, &grid, &overlaps, &numbers, &mask),
            coverage,
            mask,
            masked_pixels,
        })
    }

    /// Number of pixels per side: images are [`pixels`, `pixels`].
    pub fn pixels(&self) -> usize {
        self.mask.nrows()
    }

    /// Side of a pixel, metres.
    pub fn pixel_m(&self) -> f64 {
        self.pixel_m
    }

    /// Outer edges of the grid, metres: `[x_min, x_max, y_min, y_max]`.
    pub fn extent_m(&self) -> [f64; 4] {
        self.extent_m
    }

    /// Centre of a pixel, metres: `[x, y]`.
    pub fn centre_m(&self, row: usize, column: usize) -> [f64; 2] {
        let [x_min, _, _, y_max] = self.extent_m;
        [x_min + (column as f64 + 0.5) * self.pixel_m, y_max - (row as f64 + 0.5) * self.pixel_m]
    }

    /// Returns the pixel `[row, column]` that contains a point (metres), or `None` outside the
    /// grid.
    pub fn pixel_at(&self, position_m: [f64; 2]) -> Option<[usize; 2]> {
        let [x_min, x_max, y_min, y_max] = self.extent_m;
        let inside =
            (x_min..=x_max).contains(&position_m[0]) && (y_min..=y_max).contains(&position_m[1]);
        let index = |distance_m: f64| ((distance_m / self.pixel_m) as usize).min(self.pixels() - 1);
        inside.then(|| [index(y_max - position_m[1]), index(position_m[0] - x_min)])
    }

    /// Which pixels belong to the skin: [row, column].
    pub fn mask(&self) -> &Array2<bool> {
        &self.mask
    }

    /// Fraction of each pixel's area that the skin covers, 0 to 1: [row, column]. Its sum times the
    /// area of a pixel is the (projected) area of the skin.
    pub fn coverage(&self) -> &Array2<f64> {
        &self.coverage
    }

    /// `[row, column]` of each masked pixel, in the order of the operators: row-major.
    pub fn masked_pixels(&self) -> &[[usize; 2]] {
        &self.masked_pixels
    }

    /// Area of skin in each masked pixel (`c` in the formulas of the module), square metres.
    pub fn covered_areas_m2(&self) -> &[f64] {
        &self.covered_areas_m2
    }

    /// Area of each triangle under the mask (`a` in the formulas of the module), square metres;
    /// zero for a triangle that meets no masked pixel.
    pub fn masked_areas_m2(&self) -> &[f64] {
        &self.masked_areas_m2
    }

    /// Operator from triangle values to masked pixel values: [masked pixel, triangle]; rows sum to
    /// one.
    pub fn pixel_from_element(&self) -> &CsrMatrix {
        &self.pixel_from_element
    }

    /// Operator from masked pixel values to triangle values: [triangle, masked pixel]; rows sum to
    /// one.
    ///
    /// A triangle that meets no masked pixel takes the value of the one whose centre is nearest to
    /// its centroid (the first, if several are equally near).
    pub fn element_from_pixel(&self) -> &CsrMatrix {
        &self.element_from_pixel
    }

    /// Converts masked pixel values to an image [row, column], NaN outside the mask.
    ///
    /// # Errors
    /// [`MeshError::WrongLength`].
    pub fn image_from_pixels(&self, pixels: &[f64]) -> Result<Array2<f64>, MeshError> {
        let mut image = Array2::zeros(self.mask.raw_dim());
        self.image_from_pixels_into(pixels, image.view_mut())?;
        Ok(image)
    }

    /// Does the same as [`image_from_pixels`](Self::image_from_pixels) without allocating.
    ///
    /// # Errors
    /// [`MeshError::WrongLength`].
    pub fn image_from_pixels_into(
        &self,
        pixels: &[f64],
        mut image: ArrayViewMut2<'_, f64>,
    ) -> Result<(), MeshError> {
        MeshError::check_length("masked pixels", pixels.len(), self.masked_pixels.len())?;
        MeshError::check_length("image rows", image.nrows(), self.pixels())?;
        MeshError::check_length("image columns", image.ncols(), self.pixels())?;
        image.fill(f64::NAN);
        for (&place, &value) in self.masked_pixels.iter().zip(pixels) {
            image[place] = value;
        }
        Ok(())
    }

    /// Converts frames [frame, masked pixel] to images [frame, row, column], NaN outside the mask.
    ///
    /// # Errors
    /// [`MeshError::WrongLength`].
    pub fn images_from_pixels(
        &self,
        frames: ArrayView2<'_, f64>,
    ) -> Result<Array3<f64>, MeshError> {
        MeshError::check_length("masked pixels", frames.ncols(), self.masked_pixels.len())?;
        let shape = (frames.nrows(), self.pixels(), self.pixels());
        let mut images = Array3::from_elem(shape, f64::NAN);
        for (frame, mut image) in frames.rows().into_iter().zip(images.outer_iter_mut()) {
            for (&place, &value) in self.masked_pixels.iter().zip(frame) {
                image[place] = value;
            }
        }
        Ok(images)
    }

    /// Converts triangle values to an image [row, column], NaN outside the mask.
    ///
    /// # Errors
    /// [`MeshError::WrongLength`].
    pub fn image_from_elements(&self, elements: &[f64]) -> Result<Array2<f64>, MeshError> {
        let mut pixels = vec![0.0; self.masked_pixels.len()];
        self.pixel_from_element.apply(elements, &mut pixels)?;
        self.image_from_pixels(&pixels)
    }

    /// Copies the masked pixels of an image [row, column] in the order of the operators, without
    /// allocating: the inverse of [`image_from_pixels_into`](Self::image_from_pixels_into).
    ///
    /// # Errors
    /// [`MeshError::WrongLength`].
    pub fn pixels_from_image_into(
        &self,
        image: ArrayView2<'_, f64>,
        pixels: &mut [f64],
    ) -> Result<(), MeshError> {
        MeshError::check_length("masked pixels", pixels.len(), self.masked_pixels.len())?;
        MeshError::check_length("image rows", image.nrows(), self.pixels())?;
        MeshError::check_length("image columns", image.ncols(), self.pixels())?;
        for (&place, value) in self.masked_pixels.iter().zip(pixels) {
            *value = image[place];
        }
        Ok(())
    }
}
