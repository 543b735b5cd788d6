//! Responses of rows to touches, as whitening leaves them, kept while it stays the same.
//!
//! A fit asks for the same few positions again and again: of 22 190 requests in 436 frames of up to six touches, some 4 % were
//! for a new one. Whitening a position costs `12 n k` flops for `k` directions (three columns), taking a kept one `4 n`.

use super::places::Spot;
use super::whitening::Whitening;

/// Maximum number of cached positions: 200 kB for 104 rows. A further one clears the cache.
const MOST: usize = 80;

/// Whitened responses and derivatives by position.
#[derive(Debug, Clone)]
pub(super) struct Responses {
    rows: usize,
    /// State of the whitening for which they were computed.
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

    /// Writes the whitened response at a spot and its two derivatives, one after the other, without
    /// lost rows; `own` are those of its nearest position, whitened as if no row were lost.
    pub(super) fn write(
        &mut self,
        own: [&[f64]; 3],
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
            own.iter().for_each(|column| self.columns.extend_from_slice(column));
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

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;
    use fixtures::Random;

    /// A cached response equals a newly whitened one, whichever rows are lost or unknowns free, and
    /// however many positions there are.
    #[test]
    fn kept_responses_are_those_of_the_present_whitening() {
        let (n, mut random) = (7, Random::new(4));
        let unknowns = Mat::from_fn(n, 2, |_, _| random.normal());
        let local = Mat::from_fn(n, 2, |_, _| random.normal());
        let mut whitening =
            Whitening::new(&vec![1.0; n], unknowns.as_ref()).unwrap().with_local(local.as_ref());
        let positions = 2 * MOST + 3;
        let own: Vec<f64> = (0..3 * n * positions).map(|_| random.normal()).collect();
        let mut responses = Responses::new(n);
        for change in 0..6 {
            match change {
                0 => {}
                1 => _ = whitening.lose(&[2]),
                2 => _ = whitening.free(&[1.0, -1.0], &[]),
                3 => _ = whitening.free(&[0.5, 1.0], &[]),
                4 => _ = whitening.free(&[], &[]),
                _ => _ = whitening.lose(&[]),
            }
            // each of the first positions twice in a row and again after the others
            for place in (0..5).chain(0..positions).chain(0..5) {
                let columns = &own[3 * n * place..3 * n * (place + 1)];
                let own = std::array::from_fn(|k| &columns[k * n..(k + 1) * n]);
                let spot =
                    Spot { place, position_m: [0.0; 3], step_m: [0.3, -0.2], spread_m2: None };
                let (mut found, mut wanted) = (vec![0.0; 3 * n], columns.to_vec());
                for i in 0..n {
                    wanted[i] += 0.3 * columns[n + i] - 0.2 * columns[2 * n + i];
                }
                whitening.project_all(&mut wanted);
                responses.write(own, &whitening, &spot, &mut found);
                // rounding: sums in another order
                let is_near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-12;
                assert!(found.iter().zip(&wanted).all(is_near), "{change} {place}");
            }
        }
    }
}
