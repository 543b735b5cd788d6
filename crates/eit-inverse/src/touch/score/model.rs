//! What is known before the first frame, in units of each row's noise.

use super::dictionary::{Dictionary, Effects};
use super::linear::Symmetric;
use super::places::Grid;
use super::settings::ScoreSettings;
use crate::InverseError;
use crate::check::{check_finite, check_length, check_positive};
use crate::touch::detector::{DetectorModel, Rows, UnknownKind, check, dot};
use eit_core::median;
use eit_mesh::Surface;
use faer::Mat;
use ndarray::{ArrayRef2, ArrayView2, Axis};

/// Inputs of a [`ScoreDetector`](super::ScoreDetector).
#[derive(Debug, Clone, Copy)]
pub struct ScoreModel<'a> {
    /// Skin, reference and noise as for the other detector, but `unknowns` in volts per metre of displacement and per unit of
    /// the logarithm of a contact impedance, and `noise_std_v` of one frame.
    pub skin: DetectorModel<'a>,
    /// Conductivity of the model's sheet, siemens.
    pub conductivity_s: f64,
    /// Number of frames of which the reference is the mean.
    pub reference_frames: usize,
    /// Smallest step of the converter, volts; 0 if unknown.
    pub step_v: f64,
    /// Index of the drive of each measurement, in the order in which the instrument takes them.
    pub drive: &'a [usize],
    /// Mean potential of the measured electrodes above the sink of the current, volts, `[measurement]`; its change under a touch
    /// leaks into the voltages.
    pub common_v: &'a [f64],
    /// What has leaked into the reference, volts, `[measurement]`.
    pub leak_v: &'a [f64],
}

/// Factor above the edge of noise (Marchenko, Pastur 1967) from which a direction of quiet frames is more than noise.
const ABOVE_NOISE: f64 = 1.2;

/// Least variance of a row's noise, relative to the median: quiet frames are few, and their rounding may hide noise.
const LEAST_NOISE: f64 = 0.05;

/// Model of a skin.
#[derive(Debug, Clone)]
pub(super) struct Model {
    /// Number of rows.
    pub(super) n: usize,
    pub(super) rows: Rows,
    pub(super) grid: Grid,
    pub(super) dictionary: Dictionary,
    /// Reference, volts, `[measurement]`, and noise of each measurement and row, volts.
    pub(super) reference_v: Vec<f64>,
    pub(super) noise_v: Vec<f64>,
    pub(super) row_noise_v: Vec<f64>,
    /// Median of the rows' noise, volts.
    pub(super) typical_noise_v: f64,
    /// Displacements of electrodes: position, and effect of 1 m `[displacement][row]`.
    pub(super) moved_at: Vec<[f64; 3]>,
    pub(super) moved: Vec<f64>,
    /// Contacts: position, and effect of one unit of ln z `[contact][row]`.
    pub(super) contact_at: Vec<[f64; 3]>,
    pub(super) contact: Vec<f64>,
    /// Effect of the whole sheet's or current's logarithm, `[row]`.
    pub(super) sheet: Vec<f64>,
    /// Whether each electrode takes part in a row, `[electrode][row]`, and its measurements.
    pub(super) of: Vec<Vec<bool>>,
    pub(super) of_electrode: Vec<Vec<usize>>,
    /// Squared length of the sheet's effect on the rows of each electrode.
    pub(super) gain_squares: Vec<f64>,
    /// Covariance of what quiet frames share beyond the noise.
    pub(super) waves: Symmetric,
    /// Covariance of a field of changes that amount to 1 m^2 in the area of a print.
    pub(super) field: Symmetric,
    /// Part of the reference that the model leaves unexplained, whatever its scale.
    pub(super) misfit: f64,
    /// Relative difference of the reference's reciprocal halves.
    pub(super) unequal: f64,
    /// Area of the skin, and half of its longer side.
    pub(super) area_m2: f64,
    pub(super) half_m: f64,
    /// Siemens of the sheet per unit of its relative change.
    pub(super) conductivity_s: f64,
    pub(super) step_v: f64,
    pub(super) reference_frames: usize,
    /// Standard deviation of the offset of each drive's voltages under a touch; the drive of each measurement, and
    /// those of each row's halves.
    pub(super) offsets_v: Vec<f64>,
    pub(super) drive_of: Vec<usize>,
    of_drives: Vec<[usize; 2]>,
}

