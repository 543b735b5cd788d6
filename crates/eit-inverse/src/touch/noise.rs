//! The noise floor: how strong noise alone makes an image, and where a touch begins.

use super::normal::{TailSampler, student_quantile, upper_quantile, upper_tail};
use crate::check::check_length;
use crate::{InverseError, Reconstructor};
use ndarray::ArrayView2;

/// Fewest quiet images: with 20, the standard deviation of a cell is known to a sixth.
const LEAST_IMAGES: usize = 20;

/// Most quiet images used for the correlations between cells, spread evenly over all.
const CORRELATION_IMAGES: usize = 512;

/// Random images for the number of effective cells, which gives it to about 4 % and a threshold of 5 to 0.01.
const SAMPLES: usize = 300;

/// Lag-one correlation below which noise counts as white; noise of 400 images reaches it.
const WHITE: f64 = 0.1;

/// Accepted rate of false touches caused by noise alone.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FalseAlarms {
    /// False touches per hour.
    pub per_hour: f64,
    /// Images per second, hertz.
    pub frame_rate_hz: f64,
    /// Number of images that must show a touch ...
    pub hits: usize,
    /// ... out of this many, counted from the first that shows it.
    pub of: usize,
}

impl FalseAlarms {
    /// Checks every number.
    pub(super) fn validate(&self) -> Result<(), InverseError> {
        crate::check::check_positive("false touches per hour", self.per_hour)?;
        crate::check::check_positive("frame_rate_hz", self.frame_rate_hz)?;
        if self.hits == 0 || self.hits > self.of || self.of > 32 {
            let (quantity, value) = ("birth_hits", self.hits as f64);
            let must = "at least 1 and at most birth_frames, which is at most 32";
            return Err(InverseError::OutOfRange { quantity, value, must });
        }
        if self.per_frame() >= 0.5 {
            let (quantity, value) = ("false touches per hour", self.per_hour);
            return Err(InverseError::OutOfRange {
                quantity,
                value,
                must: "fewer than one in two images",
            });
        }
        Ok(())
    }

    /// Accepted false touches per image.
    fn per_frame(&self) -> f64 {
        self.per_hour / (3600.0 * self.frame_rate_hz)
    }

    /// Probability per image that noise may reach the threshold somewhere, so that touches are born at the
    /// accepted rate.
    ///
    /// This is the `p` of `p P(Binomial(of - 1, p) >= hits - 1) = rate`. The resulting rate is an upper
    /// bound, since later hits must also be near the first. Images that are correlated in time (`white`
    /// false) confirm nothing; `p` is then the rate.
    fn per_image(&self, white: bool) -> f64 {
        let rate = self.per_frame();
        if !white || self.hits == 1 {
            return rate;
        }
        let (mut low, mut high) = (0.0_f64, 0.5_f64);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            let born = middle * at_least(self.hits - 1, self.of - 1, middle);
            if born < rate { low = middle } else { high = middle }
        }
        low
    }
}

/// `P(Binomial(n, p) >= k)` for `p` below 1.
fn at_least(k: usize, n: usize, p: f64) -> f64 {
    let (mut term, mut sum) = ((1.0 - p).powi(n as i32), 0.0);
    for i in 0..=n {
        if i >= k {
            sum += term;
        }
        term *= (n - i) as f64 / (i + 1) as f64 * p / (1.0 - p);
    }
    sum
}

/// Noise of each cell of an image, with correlations between cells.
///
/// It is derived from the noise of the data through a linear reconstruction, or measured on quiet images.
/// It is stored as a factor: `covariance of the image = F F'`, `F` `[cell, source]`.
#[derive(Debug, Clone)]
pub struct NoiseFloor {
    std: Vec<f64>,
    /// Row-major.
    factor: Vec<f64>,
    sources: usize,
    /// Degrees of freedom of a measured floor.
    degrees: Option<f64>,
    lag_one: f64,
}

