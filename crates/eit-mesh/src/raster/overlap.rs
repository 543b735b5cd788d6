//! Computes the areas that triangles share with the pixels of a grid, by exact clipping.
//!
//! Everything is in pixel units `[column, row]` (row downwards), so the result does not depend on
//! the size of the skin. A triangle is cut along the rows of the grid and each strip along its
//! columns (Sutherland and Hodgman 1974, keeping both sides of every cut). The pieces share their
//! cut points, so their areas add up to that of the triangle to rounding.

use crate::{MeshError, Surface};
use ndarray::Array2;

/// Fraction of a triangle's area that may be inverted in projection, or by which a pixel may be
/// covered more than once, before the surface counts as folded: far above rounding and far below
/// any visible fold.
const FOLD: f64 = 1e-9;

/// A grid of square pixels over the bounding box of a surface.
pub(super) struct Grid {
    pub(super) pixels: usize,
    pub(super) pixel_m: f64,
    /// Corner of the bounding box with the smallest x and the largest y, metres.
    corner_m: [f64; 2],
    /// Position of that corner in pixel units: half of the grid's excess over the box.
    margin: [f64; 2],
}

impl Grid {
    /// Creates a grid centred on the bounding box, as wide as its longer side. `pixels` is at least
    /// 1.
    pub(super) fn new(surface: &Surface, pixels: usize) -> Self {
        let [low, high] = surface.bounds_m();
        let (width_m, height_m) = (high[0] - low[0], high[1] - low[1]);
        let pixel_m = width_m.max(height_m) / pixels as f64;
        let margin = [width_m, height_m].map(|side_m| 0.5 * (pixels as f64 - side_m / pixel_m));
        Self { pixels, pixel_m, corner_m: [low[0], high[1]], margin }
    }

    /// Outer edges, metres: `[x_min, x_max, y_min, y_max]`.
    pub(super) fn extent_m(&self) -> [f64; 4] {
        let side_m = self.pixels as f64 * self.pixel_m;
        let x_min = self.corner_m[0] - self.margin[0] * self.pixel_m;
        let y_max = self.corner_m[1] + self.margin[1] * self.pixel_m;
        [x_min, x_min + side_m, y_max - side_m, y_max]
    }

    /// Corners of a triangle in pixel units. A coordinate within rounding of a grid line is moved
    /// onto it, so that meshes that follow the grid leave no slivers in neighbouring pixels.
    fn corners(&self, surface: &Surface, triangle: usize) -> [[f64; 2]; 3] {
        let rounding = 4.0 * self.pixels as f64 * f64::EPSILON;
        let snap = |x: f64| if (x - x.round()).abs() <= rounding { x.round() } else { x };
        surface.corners(triangle).map(|[x, y, _]| {
            let column = (x - self.corner_m[0]) / self.pixel_m + self.margin[0];
            let row = (self.corner_m[1] - y) / self.pixel_m + self.margin[1];
            [snap(column), snap(row)]
        })
    }

    /// Centroid of a triangle in pixel units.
    pub(super) fn centroid(&self, surface: &Surface, triangle: usize) -> [f64; 2] {
        let [a, b, c] = self.corners(surface, triangle);
        [(a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0]
    }

    /// Range of pixels from the one that contains `low` to the one that ends at or after `high`.
    fn range(&self, low: f64, high: f64) -> (usize, usize) {
        let last = self.pixels - 1;
        let first = (low.max(0.0) as usize).min(last);
        (first, (high.ceil() as usize).saturating_sub(1).clamp(first, last))
    }
}

/// Shared areas, in units of pixel area, triangle by triangle.
pub(super) struct Overlaps {
    starts: Vec<usize>,
    /// Pixel `row * pixels + column` and shared area, ascending by pixel.
    entries: Vec<(u32, f64)>,
}

impl Overlaps {
    /// Computes the shared areas and the covered fraction of every pixel [row, column].
    pub(super) fn new(surface: &Surface, grid: &Grid) -> Result<(Self, Array2<f64>), MeshError> {
        check_seen_from_above(surface)?;
        let triangles = surface.triangles().len();
        let mut coverage = Array2::zeros((grid.pixels, grid.pixels));
        let mut overlaps = Self { starts: vec![0], entries: Vec::with_capacity(2 * triangles) };
        for t in 0..triangles {
            let start = overlaps.entries.len();
            clip(grid, grid.corners(surface, t), &mut overlaps.entries);
            for &(pixel, area) in &overlaps.entries[start..] {
                let place = [pixel as usize / grid.pixels, pixel as usize % grid.pixels];
                coverage[place] += area;
                if coverage[place] > 1.0 + FOLD {
                    let [row, column] = place;
                    return Err(MeshError::OverlappingSheets { triangle: t, row, column });
                }
            }
            overlaps.starts.push(overlaps.entries.len());
        }
        Ok((overlaps, coverage))
    }

