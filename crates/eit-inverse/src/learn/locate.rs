//! Position and strength of a touch from a [`ResponseMap`].

use super::response_map::ResponseMap;
use crate::InverseError;
use crate::check::check_length;
use crate::geometry::distance_m;
use crate::touch::dot;

/// A located touch.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Located {
    /// Posterior mean of the position, metres.
    pub position_m: [f64; 3],
    /// Covariance of the position, square metres.
    pub covariance_m2: [[f64; 3]; 3],
    /// Amplitude of the learnt response in the frame, in the frame's unit.
    pub amplitude: f64,
    /// Amplitude converted to a strength on the physical model, S m^2, for responses of one volt; without
    /// sign.
    pub strength_s_m2: f64,
    /// Fraction of the frame that a touch at the best position leaves unexplained, 0 to 1.
    pub rest: f64,
    /// Whether the frame is unlike every learnt press: more remains unexplained than by them, other touches
    /// and the noise.
    pub is_unlike: bool,
}

/// Mean and covariance of a position.
pub(super) struct Posterior {
    pub mean_m: [f64; 3],
    pub covariance_m2: [[f64; 3]; 3],
}

/// Converts misfits (-2 log likelihood) into weights of sum 1 and returns their moments.
pub(super) fn posterior_of_misfits(misfits: &mut [f64], candidates_m: &[[f64; 3]]) -> Posterior {
    let least = misfits.iter().copied().fold(f64::INFINITY, f64::min);
    let mut sum = 0.0;
    for misfit in misfits.iter_mut() {
        *misfit = (-0.5 * (*misfit - least)).exp();
        sum += *misfit;
    }
    let mut mean_m = [0.0; 3];
    for (weight, place) in misfits.iter_mut().zip(candidates_m) {
        *weight /= sum;
        (0..3).for_each(|k| mean_m[k] += *weight * place[k]);
    }
    let mut covariance_m2 = [[0.0; 3]; 3];
    for (weight, place) in misfits.iter().zip(candidates_m) {
        let way: [f64; 3] = std::array::from_fn(|k| place[k] - mean_m[k]);
        for (i, row) in covariance_m2.iter_mut().enumerate() {
            (0..3).for_each(|j| row[j] += weight * way[i] * way[j]);
        }
    }
    Posterior { mean_m, covariance_m2 }
}

/// Locates touches frame by frame; [`locate`](Self::locate) does not allocate.
#[derive(Debug, Clone)]
pub struct Locator {
    map: ResponseMap,
    /// Responses divided by the standard deviations of the channels, `[candidate][channel]`.
    whitened: Vec<f64>,
    /// Squared lengths of the whitened responses over the present channels.
    squares: Vec<f64>,
    /// Reciprocal standard deviations of the channels.
    scales: Vec<f64>,
    /// Mean squared distance between neighbouring candidates, square metres.
    cell_m2: f64,
    is_missing: Vec<bool>,
    /// Number of present channels, and their share of the squared responses, averaged over candidates.
    present: usize,
    present_part: f64,
    frame: Vec<f64>,
    weights: Vec<f64>,
    /// Candidate that explains most of the last frame, and its amplitude.
    best: Option<(usize, f64)>,
    /// Noise variance of each whitened channel, and the sum over the present ones.
    noises: Vec<f64>,
    noise: f64,
}