impl Model {
    /// Computes what is known of a skin.
    pub(super) fn new(
        given: &ScoreModel<'_>,
        dents_v: &ArrayRef2<f64>,
        settings: &ScoreSettings,
    ) -> Result<Self, InverseError> {
        let skin = &given.skin;
        check_all(given, dents_v)?;
        let known_v: Vec<f64> =
            skin.reference_v.iter().zip(given.leak_v).map(|(v, leak)| v - leak).collect();
        let rows = Rows::new(skin.reciprocal, skin.used, &known_v, skin.model_v)?;
        let n = rows.of.len();
        let noise_v = noise(skin, given.step_v);
        let row_noise_v: Vec<f64> =
            rows.of.iter().map(|&[i, j]| row_noise(&noise_v, i, j)).collect();
        let scale: Vec<f64> = (0..n).map(|row| rows.ratio_of_row(row) / row_noise_v[row]).collect();
        let unknowns = scaled_unknowns(skin, &rows, &scale);
        let grid = Grid::new(skin.surface, settings.pitch_m);
        let effects = Effects { given, rows: &rows, scale: &scale, unknowns: &unknowns, dents_v };
        let dictionary = Dictionary::new(&grid, &effects, settings);
        let reference: Vec<f64> = fold(&rows, |i| known_v[i]).collect();
        let sheet: Vec<f64> =
            reference.iter().zip(&row_noise_v).map(|(v, noise)| v / noise).collect();
        let [(moved_at, moved), (contact_at, contact)] = split(skin.kinds, &unknowns, n);
        let of: Vec<Vec<bool>> = skin.of_electrode.iter().map(|all| involves(&rows, all)).collect();
        let square = |of: &Vec<bool>| -> f64 {
            of.iter().zip(&sheet).filter(|(of, _)| **of).map(|(_, s)| s * s).sum()
        };
        let area_m2: f64 = skin.surface.areas_m2().iter().sum();
        Ok(Self {
            n,
            misfit: misfit(&rows, skin, &reference),
            unequal: unequal(&rows, &known_v),
            field: field(&dictionary, &grid, area_m2, settings.bell_m, n),
            waves: waves(&rows, &row_noise_v, skin.quiet_v),
            gain_squares: of.iter().map(square).collect(),
            area_m2,
            half_m: half_m(skin.surface),
            conductivity_s: given.conductivity_s / rows.gain(),
            grid,
            dictionary,
            reference_v: skin.reference_v.to_vec(),
            noise_v,
            typical_noise_v: median(row_noise_v.iter().copied()).unwrap_or(0.0),
            row_noise_v,
            moved_at,
            moved,
            contact_at,
            contact,
            sheet,
            of,
            of_electrode: skin.of_electrode.to_vec(),
            step_v: given.step_v,
            reference_frames: given.reference_frames.max(1),
            offsets_v: offsets_v(given, settings),
            drive_of: given.drive.to_vec(),
            of_drives: rows.of.iter().map(|pair| pair.map(|i| given.drive[i])).collect(),
            rows,
        })
    }

    /// When a measurement is taken in a scan, from 0 to 1.
    pub(super) fn time(&self, measurement: usize) -> f64 {
        self.drive_of[measurement] as f64 / self.offsets_v.len() as f64
    }

    /// Rows, with the drives of their halves.
    pub(super) fn drives_of_rows(&self) -> impl Iterator<Item = (usize, [usize; 2])> + '_ {
        self.of_drives.iter().copied().enumerate()
    }

    /// Effect of an electrode's gain: the reference on its rows, zero elsewhere.
    pub(super) fn gain(&self, electrode: usize, row: usize) -> f64 {
        if self.of[electrode][row] { self.sheet[row] } else { 0.0 }
    }
}

