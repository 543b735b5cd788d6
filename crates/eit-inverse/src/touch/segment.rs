//! Segmentation of an image into blobs above its noise floor, with position, strength and certainty.

use super::noise::NoiseFloor;
use crate::metrics::{Cells, ChangeSign, NONE, Watershed};

/// Rules that separate a blob from noise, artefacts and its neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rules {
    pub(super) sign: ChangeSign,
    /// Floor, in standard deviations of the cell.
    pub(super) level: f64,
    /// Least peak relative to the largest of the image.
    pub(super) relative_floor: f64,
    /// Least height of the lower of two peaks above their saddle, relative to that peak.
    pub(super) prominence: f64,
}

/// A connected part of an image above the threshold.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) hill: u32,
    pub(super) top: usize,
    pub(super) position_m: [f64; 3],
    pub(super) covariance_m2: [[f64; 3]; 3],
    pub(super) area_m2: f64,
    /// Signed, S m^2.
    pub(super) integral: f64,
    /// Signed, siemens.
    pub(super) peak: f64,
    /// Sum of the weights of the centre, S m^2.
    weight: f64,
    /// Peak in standard deviations of its cell.
    pub(super) level: f64,
}

/// Finds blobs; [`run`](Self::run) does not allocate.
#[derive(Debug, Clone)]
pub(super) struct Segmenter {
    pub(super) cells: Cells<3>,
    pub(super) watershed: Watershed,
    heights: Vec<f64>,
    /// Derivative of a centre with respect to the sources of noise, `[coordinate, source]`.
    gradient: [Vec<f64>; 3],
    pub(super) spots: Vec<Spot>,
    most: usize,
}

impl Segmenter {
    pub(super) fn new(cells: Cells<3>, sources: usize, most: usize) -> Self {
        let count = cells.areas_m2().len();
        Self {
            watershed: Watershed::new(count),
            heights: vec![0.0; count],
            gradient: std::array::from_fn(|_| vec![0.0; sources]),
            spots: Vec::with_capacity(most),
            most,
            cells,
        }
    }

    /// Fills `spots`, highest peak first, up to its capacity, and returns how many blobs were left out.
    pub(super) fn run(&mut self, image: &[f64], floor: &NoiseFloor, rules: &Rules) -> usize {
        let factor = if rules.sign == ChangeSign::Increase { 1.0 } else { -1.0 };
        self.heights.iter_mut().zip(image).for_each(|(h, x)| *h = factor * x);
        let (heights, std) = (&self.heights, floor.std());
        let highest = heights.iter().copied().fold(0.0, f64::max);
        // half of the artefact floor: the skirts of a blob help to join its peaks
        let least = 0.5 * rules.relative_floor * highest;
        self.watershed.run(
            heights,
            &self.cells,
            |k| heights[k] > 0.0 && heights[k] >= (rules.level * std[k]).max(least),
            |top, saddle| {
                let prominence = heights[top] - heights[saddle];
                prominence >= rules.prominence * heights[top]
                    && prominence >= rules.level * std[top].max(std[saddle])
            },
        );
        self.spots.clear();
        let mut more = 0;
        for (hill, top) in self.watershed.hills() {
            if self.heights[top] < rules.relative_floor * highest {
                break;
            }
            if self.spots.len() == self.most {
                more += 1;
                continue;
            }
            let peak = factor * self.heights[top];
            let level = self.heights[top] / std[top];
            let mut spot = Spot {
                hill,
                top,
                position_m: [0.0; 3],
                covariance_m2: [[0.0; 3]; 3],
                area_m2: 0.0,
                integral: 0.0,
                peak,
                weight: 0.0,
                level,
            };
            measure(&self.watershed, &self.heights, &self.cells, &mut spot);
            spot.integral *= factor;
            spot.covariance_m2 = covariance(
                &self.watershed,
                &self.heights,
                &self.cells,
                floor,
                &spot,
                &mut self.gradient,
            );
            self.spots.push(spot);
        }
        more
    }
}

impl Segmenter {
    /// Clears everything, as after an image of zeros.
    pub(super) fn clear(&mut self) {
        self.watershed.clear();
        self.spots.clear();
    }

    /// Returns the hill of the cell nearest to a position; `None` if that cell is below the floor.
    pub(super) fn hill_at(&self, place_m: [f64; 3]) -> Option<u32> {
        if self.watershed.is_empty() {
            return None;
        }
        let distance = |p: &[f64; 3]| (0..3).map(|i| (p[i] - place_m[i]).powi(2)).sum::<f64>();
        let places = self.cells.positions_m().iter().enumerate();
        let nearest = places.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
        let hill = nearest.map(|(cell, _)| self.watershed.hill(cell));
        hill.filter(|hill| *hill != NONE)
    }
}

/// Returns the cells of a blob: those of its hill that reach half of its peak.
fn members<'a>(
    watershed: &'a Watershed,
    heights: &'a [f64],
    spot: &Spot,
) -> impl Iterator<Item = usize> + use<'a> {
    let (hill, half) = (spot.hill, 0.5 * heights[spot.top]);
    watershed
        .cells()
        .take_while(move |&k| heights[k] >= half)
        .filter(move |&k| watershed.hill(k) == hill)
}

/// Computes area and integral of a blob, and the centroid of what rises above half of its peak.
///
/// Cells at the edge have no weight, so cells that come and go there do not move the centroid.
fn measure(watershed: &Watershed, heights: &[f64], cells: &Cells<3>, spot: &mut Spot) {
    let (areas, places) = (cells.areas_m2(), cells.positions_m());
    let (mut moment, mut total, half) = ([0.0; 3], 0.0, 0.5 * heights[spot.top]);
    for k in members(watershed, heights, spot) {
        let weight = (heights[k] - half) * areas[k];
        spot.area_m2 += areas[k];
        spot.integral += heights[k] * areas[k];
        total += weight;
        moment.iter_mut().zip(places[k]).for_each(|(m, p)| *m += weight * p);
    }
    spot.weight = total;
    spot.position_m = moment.map(|m| m / total);
}

/// Computes the covariance of the centre `c = sum w p / sum w`, `w = a (x - x_top / 2)`, from
/// `dc = sum a_k (p_k - c) (dx_k - dx_top / 2) / sum w` and the factor of the image's noise.
fn covariance(
    watershed: &Watershed,
    heights: &[f64],
    cells: &Cells<3>,
    floor: &NoiseFloor,
    spot: &Spot,
    gradient: &mut [Vec<f64>; 3],
) -> [[f64; 3]; 3] {
    let (areas, places) = (cells.areas_m2(), cells.positions_m());
    gradient.iter_mut().for_each(|g| g.fill(0.0));
    let mut sums = [0.0; 3];
    for k in members(watershed, heights, spot) {
        let sources = floor.sources_of(k);
        for (axis, gradient) in gradient.iter_mut().enumerate() {
            let slope = areas[k] * (places[k][axis] - spot.position_m[axis]) / spot.weight;
            sums[axis] += slope;
            // skips the third coordinate of flat skins
            if slope != 0.0 {
                gradient.iter_mut().zip(sources).for_each(|(g, f)| *g += slope * f);
            }
        }
    }
    let top = floor.sources_of(spot.top);
    for (gradient, sum) in gradient.iter_mut().zip(sums) {
        gradient.iter_mut().zip(top).for_each(|(g, f)| *g -= 0.5 * sum * f);
    }
    std::array::from_fn(|i| {
        std::array::from_fn(|j| gradient[i].iter().zip(&gradient[j]).map(|(a, b)| a * b).sum())
    })
}