impl Locator {
    /// Builds a locator for frames whose channels have noise of the given standard deviations, in the
    /// frame's unit.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn new(map: ResponseMap, noise_std: &[f64]) -> Result<Self, InverseError> {
        let channels = map.responses.ncols();
        check_length("noise of the channels", noise_std.len(), channels)?;
        let scales: Vec<f64> = map.channel_variance.iter().map(|v| v.sqrt().recip()).collect();
        let rows = map.responses.rows();
        let whitened: Vec<f64> = rows
            .into_iter()
            .flat_map(|row| row.iter().zip(&scales).map(|(r, s)| r * s).collect::<Vec<_>>())
            .collect();
        let squares = whitened.chunks_exact(channels.max(1)).map(|row| dot(row, row)).collect();
        let noises: Vec<f64> =
            noise_std.iter().zip(&scales).map(|(e, s)| (e * s).powi(2)).collect();
        Ok(Self {
            cell_m2: cell_m2(&map.candidates_m),
            is_missing: vec![false; channels],
            present: channels,
            present_part: 1.0,
            best: None,
            frame: vec![0.0; channels],
            weights: vec![0.0; map.candidates_m.len()],
            whitened,
            squares,
            scales,
            noise: noises.iter().sum(),
            noises,
            map,
        })
    }

    /// Returns the response map that touches are located with.
    pub fn map(&self) -> &ResponseMap {
        &self.map
    }

    /// Sets the channels that are ignored from the next frame on; the likelihood then uses the others.
    pub fn set_missing(&mut self, is_missing: impl Fn(usize) -> bool) {
        let mut changed = false;
        for (i, missing) in self.is_missing.iter_mut().enumerate() {
            changed |= *missing != is_missing(i);
            *missing = is_missing(i);
        }
        if !changed {
            return;
        }
        let channels = self.is_missing.len();
        self.present = self.is_missing.iter().filter(|missing| !**missing).count();
        self.present_part = self.part_of_present();
        let noises = self.noises.iter().zip(&self.is_missing);
        self.noise = noises.filter(|(_, missing)| !**missing).map(|(noise, _)| noise).sum();
        for (square, row) in self.squares.iter_mut().zip(self.whitened.chunks_exact(channels)) {
            let present = row.iter().zip(&self.is_missing).filter(|(_, missing)| !**missing);
            *square = present.map(|(r, _)| r * r).sum();
        }
    }

    /// Locates the touch in a frame of differences, `[channel]`; returns `None` if no touch explains the
    /// frame.
    ///
    /// `near` restricts the search to a distance around a position, both in metres. `others` is the length
    /// of what other touches contributed to the frame before they were subtracted, since the map errs for
    /// them too.
    pub fn locate(
        &mut self,
        difference: &[f64],
        near: Option<([f64; 3], f64)>,
        others: f64,
    ) -> Option<Located> {
        self.best = None;
        let whole = self.take(difference)?;
        let channels = self.frame.len();
        // the map's variances are for a complete frame of length 1; noise and other touches add theirs
        let length2 = self.present(difference).map(|v| v * v).sum::<f64>() / self.present_part;
        let present = self.present as f64;
        let room = (self.noise / present + others * others * self.map.settings.noise)
            / length2.max(f64::MIN_POSITIVE);
        let scale = self.map.settings.independent_channels / channels as f64;
        let unit = length2.max(f64::MIN_POSITIVE).recip();
        let (mut best, mut most) = (None, 0.0);
        for (c, row) in self.whitened.chunks_exact(channels).enumerate() {
            let product = dot(row, &self.frame).max(0.0);
            let explained = product * product / self.squares[c].max(f64::MIN_POSITIVE);
            let variance = self.map.variance[c] + room;
            let rest = (whole - explained).max(0.0) * unit;
            self.weights[c] = scale * (rest / variance + present * variance.ln());
            if near.is_some_and(|(place, m)| distance_m(place, self.map.candidates_m[c]) > m) {
                self.weights[c] = f64::INFINITY;
            } else if explained > most {
                (best, most) = (Some((c, product / self.squares[c])), explained);
            }
        }
        self.best = best;
        best?;
        // residual of the map for the other touches, on the whitened scale
        let left_by_others = others * others * whole / length2.max(f64::MIN_POSITIVE);
        Some(self.report(whole, most, left_by_others))
    }

    /// Share of the present channels in the squared responses; 1 if all responses are zero.
    fn part_of_present(&self) -> f64 {
        let (mut present, mut whole) = (0.0, 0.0);
        for row in self.map.responses.rows() {
            for (response, missing) in row.iter().zip(&self.is_missing) {
                let square = response * response;
                whole += square;
                present += if *missing { 0.0 } else { square };
            }
        }
        if present > 0.0 { present / whole } else { 1.0 }
    }

    /// Adds to `out` the response to the touch of the last [`locate`](Self::locate), at the candidate that
    /// explains most of its frame.
    ///
    /// The mean response over all possible positions is flatter than any single response, and subtracting
    /// it would leave much of the touch.
    pub fn add_response(&self, out: &mut [f64]) {
        let Some((candidate, amplitude)) = self.best else { return };
        let response = self.map.responses.row(candidate);
        out.iter_mut().zip(response).for_each(|(out, r)| *out += amplitude * r);
    }

    /// Whitens the present channels and returns their squared length; `None` if it is zero or not finite.
    fn take(&mut self, difference: &[f64]) -> Option<f64> {
        for (i, value) in self.frame.iter_mut().enumerate() {
            *value = if self.is_missing[i] { 0.0 } else { difference[i] * self.scales[i] };
        }
        let whole = dot(&self.frame, &self.frame);
        (whole > 0.0 && whole.is_finite()).then_some(whole)
    }

    fn present<'a>(&'a self, difference: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let values = difference.iter().zip(&self.is_missing);
        values.filter(|(_, missing)| !**missing).map(|(v, _)| *v)
    }

    fn report(&mut self, whole: f64, most: f64, others: f64) -> Located {
        let map = &self.map;
        let found = posterior_of_misfits(&mut self.weights, &map.candidates_m);
        let channels = self.frame.len();
        let (mut amplitude, mut strength, mut sum) = (0.0, 0.0, 0.0);
        let rows = self.whitened.chunks_exact(channels);
        for (c, (weight, row)) in self.weights.iter().zip(rows).enumerate() {
            if *weight > 1e-3 {
                let fitted =
                    dot(row, &self.frame).max(0.0) / self.squares[c].max(f64::MIN_POSITIVE);
                amplitude += weight * fitted;
                strength += weight * fitted * map.strength_s_m2[c];
                sum += weight;
            }
        }
        let mut covariance_m2 = found.covariance_m2;
        covariance_m2.iter_mut().flatten().for_each(|v| *v *= map.covariance_factor);
        // uncertainty of a position between candidates
        (0..3).for_each(|k| {
            if found.covariance_m2[k][k] > 0.0 {
                covariance_m2[k][k] += self.cell_m2 / 12.0;
            }
        });
        Located {
            position_m: found.mean_m,
            covariance_m2,
            amplitude: amplitude / sum,
            strength_s_m2: strength / sum,
            rest: 1.0 - (most / whole).min(1.0),
            is_unlike: whole - most > map.rest_limit * (whole + others) + 2.0 * self.noise,
        }
    }
}

/// Mean squared distance of candidates to their nearest neighbours.
fn cell_m2(candidates_m: &[[f64; 3]]) -> f64 {
    let nearest = |i: usize| {
        let others = candidates_m.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, p)| distance_m(*p, candidates_m[i]).powi(2)).fold(f64::INFINITY, f64::min)
    };
    let sum: f64 = (0..candidates_m.len()).map(nearest).sum();
    sum / candidates_m.len().max(1) as f64
}