/// Covariance of a field of independent changes that amount to 1 m^2 (standard deviation) in the area of a print.
fn field(dictionary: &Dictionary, grid: &Grid, area_m2: f64, bell_m: f64, n: usize) -> Symmetric {
    let cell_m2 = area_m2 / grid.coarse.len() as f64;
    let prints: Vec<f64> =
        grid.coarse.iter().flat_map(|&place| &dictionary.of(place)[..n]).copied().collect();
    let mut covariance = Symmetric::zeros(n);
    covariance.add_product(cell_m2 / (std::f64::consts::PI * bell_m * bell_m), &prints);
    covariance
}

/// Offset of each drive, from the mean of its measurements' common potential.
fn offsets_v(given: &ScoreModel<'_>, s: &ScoreSettings) -> Vec<f64> {
    let count = given.drive.iter().max().map_or(0, |last| last + 1);
    let of = |drive: usize| {
        let own = given.drive.iter().zip(given.common_v).filter(|(d, _)| **d == drive);
        let (count, sum) = own.fold((0.0_f64, 0.0), |(n, sum), (_, v)| (n + 1.0, sum + v));
        s.common_mode * s.press * (sum / count.max(1.0)).abs()
    };
    (0..count).map(of).collect()
}

/// Means of values of measurements in each row.
fn fold(rows: &Rows, value: impl Fn(usize) -> f64) -> impl Iterator<Item = f64> {
    rows.of.iter().map(move |&[i, j]| 0.5 * (value(i) + value(j)))
}

/// Effects of unknowns in units of each row's noise, `[unknown][row]`.
fn scaled_unknowns(skin: &DetectorModel<'_>, rows: &Rows, scale: &[f64]) -> Vec<f64> {
    let unknowns = (0..skin.kinds.len()).flat_map(|k| fold(rows, move |i| skin.unknowns[(i, k)]));
    unknowns.zip(scale.iter().cycle()).map(|(unknown, scale)| scale * unknown).collect()
}

/// Half of the longer side of a skin.
fn half_m(surface: &Surface) -> f64 {
    let [low, high] = surface.bounds_m();
    (0..3).map(|k| 0.5 * (high[k] - low[k])).fold(f64::MIN_POSITIVE, f64::max)
}

/// Which rows have one of some measurements.
fn involves(rows: &Rows, measurements: &[usize]) -> Vec<bool> {
    rows.of.iter().map(|pair| pair.iter().any(|i| measurements.contains(i))).collect()
}

/// Positions of electrodes, and columns of their effects.
type Columns = (Vec<[f64; 3]>, Vec<f64>);

/// Displacements and contacts among unknowns, `[unknown][row]`.
fn split(kinds: &[UnknownKind], unknowns: &[f64], n: usize) -> [Columns; 2] {
    let mut columns = [Columns::default(), Columns::default()];
    for (kind, column) in kinds.iter().zip(unknowns.chunks_exact(n)) {
        let (which, at_m) = match kind {
            UnknownKind::Displacement { at_m, .. } => (0, *at_m),
            UnknownKind::Contact { at_m } => (1, *at_m),
            UnknownKind::Other => continue,
        };
        columns[which].0.push(at_m);
        columns[which].1.extend_from_slice(column);
    }
    columns
}

/// Standard deviation of each measurement's noise: that of the quiet frames about a line, for they drift, and of its rounding
/// at least.
fn noise(skin: &DetectorModel<'_>, step_v: f64) -> Vec<f64> {
    let rounding_v = step_v / 12.0_f64.sqrt();
    let frames = skin.quiet_v.nrows() as f64;
    let of_quiet = |i: usize| {
        let values = || skin.quiet_v.column(i).into_iter().enumerate();
        let time = |frame: usize| frame as f64 - 0.5 * (frames - 1.0);
        let [mut sum, mut square, mut trend, mut times] = [0.0; 4];
        for (frame, v) in values() {
            (sum, trend, times) = (sum + v, trend + v * time(frame), times + time(frame).powi(2));
        }
        for (frame, v) in values() {
            square += (v - sum / frames - time(frame) * trend / times).powi(2);
        }
        // a maximum ignores NaN: three frames at least
        (square / (frames - 2.0)).sqrt()
    };
    let std_v: Vec<f64> = (skin.noise_std_v.iter().enumerate())
        .map(|(i, std)| std.max(rounding_v).max(of_quiet(i)))
        .collect();
    let of_used = std_v.iter().zip(skin.used).filter(|(_, used)| **used).map(|(std, _)| *std);
    let least_v = LEAST_NOISE.sqrt() * median(of_used).unwrap_or(0.0);
    std_v.into_iter().map(|std| std.max(least_v)).collect()
}

