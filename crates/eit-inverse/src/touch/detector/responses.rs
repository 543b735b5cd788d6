//! Responses of rows to touches, as whitening leaves them, kept while it stays the same.
//!
//! A fit asks for the same few positions again and again: with six touches 30 to 100 times a frame for 10 to 20
//! positions. Whitening each costs `12 n k` flops for `k` directions (three columns), taking a kept one `4 n`.

use super::dictionary::Dictionary;
use super::places::Spot;
use super::whitening::Whitening;

/// Most positions that are kept: 200 kB for 104 rows. All are forgotten when another one comes.
const MOST: usize = 80;

/// Whitened responses and derivatives by position.
#[derive(Debug, Clone)]
pub(super) struct Responses {
    rows: usize,
    /// The whitening that they are of.
    state: Option<u64>,
    places: Vec<usize>,
    /// `[position][value, along 1, along 2][row]`.
    columns: Vec<f64>,
}

impl Responses {
    pub(super) fn new(rows: usize) -> Self {
        let columns = Vec::with_capacity(3 * MOST * rows);
        Self { rows, state: None, places: Vec::with_capacity(MOST), columns }
    }

    /// Writes the whitened response at a spot and its two derivatives, one after the other, without lost rows.
    pub(super) fn write(
        &mut self,
        dictionary: &Dictionary,
        whitening: &Whitening,
        spot: &Spot,
        out: &mut [f64],
    ) {
        let n = self.rows;
        if self.state != Some(whitening.state()) || self.places.len() == MOST {
            self.state = Some(whitening.state());
            self.places.clear();
            self.columns.clear();
        }
        let known = self.places.iter().position(|place| *place == spot.place);
        let at = known.unwrap_or_else(|| {
            self.places.push(spot.place);
            let from = self.columns.len();
            dictionary
                .own(spot.place)
                .iter()
                .for_each(|column| self.columns.extend_from_slice(column));
            whitening.project_all(&mut self.columns[from..]);
            self.places.len() - 1
        });
        let columns = &self.columns[3 * at * n..3 * (at + 1) * n];
        let (value, slopes) = columns.split_at(n);
        let [a, b] = spot.step_m;
        for i in 0..n {
            out[i] = value[i] + a * slopes[i] + b * slopes[n + i];
        }
        out[n..3 * n].copy_from_slice(slopes);
    }
}
