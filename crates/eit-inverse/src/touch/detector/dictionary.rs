//! Response of the rows to a touch at each position.

use super::places::{Places, Spot};
use super::rows::Rows;
use super::settings::DetectorSettings;
use super::vectors::{dot, widest};
use super::whitening::Whitening;
use crate::InverseError;
use eit_mesh::Surface;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use ndarray::ArrayRef2;

/// The tail of the bell, `TAIL exp(-d / TAIL_RADII radius)`: fabric spreads the pressure of a finger.
const TAIL: f64 = 0.05;
const TAIL_RADII: f64 = 12.0 / 7.0;

/// Radii beyond which the bell is zero; the tail is 2e-3 of the peak there.
const REACH_RADII: f64 = 5.5;

/// Positions processed by one matrix product.
const AT_ONCE: usize = 128;

/// Positions whose squared sensitivity is below this fraction of the median are blind.
const BLIND: f64 = 0.02;

/// Response of the rows at each position to a touch of 1 S m^2, and its derivatives along the skin.
///
/// The bell is `g(d) = exp(-(d / radius)^2) + tail`, divided by its integral over the skin.
#[derive(Debug, Clone)]
pub(super) struct Dictionary {
    rows: usize,
    /// Volts of the model, `[place][value, along 1, along 2][row]`, without the rows' ratios.
    volts: Vec<f64>,
    /// Whitened values, `[place][row]`, as if no row were lost.
    values: Vec<f64>,
    /// Whitened derivatives, `[place][along 1, along 2][row]`.
    slopes: Vec<f64>,
    /// Squared length of the whitened values without the lost rows.
    squared: Vec<f64>,
    squared_of_all: Vec<f64>,
    /// The same with no local unknown free.
    squared_held: Vec<f64>,
    /// Products of the values with the local unknowns, without the lost rows: `[place][unknown]`.
    products: Vec<f64>,
    /// Cholesky factor of the free unknowns, and a row of it.
    factor: Vec<f64>,
    work: Vec<f64>,
    sees: Vec<bool>,
    sorted: Vec<f64>,
    /// Peak of a touch of 1 S m^2, 1 / m^2.
    tops: Vec<f64>,
}

impl Dictionary {
    pub(super) fn new(
        surface: &Surface,
        jacobian: &ArrayRef2<f64>,
        places: &Places,
        rows: &Rows,
        whitening: &Whitening,
        settings: &DetectorSettings,
    ) -> Result<Self, InverseError> {
        rows.check_finite(jacobian)?;
        let n = rows.of.len();
        let radius_m = settings.radius_m.max(1.4 * places.spacing_m);
        let (mut volts, tops) = columns(surface, jacobian, places, rows, radius_m);
        // If voltages are g times the model's, the sheet has 1 / g of the model's conductivity, and its
        // derivatives are g^2 times the model's: one factor is in the ratios, one here.
        let factor = settings.sign.factor() * rows.gain();
        volts.iter_mut().for_each(|v| *v *= factor);
        let (mut values, mut slopes) =
            (vec![0.0; places.len() * n], vec![0.0; 2 * places.len() * n]);
        let mut scaled = vec![0.0; n];
        let ratios: Vec<f64> = (0..n).map(|row| rows.ratio_of_row(row)).collect();
        for (k, column) in volts.chunks_exact(n).enumerate() {
            scaled.iter_mut().zip(column).zip(&ratios).for_each(|((s, v), r)| *s = r * v);
            let (place, part) = (k / 3, k % 3);
            let target = match part {
                0 => &mut values[place * n..(place + 1) * n],
                _ => &mut slopes[(2 * place + part - 1) * n..(2 * place + part) * n],
            };
            whitening.apply(&scaled, target);
        }
        let squared: Vec<f64> = values.chunks_exact(n).map(|v| dot(v, v)).collect();
        let mut made = Self {
            rows: n,
            sees: vec![true; places.len()],
            squared_of_all: squared.clone(),
            squared_held: squared.clone(),
            products: Vec::new(),
            factor: Vec::new(),
            work: Vec::new(),
            sorted: squared.clone(),
            volts,
            values,
            slopes,
            squared,
            tops,
        };
        made.multiply(whitening);
        made.look();
        Ok(made)
    }

