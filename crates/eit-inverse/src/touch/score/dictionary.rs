//! What a touch at each place does to the rows.
//!
//! | column | effect of | unit |
//! |---|---|---|
//! | 0 | a print `b(r) = exp(-(r / 7 mm)^2) + 0.05 exp(-r / 12 mm)`, its integral 1 | noise of a row per m^2 |
//! | 1 to 5 | its derivatives along the tangents of the place: `x`, `y`, `xx`, `xy`, `yy` | ... per m^3, m^4 |
//! | 6 | a ring `r^2 exp(-(r / 20 mm)^2)`, its integral 1 | ... per m^2 |
//! | 7 | a pull of the fabric `2 r0 r / (r^2 + r0^2)`, `r0` 15 mm, of 1 m at most | ... per m |
//! | 8, 9 | a drag of the fabric along each tangent, of 1 m at the finger | ... per m |
//! | 10 | the same pull on electrodes alone | ... per m |
//! | 11 | pressure on contacts, `exp(-r / 25 mm)` | ... per unit of ln z |
//!
//! Set-up takes `2 n E 7` flops a place for `E` triangles: 6 Mflop with 104 rows and 3 800 triangles.

use super::model::ScoreModel;
use super::places::Grid;
use super::settings::ScoreSettings;
use crate::geometry::distance_m;
use crate::touch::detector::{DetectorModel, Rows, UnknownKind};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use ndarray::ArrayRef2;

/// Number of columns of a place.
pub(super) const COLUMNS: usize = 12;
/// Number of prints and their derivatives among them.
const PRINTS: usize = 7;
/// First of the columns of a deformation and of electrodes alone.
pub(super) const PULL: usize = 7;
pub(super) const DRAG: usize = 8;
pub(super) const ELECTRODE_PULL: usize = 10;
pub(super) const PRESS: usize = 11;

/// Tail of the print: fabric spreads the pressure of a finger.
const TAIL: f64 = 0.05;
const TAIL_RADII: f64 = 12.0 / 7.0;
/// Radius within which the tail is blunt, in radii.
const BLUNT: f64 = 0.1;
/// Radius of the ring around a touch, in radii: 20 mm.
const RING_RADII: f64 = 20.0 / 7.0;
/// Step of tabulated prints, in radii: linear interpolation errs by at most 4.4e-6 of the peak.
const STEP: f64 = 1.0 / 256.0;
/// Distance up to which the print is integrated at four points of a triangle, in radii; one is enough beyond.
const NEAR_RADII: f64 = 3.0;
/// Radius of the strongest strain around a touch, metres.
const PULL_RADIUS_M: f64 = 15e-3;
/// Distance over which the pressure on contacts falls, metres.
pub(super) const CONTACT_M: f64 = 25e-3;
/// Places processed by one matrix product.
const AT_ONCE: usize = 64;

/// Columns of all places.
#[derive(Debug, Clone)]
pub(super) struct Dictionary {
    n: usize,
    /// `[place][column][row]`.
    columns: Vec<f64>,
    /// Peak of a touch of 1 m^2 at each place, 1 / m^2.
    pub(super) tops: Vec<f64>,
}

/// What [`Dictionary::new`] needs of a skin.
pub(super) struct Effects<'a, 'm> {
    pub(super) given: &'a ScoreModel<'m>,
    pub(super) rows: &'a Rows,
    /// Factor of each row: its ratio of measured to modelled voltage, over its noise.
    pub(super) scale: &'a [f64],
    /// Folded and scaled columns of the unknowns, `[unknown][row]`, per metre and unit of ln z.
    pub(super) unknowns: &'a [f64],
    /// Effects on the voltages at [`Grid::dents`], `[measurement, (place, effect)]`, volts per metre; may be empty.
    pub(super) dents_v: &'a ArrayRef2<f64>,
}

impl Dictionary {
    pub(super) fn new(grid: &Grid, effects: &Effects<'_, '_>, settings: &ScoreSettings) -> Self {
        let n = effects.rows.of.len();
        let mut made =
            Self { n, columns: vec![0.0; grid.at.len() * COLUMNS * n], tops: Vec::new() };
        made.set_prints(grid, effects, settings);
        made.set_dents(grid, effects);
        for (place, columns) in made.columns.chunks_exact_mut(COLUMNS * n).enumerate() {
            let at_m = grid.at[place].position_m;
            for (kind, unknown) in
                effects.given.skin.kinds.iter().zip(effects.unknowns.chunks_exact(n))
            {
                let (column, share) = match kind {
                    UnknownKind::Displacement { at_m: own_m, along } => {
                        let way: f64 = (0..3).map(|i| (at_m[i] - own_m[i]) * along[i]).sum();
                        let squared = distance_m(at_m, *own_m).powi(2);
                        let r0 = PULL_RADIUS_M;
                        (ELECTRODE_PULL, 2.0 * r0 * way / (squared + r0 * r0))
                    }
                    UnknownKind::Contact { at_m: own_m } => {
                        (PRESS, -(-distance_m(at_m, *own_m) / CONTACT_M).exp())
                    }
                    UnknownKind::Other => continue,
                };
                let out = &mut columns[column * n..(column + 1) * n];
                out.iter_mut().zip(unknown).for_each(|(o, u)| *o += share * u);
            }
        }
        made
    }

