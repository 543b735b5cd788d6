//! A frame whitened by the covariance of everything that is not a touch, and the products of which scores are made.
//!
//! ```text
//! S + E = L L',   y = L^-1 y,   W_j = L^-1 X_j,   W_j' y,   W_i' W_j
//! ```
//!
//! with the twelve columns `X_j` of a place `j`. A place costs `12 n^2` flops once a frame, a pair of places `2 * 12^2 n`:
//! 0.13 and 0.03 Mflop with 104 rows. Fits need nothing else of the frame.

use super::dictionary::COLUMNS;
use super::linear::{Factor, Symmetric};
use super::model::Model;
use crate::touch::detector::{dot, widest};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

const NONE: u32 = u32::MAX;

/// The columns of a place.
#[derive(Debug, Clone)]
struct Cell {
    place: usize,
    /// Whitened, `[column][row]`.
    columns: Vec<f64>,
    /// Products with the frame.
    products: [f64; COLUMNS],
}

/// Products of the columns of two places, `[column of the first][column of the second]`.
pub(super) type Gram = [[f64; COLUMNS]; COLUMNS];

/// A whitened frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Whitened {
    /// Rows that count.
    pub(super) present: Vec<usize>,
    /// `S + E` of these rows, and its factor.
    pub(super) covariance: Symmetric,
    pub(super) factor: Factor,
    /// The whitened frame and its squared length.
    pub(super) data: Vec<f64>,
    pub(super) square: f64,
    pub(super) log_determinant: f64,
    cells: Vec<Cell>,
    count: usize,
    /// Index of the products of each pair of cells in `grams`, by [`pair`].
    pairs: Vec<u32>,
    grams: Vec<Gram>,
}

/// Index of a pair.
fn pair(late: usize, early: usize) -> usize {
    late * (late + 1) / 2 + early
}

/// Places, and pairs of them, for which there is room from the start: 43 and 215 have been seen, when six fingers land at once.
const ROOM: usize = 64;
const ROOM_FOR_PAIRS: usize = 512;

impl Whitened {
    /// Makes room for frames of `n` rows.
    pub(super) fn with_room(n: usize) -> Self {
        let columns = || Vec::with_capacity(COLUMNS * n);
        let cell = |_| Cell { place: 0, columns: columns(), products: [0.0; COLUMNS] };
        Self {
            cells: (0..ROOM).map(cell).collect(),
            pairs: Vec::with_capacity(pair(ROOM, 0)),
            grams: Vec::with_capacity(ROOM_FOR_PAIRS),
            ..Self::default()
        }
    }

    /// Number of rows that count.
    pub(super) fn n(&self) -> usize {
        self.present.len()
    }

    /// Sets the frame `y` of all rows with its covariance `background + error`; `counts` says which rows count.
    pub(super) fn set(
        &mut self,
        background: &Symmetric,
        error: &Symmetric,
        y: &[f64],
        counts: impl Fn(usize) -> bool,
    ) {
        self.present.clear();
        self.present.extend((0..background.n()).filter(|&i| counts(i)));
        let Self { present, covariance, .. } = self;
        covariance.reset(present.len());
        for (b, &j) in present.iter().enumerate() {
            let (of_background, of_error) = (background.column(j), error.column(j));
            for (out, &i) in covariance.column_mut(b).iter_mut().zip(&present[b..]) {
                *out = of_background[i - j] + of_error[i - j];
            }
        }
        self.factor.of(&self.covariance);
        self.data.clear();
        self.data.extend(self.present.iter().map(|&i| y[i]));
        self.factor.solve(&mut self.data);
        self.square = dot(&self.data, &self.data);
        self.log_determinant = self.factor.log_determinant();
        self.count = 0;
        self.pairs.clear();
        self.grams.clear();
    }

    /// Whitens vectors of all rows, one after the other, into `out`.
    pub(super) fn whiten<'a>(&self, vectors: impl Iterator<Item = &'a [f64]>, out: &mut Vec<f64>) {
        out.clear();
        for vector in vectors {
            out.extend(self.present.iter().map(|&i| vector[i]));
        }
        self.factor.solve(out);
    }

    /// Returns the index of the columns of a place, which are whitened if they are not yet.
    pub(super) fn cell(&mut self, model: &Model, place: usize) -> usize {
        if let Some(k) = self.cells[..self.count].iter().position(|cell| cell.place == place) {
            return k;
        }
        if self.count == self.cells.len() {
            self.cells.push(Cell { place, columns: Vec::new(), products: [0.0; COLUMNS] });
        }
        let mut columns = std::mem::take(&mut self.cells[self.count].columns);
        let of_place = model.dictionary.of(place).chunks_exact(model.n);
        self.whiten(of_place, &mut columns);
        let mut products = [0.0; COLUMNS];
        let n = self.n().max(1);
        widest(
            #[inline(always)]
            || {
                for (column, out) in columns.chunks_exact(n).zip(&mut products) {
                    *out = dot(column, &self.data);
                }
            },
        );
        self.cells[self.count] = Cell { place, columns, products };
        self.pairs.extend(std::iter::repeat_n(NONE, self.count + 1));
        self.count += 1;
        self.count - 1
    }

    /// Products of the columns of a cell with whitened vectors, `[vector][column]`.
    pub(super) fn products_with(&self, cell: usize, vectors: &[f64], out: &mut Vec<f64>) {
        let n = self.n();
        let count = vectors.len() / n.max(1);
        out.clear();
        out.resize(count * COLUMNS, 0.0);
        let columns = MatRef::from_column_major_slice(&self.cells[cell].columns, n, COLUMNS);
        let vectors = MatRef::from_column_major_slice(vectors, n, count);
        let out = MatMut::from_column_major_slice_mut(out, COLUMNS, count);
        matmul(out, Accum::Replace, columns.transpose(), vectors, 1.0, Par::Seq);
    }

    /// Products of the columns of a cell with the frame.
    pub(super) fn products(&self, cell: usize) -> &[f64; COLUMNS] {
        &self.cells[cell].products
    }

    /// A whitened column of a cell.
    pub(super) fn column_of(&self, cell: usize, c: usize) -> &[f64] {
        &self.cells[cell].columns[c * self.n()..(c + 1) * self.n()]
    }

    /// Returns the products of the columns of two cells, computed if they are not yet: of the later cell with the earlier one.
    pub(super) fn gram(&mut self, a: usize, b: usize) -> &Gram {
        let (late, early) = (a.max(b), a.min(b));
        let at = pair(late, early);
        if self.pairs[at] == NONE {
            let [first, second] = [late, early].map(|k| self.cells[k].columns.as_slice());
            let of = |columns| MatRef::from_column_major_slice(columns, self.n(), COLUMNS);
            let mut gram = [[0.0; COLUMNS]; COLUMNS];
            let out = MatMut::from_row_major_slice_mut(gram.as_flattened_mut(), COLUMNS, COLUMNS);
            matmul(out, Accum::Replace, of(first).transpose(), of(second), 1.0, Par::Seq);
            self.pairs[at] = self.grams.len() as u32;
            self.grams.push(gram);
        }
        &self.grams[self.pairs[at] as usize]
    }
}