    /// Updates sensitivities after rows were lost or came back.
    pub(super) fn update(&mut self, whitening: &Whitening) {
        self.squared_held.copy_from_slice(&self.squared_of_all);
        for direction in whitening.directions() {
            let places = self.squared_held.iter_mut().zip(self.values.chunks_exact(self.rows));
            places.for_each(|(squared, value)| *squared -= dot(direction, value).powi(2));
        }
        self.multiply(whitening);
        self.squared.copy_from_slice(&self.squared_held);
        self.look();
    }

    /// Multiplies the values with the local unknowns.
    fn multiply(&mut self, whitening: &Whitening) {
        self.products.clear();
        for value in self.values.chunks_exact(self.rows) {
            self.products.extend(whitening.local().map(|unknown| dot(unknown, value)));
        }
    }

    /// Updates sensitivities after other combinations of local unknowns became free: `d' d` becomes
    /// `d' (I + U U')^-1 d = d' d - |L^-1 U' d|^2` with `L L' = I + U' U`.
    pub(super) fn update_free(&mut self, whitening: &Whitening) {
        let (free, n, unknowns) = (whitening.combinations(), self.rows, whitening.local().count());
        let columns = whitening.free_columns();
        let count = columns.len() / n;
        self.factorise(columns, count);
        self.work.clear();
        self.work.resize(count, 0.0);
        let Self { squared, squared_held, products, factor, work, .. } = self;
        widest(
            #[inline(always)]
            || {
                for (place, squared) in squared.iter_mut().enumerate() {
                    *squared = squared_held[place];
                    let products = &products[place * unknowns..(place + 1) * unknowns];
                    for i in 0..count {
                        let (row, diagonal) = factor[i * count..=i * count + i].split_at(i);
                        let product = dot(products, &free[i * unknowns..(i + 1) * unknowns]);
                        let z = (product - dot(row, &work[..i])) / diagonal[0];
                        work[i] = z;
                        *squared -= z * z;
                    }
                }
            },
        );
    }

    /// Computes the Cholesky factor of `I + U' U` for `count` columns.
    fn factorise(&mut self, columns: &[f64], count: usize) {
        let column = |k: usize| &columns[k * self.rows..(k + 1) * self.rows];
        self.factor.clear();
        self.factor.resize(count * count, 0.0);
        for i in 0..count {
            for j in 0..=i {
                let (above, row) = self.factor.split_at_mut(i * count);
                let other = if i == j { &row[..j] } else { &above[j * count..j * count + j] };
                let part = dot(column(i), column(j)) - dot(&row[..j], other);
                row[j] = match i == j {
                    true => (1.0 + part).max(1.0).sqrt(),
                    false => part / above[j * count + j],
                };
            }
        }
    }

    /// Determines which positions the measurements can sense.
    fn look(&mut self) {
        self.sorted.copy_from_slice(&self.squared);
        self.sorted.sort_unstable_by(f64::total_cmp);
        let least = (BLIND * self.sorted[self.sorted.len() / 2]).max(f64::MIN_POSITIVE);
        // rounding leaves a little of what is lost
        self.sees
            .iter_mut()
            .zip(&self.squared)
            .zip(&self.squared_of_all)
            .for_each(|((sees, squared), whole)| *sees = *squared > least.max(1e-9 * whole));
    }

    /// Number of positions that the measurements can sense.
    pub(super) fn seen(&self) -> usize {
        self.sees.iter().filter(|sees| **sees).count()
    }

    /// Returns the decrease of chi^2 from a single touch of positive strength at a position; 0 if the
    /// position is blind.
    ///
    /// `residual` must be mapped back to vectors without free unknowns, see [`Whitening::project_back`].
    #[inline(always)]
    pub(super) fn gain(&self, place: usize, residual: &[f64]) -> f64 {
        if !self.sees[place] {
            return 0.0;
        }
        let product = dot(&self.values[place * self.rows..(place + 1) * self.rows], residual);
        if product > 0.0 { product * product / self.squared[place] } else { 0.0 }
    }

    /// Adds the response of the rows to a touch at a spot, in volts of the model: without the rows' ratios.
    pub(super) fn add_volts(&self, spot: &Spot, strength_s_m2: f64, out: &mut [f64]) {
        let n = self.rows;
        let all = &self.volts[3 * spot.place * n..3 * (spot.place + 1) * n];
        let [a, b] = spot.step_m;
        for (i, out) in out.iter_mut().enumerate() {
            *out += strength_s_m2 * (all[i] + a * all[n + i] + b * all[2 * n + i]);
        }
    }

