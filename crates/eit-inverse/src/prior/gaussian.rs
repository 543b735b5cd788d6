//! Gaussian smoothness prior: covariance that decays with distance.

use super::Prior;
use crate::InverseError;
use crate::check::{check_length, check_positive, check_range};
use crate::geometry::{distance_m, extent_m};
use eit_mesh::Surface;
use ndarray::{Array2, ArrayView2};
use std::collections::BTreeMap;

/// Kernel support in kernel widths: `exp(-4^2 / 2)` is 3e-4, less than an image can show.
const SUPPORT: f64 = 4.0;

/// Spacing of the sources in kernel widths. A Gaussian sampled at half its width is integrated with a
/// relative error of `2 exp(-4 pi^2)` on a regular grid. The remaining error, from lumping elements into
/// cells, is of second order in the spacing.
const SOURCE_SPACING: f64 = 0.5;

/// Default correlation length as a fraction of the skin's extent.
const DEFAULT_LENGTH: f64 = 0.1;

/// Measurements processed together, so that each kernel value is loaded once for all of them.
const LANES: usize = 8;

/// Settings of [`Gaussian`].
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct GaussianSettings {
    /// Correlation length `l`, metres: at distance `l` the correlation is `exp(-1/2)`. `None` (default): a
    /// tenth of the skin's extent (longest side of its bounding box).
    pub length_m: Option<f64>,
}

/// Prior for smooth images with a given correlation length: `P_ab = exp(-|x_a - x_b|^2 / (2 l^2))`.
///
/// It is built as `P = G G'`, so it is positive semi-definite by construction:
///
/// ```text
/// G_aq = n_a sqrt(area_q) exp(-|x_a - y_q|^2 / l^2),  zero beyond 4 widths of l / sqrt(2)
/// ```
///
/// `x_a` are the element centroids. `y_q` are sources: the area centroids of the elements in each cell of a
/// cubic grid of spacing `l / (2 sqrt 2)`, with the cell's area. Broad kernels thus need few sources, and
/// `G` has about `200 n` entries however fine the mesh (fewer if elements are larger than cells). `n_a`
/// makes `P_aa = 1`, at the rim too. Distances are straight lines in space, so on a folded skin, points
/// that face each other closely count as neighbours.
///
/// If elements are larger than `l`, neighbours become independent and the prior is white noise per element.
/// A product `J P` costs `4 m` flops per entry of `G`.
///
/// Source: squared-exponential covariance, Rasmussen, Williams, *Gaussian Processes for Machine
/// Learning* (2006), section 4.2; as a sum over sources, Higdon, *Space and space-time modeling
/// using process convolutions* (2002).
#[derive(Debug, Clone)]
pub struct Gaussian {
    sources: usize,
    /// First entry of each element in `source` and `kernel`, `[element + 1]`.
    starts: Vec<usize>,
    source: Vec<u32>,
    kernel: Vec<f64>,
}

impl Gaussian {
    /// Builds `G`.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`] for a length that is not positive, or so small compared with the skin
    /// that its cells cannot be numbered (1e-9 of the extent).
    pub fn new(surface: &Surface, settings: &GaussianSettings) -> Result<Self, InverseError> {
        let extent = extent_m(surface);
        let length_m = settings.length_m.unwrap_or(DEFAULT_LENGTH * extent);
        check_positive("length_m", length_m)?;
        let is_long = length_m > 1e-9 * extent;
        check_range("length_m", length_m, is_long, "above 1e-9 of the skin's extent")?;
        let width_m = length_m / std::f64::consts::SQRT_2;
        // relative to the skin's corner, so that cell numbers stay small wherever the skin lies
        let [low, _] = surface.bounds_m();
        let mut centroids = surface.centroids();
        centroids.iter_mut().for_each(|c| (0..3).for_each(|k| c[k] -= low[k]));
        let cells = Cells::new(surface, &centroids, SOURCE_SPACING * width_m);
        let mut prior = Self {
            sources: cells.sources.len(),
            starts: vec![0],
            source: Vec::new(),
            kernel: Vec::new(),
        };
        for &centroid in &centroids {
            let from = prior.kernel.len();
            for (q, distance) in cells.within(centroid, SUPPORT * width_m) {
                let (_, area) = cells.sources[q];
                prior.source.push(q as u32);
                prior.kernel.push(area.sqrt() * (-0.5 * (distance / width_m).powi(2)).exp());
            }
            // the element's own source lies within one cell, so the norm is not zero
            let norm = prior.kernel[from..].iter().map(|g| g * g).sum::<f64>().sqrt();
            prior.kernel[from..].iter_mut().for_each(|g| *g /= norm);
            prior.starts.push(prior.kernel.len());
        }
        Ok(prior)
    }

