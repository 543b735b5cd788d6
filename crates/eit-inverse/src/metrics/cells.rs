//! Cells of an image as figures of merit need them: areas, positions, neighbours.

use crate::InverseError;
use crate::check::{check_length, check_range};
use eit_mesh::{Raster, Surface};
use std::collections::HashMap;

/// Cells of an image in its order: the elements of a surface (three dimensions) or the masked pixels of a
/// raster (two).
///
/// Built once and used for every image on the same grid. Two cells are neighbours if they share a side.
/// Pixels that touch at a corner are not neighbours, nor are elements that touch at a node.
#[derive(Debug, Clone, PartialEq)]
pub struct Cells<const D: usize> {
    areas_m2: Vec<f64>,
    positions_m: Vec<[f64; D]>,
    neighbours: Vec<[Option<u32>; 4]>,
}

impl Cells<3> {
    /// Returns the elements of a surface: areas, centroids, elements across each side.
    pub fn of_surface(surface: &Surface) -> Self {
        let across = |[a, b, c]: [Option<u32>; 3]| [a, b, c, None];
        Self {
            areas_m2: surface.areas_m2().to_vec(),
            positions_m: surface.centroids(),
            neighbours: surface.neighbours().into_iter().map(across).collect(),
        }
    }
}

impl Cells<2> {
    /// Returns the masked pixels of a raster: covered areas, centres, masked pixels across each side.
    pub fn of_raster(raster: &Raster) -> Self {
        let places = raster.masked_pixels();
        let number: HashMap<[usize; 2], u32> = places.iter().copied().zip(0..).collect();
        let at = |row: Option<usize>, column: Option<usize>| {
            row.zip(column).and_then(|(r, c)| number.get(&[r, c]).copied())
        };
        let across = |&[r, c]: &[usize; 2]| {
            [
                at(r.checked_sub(1), Some(c)),
                at(r.checked_add(1), Some(c)),
                at(Some(r), c.checked_sub(1)),
                at(Some(r), c.checked_add(1)),
            ]
        };
        Self {
            areas_m2: raster.covered_areas_m2().to_vec(),
            positions_m: places.iter().map(|&[r, c]| raster.centre_m(r, c)).collect(),
            neighbours: places.iter().map(across).collect(),
        }
    }
}

impl<const D: usize> Cells<D> {
    /// Returns the area of each cell, square metres, `[cell]`.
    pub fn areas_m2(&self) -> &[f64] {
        &self.areas_m2
    }

    /// Returns the centre of each cell, metres, `[cell]`.
    pub fn positions_m(&self) -> &[[f64; D]] {
        &self.positions_m
    }

    /// Returns the cells across the sides of a cell, which must exist.
    pub(crate) fn neighbours(&self, cell: usize) -> impl Iterator<Item = usize> {
        self.neighbours[cell].into_iter().flatten().map(|n| n as usize)
    }

    /// Returns the integral of an image over the skin, `sum x_k area_k`, in the image's unit times square
    /// metres (for a sheet conductivity: S m^2). Non-finite values are ignored.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn integral(&self, values: &[f64]) -> Result<f64, InverseError> {
        self.check("values", values)?;
        let finite = values.iter().zip(&self.areas_m2).filter(|(x, _)| x.is_finite());
        Ok(finite.map(|(x, area)| x * area).sum())
    }

    /// Rejects images of the wrong length.
    pub(crate) fn check(&self, what: &'static str, values: &[f64]) -> Result<(), InverseError> {
        check_length(what, values.len(), self.areas_m2.len())
    }

    /// Returns the area-weighted mean position of some cells and their area; NaN if there are none.
    pub(super) fn centre(&self, cells: impl Iterator<Item = usize>) -> ([f64; D], f64) {
        self.weighted_centre(cells.map(|k| (k, 1.0)))
    }

    /// Returns the mean position of some cells, weighted by area times the given weight, and the sum of
    /// those weights; NaN if there are none.
    pub(super) fn weighted_centre(
        &self,
        cells: impl Iterator<Item = (usize, f64)>,
    ) -> ([f64; D], f64) {
        let (mut moment, mut total) = ([0.0; D], 0.0);
        for (k, weight) in cells {
            let weight = weight * self.areas_m2[k];
            moment.iter_mut().zip(self.positions_m[k]).for_each(|(m, p)| *m += weight * p);
            total += weight;
        }
        (moment.map(|m| m / total), total)
    }
}

/// Rejects non-finite positions.
pub(crate) fn check_place<const D: usize>(
    quantity: &'static str,
    place_m: &[f64; D],
) -> Result<(), InverseError> {
    place_m.iter().try_for_each(|x| check_range(quantity, *x, x.is_finite(), "finite"))
}