    /// Whitened response at a position and its derivatives, as if no row were lost.
    pub(super) fn own(&self, place: usize) -> [&[f64]; 3] {
        let n = self.rows;
        let slope = |k: usize| &self.slopes[(2 * place + k) * n..(2 * place + k + 1) * n];
        [&self.values[place * n..(place + 1) * n], slope(0), slope(1)]
    }

    /// Peak of a touch of 1 S m^2 at a position, 1 / m^2.
    pub(super) fn top(&self, place: usize) -> f64 {
        self.tops[place]
    }
}

/// Computes the responses, `[place][value, along 1, along 2][row]`, and the peaks.
fn columns(
    surface: &Surface,
    jacobian: &ArrayRef2<f64>,
    places: &Places,
    rows: &Rows,
    radius_m: f64,
) -> (Vec<f64>, Vec<f64>) {
    let (n, elements) = (rows.of.len(), surface.triangles().len());
    // [row, element]
    let folded = Mat::from_fn(n, elements, |row, e| {
        let [i, j] = rows.of[row];
        0.5 * (jacobian[(i, e)] + jacobian[(j, e)])
    });
    let centroids = surface.centroids();
    let areas = surface.areas_m2();
    let (mut volts, mut tops) = (Vec::with_capacity(places.len() * 3 * n), Vec::new());
    for chunk in places.at.chunks(AT_ONCE) {
        let mut bells = Mat::<f64>::zeros(elements, 3 * chunk.len());
        for (k, place) in chunk.iter().enumerate() {
            let (mut whole, mut slope_of_whole) = (0.0, [0.0; 2]);
            let mut touched: Vec<(usize, [f64; 3])> = Vec::new();
            for (e, (centroid, area)) in centroids.iter().zip(areas).enumerate() {
                let Some(bell) = bell(centroid, place.position_m, &place.tangents, radius_m) else {
                    continue;
                };
                whole += area * bell[0];
                (0..2).for_each(|t| slope_of_whole[t] += area * bell[t + 1]);
                touched.push((e, bell));
            }
            tops.push((1.0 + TAIL) / whole);
            for (e, bell) in touched {
                bells[(e, 3 * k)] = bell[0] / whole;
                for t in 0..2 {
                    bells[(e, 3 * k + t + 1)] =
                        (bell[t + 1] - bell[0] * slope_of_whole[t] / whole) / whole;
                }
            }
        }
        let mut product = Mat::<f64>::zeros(n, bells.ncols());
        matmul(product.as_mut(), Accum::Replace, folded.as_ref(), bells.as_ref(), 1.0, Par::Seq);
        product.col_iter().for_each(|column| volts.extend(column.iter()));
    }
    (volts, tops)
}

/// Value of the bell at a point; zero beyond its reach.
#[cfg(feature = "learn")]
pub(crate) fn bell_at(point: &[f64; 3], centre: [f64; 3], radius_m: f64) -> f64 {
    bell(point, centre, &[[0.0; 3]; 2], radius_m).map_or(0.0, |[value, ..]| value)
}

/// Value of the bell at a point and its derivatives along the tangents of the centre; `None` beyond its
/// reach.
fn bell(
    point: &[f64; 3],
    centre: [f64; 3],
    tangents: &[[f64; 3]; 2],
    radius_m: f64,
) -> Option<[f64; 3]> {
    let way: [f64; 3] = std::array::from_fn(|i| point[i] - centre[i]);
    let squared: f64 = way.iter().map(|w| w * w).sum();
    if squared > (REACH_RADII * radius_m).powi(2) {
        return None;
    }
    let (d, tail_m) = (squared.sqrt(), TAIL_RADII * radius_m);
    let core = (-squared / (radius_m * radius_m)).exp();
    let tail = TAIL * (-d / tail_m).exp();
    // derivative along the centre: 2 way / radius^2 and way / (d tail)
    let per_way = 2.0 * core / (radius_m * radius_m) + tail / (tail_m * d.max(0.1 * radius_m));
    let along = |t: usize| per_way * (0..3).map(|i| way[i] * tangents[t][i]).sum::<f64>();
    Some([core + tail, along(0), along(1)])
}