/// Standard deviation of the mean of two measurements; of one if they are the same.
fn row_noise(std_v: &[f64], i: usize, j: usize) -> f64 {
    if i == j { std_v[i] } else { 0.5 * std_v[i].hypot(std_v[j]) }
}

/// Rejects lengths that do not match, and used values that are not finite.
fn check_all(given: &ScoreModel<'_>, dents_v: &ArrayRef2<f64>) -> Result<(), InverseError> {
    let skin = &given.skin;
    check(skin)?;
    check_length("kinds", skin.kinds.len(), skin.unknowns.ncols())?;
    check_length("rows of the dents", dents_v.nrows(), skin.used.len())?;
    check_length("drives of measurements", given.drive.len(), skin.used.len())?;
    check_length("common potentials", given.common_v.len(), skin.used.len())?;
    check_length("leaks", given.leak_v.len(), skin.used.len())?;
    check_positive("conductivity_s", given.conductivity_s)?;
    for measurement in (0..skin.used.len()).filter(|&i| skin.used[i]) {
        check_finite(measurement, skin.jacobian.row(measurement))?;
        check_finite(measurement, dents_v.row(measurement))?;
    }
    Ok(())
}

/// Sine of the angle between the reference and the model's voltages.
fn misfit(rows: &Rows, skin: &DetectorModel<'_>, reference: &[f64]) -> f64 {
    // an instrument that gives magnitudes has ratios of both signs
    let of_model = |&[i, j]: &[usize; 2]| {
        0.5 * (skin.model_v[i] + skin.model_v[j]).copysign(skin.model_v[i] * rows.ratio[i])
    };
    let model: Vec<f64> = rows.of.iter().map(of_model).collect();
    let part = dot(&model, reference).powi(2) / (dot(&model, &model) * dot(reference, reference));
    if part.is_finite() { (1.0 - part).max(0.0).sqrt() } else { 1.0 }
}

/// Relative difference of the reference's reciprocal halves.
fn unequal(rows: &Rows, reference_v: &[f64]) -> f64 {
    let (mut difference, mut whole) = (0.0, 0.0);
    for &[i, j] in rows.of.iter().filter(|[i, j]| i != j) {
        difference += (reference_v[i] - reference_v[j]).powi(2);
        whole += reference_v[i].powi(2);
    }
    if whole > 0.0 { (difference / whole).sqrt() } else { 0.0 }
}

/// Covariance of the directions in which quiet frames vary by more than noise: waves in a tank, hum.
fn waves(rows: &Rows, noise_v: &[f64], quiet_v: ArrayView2<'_, f64>) -> Symmetric {
    let (n, frames) = (rows.of.len(), quiet_v.nrows());
    let mut covariance = Symmetric::zeros(n);
    let Some(mean) = quiet_v.mean_axis(Axis(0)).filter(|_| frames > 1) else { return covariance };
    let deviations = Mat::from_fn(n, frames, |row, frame| {
        let [i, j] = rows.of[row];
        let deviation = |i: usize| quiet_v[(frame, i)] - mean[i];
        0.5 * (deviation(i) + deviation(j)) / noise_v[row]
    });
    if deviations.col_iter().any(|column| column.iter().any(|v| !v.is_finite())) {
        return covariance;
    }
    let Ok(svd) = deviations.thin_svd() else { return covariance };
    let degrees = (frames - 1) as f64;
    let edge = ABOVE_NOISE * (1.0 + (n as f64 / degrees).sqrt()).powi(2);
    for (k, value) in svd.S().column_vector().iter().enumerate() {
        let variance = value * value / degrees;
        if variance > edge {
            let direction: Vec<f64> = svd.U().col(k).iter().copied().collect();
            covariance.add_square(variance - 1.0, &direction);
        }
    }
    covariance
}