impl NoiseFloor {
    /// Computes the floor of a linear reconstruction, `F = RM diag(noise_std)`.
    ///
    /// `noise_std` is the standard deviation of the difference data, `[measurement]`, in their unit (volts,
    /// or 1 for normalised data), including the reference frame's share, as in
    /// [`OneStepSettings::noise_std`](crate::OneStepSettings::noise_std). Noise is assumed normal and
    /// independent between measurements and between frames.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`]; [`InverseError::MeasurementOutOfRange`] for a value that is negative
    /// or not finite; [`InverseError::NoiseUnknown`] if all are zero.
    pub fn of_reconstruction(
        reconstructor: &Reconstructor,
        noise_std: &[f64],
    ) -> Result<Self, InverseError> {
        check_length("noise_std", noise_std.len(), reconstructor.measurements())?;
        let used = &reconstructor.channels.used;
        for &measurement in used {
            let value = noise_std[measurement];
            if !(value >= 0.0 && value.is_finite()) {
                let (quantity, must) = ("noise_std", "finite and at least 0");
                return Err(InverseError::MeasurementOutOfRange {
                    quantity,
                    measurement,
                    value,
                    must,
                });
            }
        }
        let matrix = reconstructor.reconstruction_matrix();
        let mut factor = Vec::with_capacity(matrix.nrows() * used.len());
        for row in matrix.rows() {
            factor.extend(used.iter().map(|&i| row[i] * noise_std[i]));
        }
        Self::new(factor, used.len(), None, 0.0)
    }

    /// Measures the floor on quiet images `[image, cell]` in order of time.
    ///
    /// This works for any method, linear or not, as long as its noise is nearly normal. The mean of the
    /// images is subtracted. Thresholds are raised according to Student's distribution, because the
    /// standard deviations are estimates. If successive images are correlated, a second image does not
    /// count as confirmation.
    ///
    /// # Errors
    /// [`InverseError::TooFewQuietFrames`] below 20; [`InverseError::NonFiniteImage`];
    /// [`InverseError::NoiseUnknown`] for identical images.
    pub fn of_quiet_images(images: ArrayView2<'_, f64>) -> Result<Self, InverseError> {
        let (count, cells) = images.dim();
        if count < LEAST_IMAGES {
            return Err(InverseError::TooFewQuietFrames { found: count, needed: LEAST_IMAGES });
        }
        if let Some(((frame, cell), &value)) = images.indexed_iter().find(|(_, x)| !x.is_finite()) {
            return Err(InverseError::NonFiniteImage { frame, cell, value });
        }
        let step = count.div_ceil(CORRELATION_IMAGES);
        let sources = count.div_ceil(step);
        let mut factor = Vec::with_capacity(cells * sources);
        let mut stds = Vec::with_capacity(cells);
        let (mut lagged, mut energy) = (0.0, 0.0);
        for column in images.columns() {
            let mean = column.sum() / count as f64;
            let squares: f64 = column.iter().map(|x| (x - mean).powi(2)).sum();
            let std = (squares / (count - 1) as f64).sqrt();
            if std > 0.0 {
                let pairs = column.iter().zip(column.iter().skip(1));
                lagged += pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / std.powi(2);
                energy += squares / std.powi(2);
            }
            let taken = || column.iter().step_by(step).map(|x| x - mean);
            let size = taken().map(|x| x * x).sum::<f64>().sqrt();
            let scale = if size > 0.0 { std / size } else { 0.0 };
            factor.extend(taken().map(|x| x * scale));
            stds.push(std);
        }
        let lag_one = if energy > 0.0 { lagged / energy } else { 0.0 };
        Self::new(factor, sources, Some((count - 1) as f64), lag_one)
    }

