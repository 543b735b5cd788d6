//! What a touch may do besides its print, as sparse combinations of the columns of its place.

use super::dictionary::{COLUMNS, DRAG, ELECTRODE_PULL, PRESS, PULL};
use super::settings::ScoreSettings;
use super::state::TouchState;
use super::whitened::Gram;
use crate::touch::detector::widest;

/// Features of a touch: its print, the derivatives along two tangents, and at most nine actions.
pub(super) const FEATURES: usize = 12;
/// The first of the actions.
pub(super) const FIRST_ACTION: usize = 3;
/// Drag below which a touch has not slid, metres.
const LEAST_DRAG_M: f64 = 1e-5;

/// One coefficient of a feature: its column, and the factor.
type Entry = (u8, f64);

/// Features of a touch, each a sparse combination of the columns of its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Features {
    entries: [Entry; 48],
    ends: [u8; FEATURES],
    pub(super) count: usize,
}

impl Features {
    /// Print per unit of strength, derivatives of the touch with respect to its position, then actions for one standard
    /// deviation each.
    pub(super) fn new(touch: &TouchState, settings: &ScoreSettings) -> Self {
        let mut made = Self { entries: [(0, 0.0); 48], ends: [0; FEATURES], count: 0 };
        let (a, [value, x, y]) = (touch.strength_m2, touch.print());
        let scaled =
            |c: [f64; 6], by: f64| c.into_iter().enumerate().map(move |(k, c)| (k, by * c));
        made.push(scaled(value, 1.0));
        made.push(scaled(x, a));
        made.push(scaled(y, a));
        made.push_shapes(a, settings);
        made.push_movements(touch, settings);
        made
    }

    /// Size, elongation along two axes, and the ring around the print: proportional to the strength.
    fn push_shapes(&mut self, a: f64, s: &ScoreSettings) {
        let squared_m2 = s.bell_m * s.bell_m;
        let (size, bent) = (0.25 * a * s.size * squared_m2, 0.25 * a * s.bent * squared_m2);
        self.push([(3, size), (5, size)]);
        self.push([(3, bent), (5, -bent)]);
        self.push([(4, 2.0 * bent)]);
        self.push([(6, a * s.ring)]);
    }

    /// Movements grow with the strength up to that of a strong touch.
    fn push_movements(&mut self, touch: &TouchState, s: &ScoreSettings) {
        let a = touch.strength_m2;
        let part = a / (a + s.typical_m2);
        self.push([(PULL, part * s.pull_m)]);
        self.push([(ELECTRODE_PULL, part * s.electrode_pull_m)]);
        self.push([(PRESS, part * s.press)]);
        let drag_m = touch.path_m.min(s.drag_m) * part;
        if drag_m > LEAST_DRAG_M {
            self.push([(DRAG, drag_m)]);
            self.push([(DRAG + 1, drag_m)]);
        }
    }

    fn push(&mut self, entries: impl IntoIterator<Item = (usize, f64)>) {
        let mut end = self.count.checked_sub(1).map_or(0, |last| usize::from(self.ends[last]));
        for (column, factor) in entries {
            if factor != 0.0 && end < self.entries.len() {
                self.entries[end] = (column as u8, factor);
                end += 1;
            }
        }
        self.ends[self.count] = end as u8;
        self.count += 1;
    }

    #[inline(always)]
    fn entries(&self, feature: usize) -> &[Entry] {
        let from = if feature == 0 { 0 } else { usize::from(self.ends[feature - 1]) };
        &self.entries[from..usize::from(self.ends[feature])]
    }

    /// Columns and factors of a feature.
    #[inline(always)]
    pub(super) fn of(&self, feature: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.entries(feature).iter().map(|(column, factor)| (usize::from(*column), *factor))
    }

    /// Products of features of two touches, `[of the other][of this]`, for the products of the columns of their places, `[of
    /// this][of the other]`.
    pub(super) fn products(&self, other: &Self, gram: &Gram) -> [[f64; FEATURES]; FEATURES] {
        widest(
            #[inline(always)]
            || {
                // explicit loops: closures would not be compiled for the widest vectors
                let mut turned = [[0.0; FEATURES]; COLUMNS];
                for own in 0..self.count {
                    let mut row = [0.0; COLUMNS];
                    for &(column, factor) in self.entries(own) {
                        let products = &gram[usize::from(column)];
                        for k in 0..COLUMNS {
                            row[k] += factor * products[k];
                        }
                    }
                    for (turned, value) in turned.iter_mut().zip(row) {
                        turned[own] = value;
                    }
                }
                let mut out = [[0.0; FEATURES]; FEATURES];
                for (feature, out) in out.iter_mut().enumerate().take(other.count) {
                    for &(column, factor) in other.entries(feature) {
                        let products = &turned[usize::from(column)];
                        for k in 0..FEATURES {
                            out[k] += factor * products[k];
                        }
                    }
                }
                out
            },
        )
    }

    /// Product of a feature with a vector of columns.
    #[inline(always)]
    pub(super) fn times(&self, feature: usize, columns: &[f64; COLUMNS]) -> f64 {
        self.of(feature).map(|(column, factor)| factor * columns[column]).sum()
    }

    /// The combination of rows that a feature is, `rows: [column][row]`, added to `out` with a weight.
    pub(super) fn add_rows(&self, feature: usize, weight: f64, rows: &[f64], out: &mut [f64]) {
        let n = out.len();
        for (column, factor) in self.of(feature) {
            let own = &rows[column * n..(column + 1) * n];
            out.iter_mut().zip(own).for_each(|(o, v)| *o += weight * factor * v);
        }
    }
}