    /// The columns of a place, `[column][row]`.
    pub(super) fn of(&self, place: usize) -> &[f64] {
        &self.columns[place * COLUMNS * self.n..(place + 1) * COLUMNS * self.n]
    }

    fn set_prints(&mut self, grid: &Grid, effects: &Effects<'_, '_>, settings: &ScoreSettings) {
        let Effects { given: ScoreModel { skin, conductivity_s, .. }, rows, scale, .. } = *effects;
        let DetectorModel { surface, jacobian, .. } = skin;
        let (n, elements) = (self.n, surface.triangles().len());
        let folded = Mat::from_fn(n, elements, |row, e| {
            let [i, j] = rows.of[row];
            0.5 * scale[row] * conductivity_s * (jacobian[(i, e)] + jacobian[(j, e)])
        });
        let points: Vec<[[f64; 3]; 4]> =
            (0..elements).map(|e| points_of(surface.corners(e))).collect();
        let [low, high] = surface.bounds_m();
        let radius_m = settings.bell_m.max(1.75 * grid.pitch_m);
        let print = Print::new(radius_m, distance_m(low, high));
        let sign = settings.sign.factor();
        for (chunk, at) in grid.at.chunks(AT_ONCE).enumerate() {
            let mut prints = Mat::<f64>::zeros(elements, PRINTS * at.len());
            for (k, place) in at.iter().enumerate() {
                let mut wholes = [0.0; 2];
                for (e, (points, area)) in points.iter().zip(surface.areas_m2()).enumerate() {
                    let values = print.mean(points, place.position_m, &place.tangents);
                    wholes[0] += area * values[0];
                    wholes[1] += area * values[6];
                    (0..PRINTS).for_each(|c| prints[(e, PRINTS * k + c)] = values[c]);
                }
                for c in 0..PRINTS {
                    let factor = sign / wholes[usize::from(c == 6)].max(f64::MIN_POSITIVE);
                    (0..elements).for_each(|e| prints[(e, PRINTS * k + c)] *= factor);
                }
                self.tops.push((1.0 + TAIL) / wholes[0].max(f64::MIN_POSITIVE));
            }
            let mut product = Mat::<f64>::zeros(n, prints.ncols());
            matmul(
                product.as_mut(),
                Accum::Replace,
                folded.as_ref(),
                prints.as_ref(),
                1.0,
                Par::Seq,
            );
            for k in 0..at.len() {
                let from = (chunk * AT_ONCE + k) * COLUMNS * n;
                for c in 0..PRINTS {
                    let out = &mut self.columns[from + c * n..from + (c + 1) * n];
                    let column = product.col(PRINTS * k + c);
                    out.iter_mut().zip(column.iter()).for_each(|(o, v)| *o = *v);
                }
            }
        }
    }

    /// Interpolates the deformations between their sparser places.
    fn set_dents(&mut self, grid: &Grid, effects: &Effects<'_, '_>) {
        let n = self.n;
        if effects.dents_v.ncols() != 3 * grid.dents.len() {
            return;
        }
        for (place, columns) in self.columns.chunks_exact_mut(COLUMNS * n).enumerate() {
            let way =
                |k: usize| distance_m(grid.at[place].position_m, grid.at[grid.dents[k]].position_m);
            // places at least 2 pitches apart lie within 2 pitches of each point
            let reach_m = 3.0 * grid.pitch_m;
            let weight = |k: usize| (1.0 - way(k) / reach_m).max(0.0).powi(2);
            let near: Vec<(usize, f64)> =
                (0..grid.dents.len()).map(|k| (k, weight(k))).filter(|(_, w)| *w > 0.0).collect();
            let whole: f64 = near.iter().map(|(_, w)| w).sum();
            for (k, weight) in near {
                for effect in 0..3 {
                    let column = effects.dents_v.column(3 * k + effect);
                    let out = &mut columns[(PULL + effect) * n..(PULL + effect + 1) * n];
                    for (row, out) in out.iter_mut().enumerate() {
                        let [i, j] = effects.rows.of[row];
                        *out += weight / whole * 0.5 * effects.scale[row] * (column[i] + column[j]);
                    }
                }
            }
        }
    }
}

/// The centroid of a triangle, and three points between it and the corners.
fn points_of(corners: [[f64; 3]; 3]) -> [[f64; 3]; 4] {
    let centre: [f64; 3] =
        std::array::from_fn(|i| (0..3).map(|k| corners[k][i]).sum::<f64>() / 3.0);
    let towards = |k: usize| std::array::from_fn(|i| 0.6 * centre[i] + 0.4 * corners[k][i]);
    [centre, towards(0), towards(1), towards(2)]
}

/// The print and the ring around it as functions of the distance, tabulated: exponentials would take most of the set-up.
struct Print {
    radius_m: f64,
    /// `[radial]` at each [`STEP`] of a radius.
    table: Vec<[f64; 4]>,
}