    fn new(
        factor: Vec<f64>,
        sources: usize,
        degrees: Option<f64>,
        lag_one: f64,
    ) -> Result<Self, InverseError> {
        let rows = factor.chunks_exact(sources.max(1));
        let std: Vec<f64> = rows.map(|f| f.iter().map(|x| x * x).sum::<f64>().sqrt()).collect();
        if !std.iter().any(|s| *s > 0.0) {
            return Err(InverseError::NoiseUnknown { what: "no cell of the image shows noise" });
        }
        Ok(Self { std, factor, sources, degrees, lag_one })
    }

    /// Returns the standard deviation of each cell in the image's unit, `[cell]`.
    pub fn std(&self) -> &[f64] {
        &self.std
    }

    /// Returns the correlation of a cell from one quiet image to the next, averaged over the cells; 0 for a
    /// floor that was not measured.
    pub fn lag_one_correlation(&self) -> f64 {
        self.lag_one
    }

    /// Returns the contribution of each noise source to a cell: one row of the factor.
    pub(super) fn sources_of(&self, cell: usize) -> &[f64] {
        &self.factor[cell * self.sources..][..self.sources]
    }

    /// Number of noise sources.
    pub(super) fn sources(&self) -> usize {
        self.sources
    }

    /// Estimates the number of independent cells that would reach `level` standard deviations (above zero)
    /// as often as this image: `P(max z > level) / P(Z > level)`.
    ///
    /// ```text
    /// P(max z > t) = n P(Z > t) E[ 1 / #{j : z_j > t} ],   a cell drawn at random being above t
    /// ```
    ///
    /// This is exact for normal noise, and the mean has a small variance at any level, so a tail of 1e-9
    /// needs neither many quiet images nor extrapolation.
    ///
    /// Source: Adler, Blanchet, Liu, *Ann. Appl. Probab.* 22 (2012), 1167-1214, section 2.
    pub fn effective_cells(&self, level: f64) -> f64 {
        let alive: Vec<usize> = (0..self.std.len()).filter(|&k| self.std[k] > 0.0).collect();
        let mut random = TailSampler::new(alive.len() as u64);
        let mut source = vec![0.0; self.sources];
        let mut sum = 0.0;
        for _ in 0..SAMPLES {
            source.iter_mut().for_each(|g| *g = random.normal());
            let draw = (random.uniform() * alive.len() as f64) as usize;
            let cell = alive[draw.min(alive.len() - 1)];
            let direction = self.sources_of(cell);
            let z = random.normal_above(level);
            let shift = (z - dot(direction, &source) / self.std[cell]) / self.std[cell];
            source.iter_mut().zip(direction).for_each(|(g, f)| *g += shift * f);
            let above = |k: &&usize| dot(self.sources_of(**k), &source) > level * self.std[**k];
            sum += 1.0 / alive.iter().filter(above).count().max(1) as f64;
        }
        alive.len() as f64 * sum / SAMPLES as f64
    }

    /// Returns the level at which a touch begins, in standard deviations of its cell, so that noise alone
    /// makes touches at the accepted rate; and the number of effective cells at that level.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    pub fn threshold(&self, alarms: &FalseAlarms) -> Result<(f64, f64), InverseError> {
        alarms.validate()?;
        let p = alarms.per_image(self.lag_one.abs() < WHITE);
        let mut cells = self.std.iter().filter(|s| **s > 0.0).count() as f64;
        let mut level = upper_quantile(p / cells);
        // the number of cells hardly depends on the level: the second round moves it by 0.01
        for _ in 0..2 {
            cells = self.effective_cells(level.max(1.0));
            level = upper_quantile(-(-p).ln_1p() / cells);
        }
        let level = self.degrees.map_or(level, |degrees| {
            // the mean of the quiet images is uncertain too
            student_quantile(level, degrees) * (1.0 + 1.0 / (degrees + 1.0)).sqrt()
        });
        Ok((level, cells))
    }

    /// Probability that noise alone reaches `level` anywhere in an image, from the number of cells that
    /// [`threshold`](Self::threshold) returned: an upper bound far below that threshold.
    pub(super) fn exceedance(cells: f64, level: f64) -> f64 {
        (cells * upper_tail(level)).min(1.0)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