    /// Multiplies eight rows at once by `G G'`: `rows` [element * LANES], through `sources`.
    fn smooth(&self, rows: &mut [[f64; LANES]], sources: &mut [[f64; LANES]]) {
        sources.fill([0.0; LANES]);
        for (row, span) in rows.iter().zip(self.starts.windows(2)) {
            for (&q, &g) in self.entries(span) {
                let sum = &mut sources[q as usize];
                (0..LANES).for_each(|lane| sum[lane] += g * row[lane]);
            }
        }
        for (row, span) in rows.iter_mut().zip(self.starts.windows(2)) {
            let mut sum = [0.0; LANES];
            for (&q, &g) in self.entries(span) {
                let value = &sources[q as usize];
                (0..LANES).for_each(|lane| sum[lane] += g * value[lane]);
            }
            *row = sum;
        }
    }

    /// Returns the sources and kernel values of one element; `span` is a window of `starts`.
    fn entries(&self, span: &[usize]) -> impl Iterator<Item = (&u32, &f64)> {
        self.source[span[0]..span[1]].iter().zip(&self.kernel[span[0]..span[1]])
    }
}

impl Prior for Gaussian {
    fn name(&self) -> &'static str {
        "gaussian"
    }

    fn covariance_times(
        &self,
        weighted_jacobian: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, InverseError> {
        let (rows, size) = weighted_jacobian.dim();
        check_length("Jacobian columns", size, self.starts.len() - 1)?;
        let mut product = Array2::zeros((rows, size));
        let mut block = vec![[0.0; LANES]; size];
        let mut sources = vec![[0.0; LANES]; self.sources];
        for first in (0..rows).step_by(LANES) {
            let lanes = LANES.min(rows - first);
            for lane in 0..lanes {
                let row = weighted_jacobian.row(first + lane);
                block.iter_mut().zip(row).for_each(|(b, x)| b[lane] = *x);
            }
            self.smooth(&mut block, &mut sources);
            for lane in 0..lanes {
                let row = product.row_mut(first + lane);
                row.into_iter().zip(&block).for_each(|(x, b)| *x = b[lane]);
            }
        }
        Ok(product)
    }
}

/// Elements grouped by the cells of a cubic grid.
struct Cells {
    /// Area centroid (metres) and area (square metres) of the elements in each cell.
    sources: Vec<([f64; 3], f64)>,
    /// Sources by coarse bucket of one support radius; a tree keeps the order deterministic.
    buckets: BTreeMap<[i64; 3], Vec<usize>>,
    bucket_m: f64,
}

impl Cells {
    fn new(surface: &Surface, centroids: &[[f64; 3]], spacing_m: f64) -> Self {
        let mut gathered: BTreeMap<[i64; 3], ([f64; 3], f64)> = BTreeMap::new();
        for (centroid, &area) in centroids.iter().zip(surface.areas_m2()) {
            let (moment, total) = gathered.entry(cell(*centroid, spacing_m)).or_default();
            (0..3).for_each(|k| moment[k] += area * centroid[k]);
            *total += area;
        }
        let sources: Vec<_> =
            gathered.into_values().map(|(m, area)| (m.map(|x| x / area), area)).collect();
        let bucket_m = spacing_m * SUPPORT / SOURCE_SPACING;
        let mut buckets: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
        for (q, (place, _)) in sources.iter().enumerate() {
            buckets.entry(cell(*place, bucket_m)).or_default().push(q);
        }
        Self { sources, buckets, bucket_m }
    }

    /// Returns the sources within `radius_m` (at most one bucket) of a point, with their distances.
    fn within(&self, place: [f64; 3], radius_m: f64) -> impl Iterator<Item = (usize, f64)> {
        let centre = cell(place, self.bucket_m);
        let bucket = move |index: i64| {
            let offset = [index % 3 - 1, index / 3 % 3 - 1, index / 9 - 1];
            self.buckets.get(&std::array::from_fn(|k| centre[k] + offset[k]))
        };
        let sources = (0..27).filter_map(bucket).flatten();
        let with_distance = move |&q: &usize| (q, distance_m(place, self.sources[q].0));
        sources.map(with_distance).filter(move |&(_, distance)| distance <= radius_m)
    }
}

fn cell(place: [f64; 3], spacing_m: f64) -> [i64; 3] {
    place.map(|x| (x / spacing_m).floor() as i64)
}