impl Print {
    /// A print of this radius for distances up to `most_m`.
    fn new(radius_m: f64, most_m: f64) -> Self {
        let count = (most_m / (STEP * radius_m)).ceil() as usize + 2;
        let at = |k: usize| radial(k as f64 * STEP * radius_m, radius_m);
        Self { radius_m, table: (0..count).map(at).collect() }
    }

    /// Mean over a triangle of the print at a place, its derivatives with respect to the place, and the ring.
    fn mean(
        &self,
        points: &[[f64; 3]; 4],
        at_m: [f64; 3],
        tangents: &[[f64; 3]; 2],
    ) -> [f64; PRINTS] {
        if distance_m(points[0], at_m) > NEAR_RADII * self.radius_m {
            return self.at(points[0], at_m, tangents);
        }
        let each = points.map(|p| self.at(p, at_m, tangents));
        std::array::from_fn(|c| each.iter().map(|values| values[c]).sum::<f64>() / 4.0)
    }

    fn at(&self, point: [f64; 3], at_m: [f64; 3], tangents: &[[f64; 3]; 2]) -> [f64; PRINTS] {
        let way: [f64; 3] = std::array::from_fn(|i| at_m[i] - point[i]);
        let [x, y] = tangents.map(|t| (0..3).map(|i| t[i] * way[i]).sum::<f64>());
        let steps = way.iter().map(|w| w * w).sum::<f64>().sqrt() / (STEP * self.radius_m);
        let k = (steps as usize).min(self.table.len() - 2);
        let part = steps - k as f64;
        let (near, far) = (self.table[k], self.table[k + 1]);
        of_radial([x, y], std::array::from_fn(|c| near[c] + part * (far[c] - near[c])))
    }
}

/// The print, its derivatives and the ring, of what depends on the distance alone.
fn of_radial([x, y]: [f64; 2], [value, first, second, ring]: [f64; 4]) -> [f64; PRINTS] {
    [
        value,
        x * first,
        y * first,
        x * x * second + first,
        x * y * second,
        y * y * second + first,
        ring,
    ]
}

/// Value of the print at a distance, its derivative over the distance, the derivative of that over the distance, and the ring.
fn radial(distance_m: f64, radius_m: f64) -> [f64; 4] {
    // without a cusp, at which second derivatives would be infinite
    let d = distance_m.hypot(BLUNT * radius_m);
    let tail_m = TAIL_RADII * radius_m;
    let per = (radius_m * radius_m).recip();
    let squared = distance_m * distance_m;
    let ring = squared * per / (RING_RADII * RING_RADII);
    let core = (-squared * per).exp();
    let tail = TAIL * (-d / tail_m).exp();
    let first = -2.0 * per * core - tail / (tail_m * d);
    let second = 4.0 * per * per * core + tail / (tail_m * d * d) * (tail_m.recip() + d.recip());
    [core + tail, first, second, ring * (-ring).exp()]
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLANE: [[f64; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    /// Derivatives of the print against differences of it.
    #[test]
    fn derivatives_are_those_of_the_print() {
        let (way, h): ([f64; 2], f64) = ([3e-3, 5e-3], 1e-6);
        let print = |[x, y]: [f64; 2]| of_radial([x, y], radial(x.hypot(y), 7e-3));
        let own = print(way);
        let moved = |axis: usize, by: f64| {
            let mut way = way;
            way[axis] += by;
            print(way)
        };
        for (axis, [first, seconds]) in [(0, [1, 3]), (1, [2, 4])] {
            let [ahead, behind] = [h, -h].map(|by| moved(axis, by));
            let slope = |c: usize| (ahead[c] - behind[c]) / (2.0 * h);
            let close = |a: f64, b: f64| (a - b).abs() < 1e-5 * b.abs();
            assert!(close(slope(0), own[first]), "{axis}");
            assert!(close(slope(1), own[seconds]) && close(slope(2), own[seconds + 1]), "{axis}");
        }
    }

    /// The table errs by an eighth of the squared step times the second derivative: of the print at most 2 for its core and 0.29
    /// for its blunt tail, in units of the radius; of its second derivatives some thirty.
    #[test]
    fn the_table_is_the_print() {
        let print = Print::new(7e-3, 0.1);
        let mut worst = [0.0_f64; PRINTS];
        for k in 0..2000 {
            let way = [4.7e-5 * f64::from(k), 1e-5 * f64::from(k % 7)];
            let exact = of_radial(way, radial(way[0].hypot(way[1]), 7e-3));
            let found = print.at([0.0; 3], [way[0], way[1], 0.0], &PLANE);
            let units = [0, 1, 1, 2, 2, 2, 0].map(|order| 7e-3_f64.powi(order));
            for c in 0..PRINTS {
                worst[c] = worst[c].max(units[c] * (found[c] - exact[c]).abs());
            }
        }
        assert!(worst[0] < 4.4e-6 && worst[6] < 4.4e-6, "{worst:?}");
        assert!(worst.iter().all(|error| *error < 6e-5), "{worst:?}");
    }
}