    /// Number of triangles.
    pub(super) fn triangles(&self) -> usize {
        self.starts.len() - 1
    }

    /// Pixels and shared areas of one triangle, which must exist.
    pub(super) fn of(&self, triangle: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.entries[self.starts[triangle]..self.starts[triangle + 1]].iter().copied()
    }
}

/// Rejects triangles that face downwards, and surfaces that are upright as a whole.
fn check_seen_from_above(surface: &Surface) -> Result<(), MeshError> {
    let (mut projected_m2, mut area_m2) = (0.0, 0.0);
    for (triangle, &own_m2) in surface.areas_m2().iter().enumerate() {
        let [a, b, c] = surface.corners(triangle);
        let up_m2 = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
        if up_m2 < -FOLD * own_m2 {
            return Err(MeshError::FoldedSurface { triangle });
        }
        projected_m2 += up_m2;
        area_m2 += own_m2;
    }
    if projected_m2 > FOLD * area_m2 {
        Ok(())
    } else {
        Err(MeshError::UprightSurface { projected_m2, area_m2 })
    }
}

/// A convex polygon: a triangle cut by two rows and two columns has at most 7 corners.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [[f64; 2]; 8],
    count: usize,
}

impl Polygon {
    const EMPTY: Self = Self { corners: [[0.0; 2]; 8], count: 0 };

    fn push(&mut self, corner: [f64; 2]) {
        if let Some(place) = self.corners.get_mut(self.count) {
            *place = corner;
            self.count += 1;
        }
    }

    fn corners(&self) -> &[[f64; 2]] {
        &self.corners[..self.count]
    }

    /// Smallest and largest coordinate along an axis.
    fn bounds(&self, axis: usize) -> (f64, f64) {
        self.corners()
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), c| (l.min(c[axis]), h.max(c[axis])))
    }

    /// Area by the shoelace formula about the first corner, for either orientation.
    fn area(&self) -> f64 {
        let Some((o, rest)) = self.corners().split_first() else { return 0.0 };
        let cross = |p: &[[f64; 2]]| {
            (p[0][0] - o[0]) * (p[1][1] - o[1]) - (p[0][1] - o[1]) * (p[1][0] - o[0])
        };
        0.5 * rest.windows(2).map(cross).sum::<f64>().abs()
    }

    /// Splits the polygon at `at` along an axis into the parts below and above.
    ///
    /// Cut points stay between the ends of their edge, so coordinates still rise once and fall once
    /// around the polygon, and each cut adds at most one corner to a part.
    fn split(&self, axis: usize, at: f64) -> (Self, Self) {
        let (mut below, mut above) = (Self::EMPTY, Self::EMPTY);
        let corners = self.corners();
        for (k, &a) in corners.iter().enumerate() {
            let b = if k + 1 < corners.len() { corners[k + 1] } else { corners[0] };
            if a[axis] <= at {
                below.push(a);
            }
            if a[axis] >= at {
                above.push(a);
            }
            if (a[axis] < at && at < b[axis]) || (b[axis] < at && at < a[axis]) {
                let other = 1 - axis;
                let t = (at - a[axis]) / (b[axis] - a[axis]);
                let (low, high) = (a[other].min(b[other]), a[other].max(b[other]));
                let mut cut = [at; 2];
                cut[other] = (a[other] + t * (b[other] - a[other])).clamp(low, high);
                below.push(cut);
                above.push(cut);
            }
        }
        (below, above)
    }
}

/// Appends the pixels that a triangle (in pixel units) meets, with the shared areas, in row-major
/// order.
fn clip(grid: &Grid, corners: [[f64; 2]; 3], entries: &mut Vec<(u32, f64)>) {
    let mut rest = Polygon::EMPTY;
    corners.iter().for_each(|&c| rest.push(c));
    let (low, high) = rest.bounds(1);
    let (first_row, last_row) = grid.range(low, high);
    for row in first_row..=last_row {
        let mut strip = rest;
        if row < last_row {
            (strip, rest) = rest.split(1, (row + 1) as f64);
        }
        if strip.count < 3 {
            continue;
        }
        let (left, right) = strip.bounds(0);
        let (first_column, last_column) = grid.range(left, right);
        let mut keep = |column: usize, area: f64| {
            if area > 0.0 {
                entries.push(((row * grid.pixels + column) as u32, area));
            }
        };
        for column in first_column..last_column {
            let (piece, beyond) = strip.split(0, (column + 1) as f64);
            keep(column, piece.area());
            strip = beyond;
        }
        keep(last_column, strip.area());
    }
}
