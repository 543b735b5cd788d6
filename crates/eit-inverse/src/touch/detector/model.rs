//! Inputs of a detector: their checks, and the covariance by which rows are whitened.

use super::electrodes::UnknownKind;
use super::quiet;
use super::rows::Rows;
use super::whitening::Whitening;
use crate::InverseError;
use crate::check::{check_finite, check_length, check_positive};
use eit_mesh::Surface;
use faer::Mat;
use ndarray::{ArrayRef2, ArrayView2};

/// Inputs of a [`TouchDetector`](super::TouchDetector). Rows `[measurement]` are in protocol order.
#[derive(Debug, Clone, Copy)]
pub struct DetectorModel<'a> {
    /// Surface of the skin.
    pub surface: &'a Surface,
    /// Jacobian, `[measurement, element]`, volts per siemens.
    pub jacobian: &'a ArrayRef2<f64>,
    /// Voltages of the untouched model, volts.
    pub model_v: &'a [f64],
    /// Other effects on the model's voltages, one column per unknown, volts per standard deviation of the
    /// unknown: `[measurement, unknown]`.
    pub unknowns: &'a ArrayRef2<f64>,
    /// Kind of each unknown. Each touch has its own unknowns for the electrodes and contacts that it affects;
    /// without a touch these vary by only a small part of their stated deviation. Empty: touches affect none of
    /// them.
    pub kinds: &'a [UnknownKind],
    /// The reference frame, volts.
    pub reference_v: &'a [f64],
    /// Standard deviation of the noise of a frame minus the reference, volts.
    pub noise_std_v: &'a [f64],
    /// Frames during which nothing touched the skin, `[frame, measurement]`, volts. Variation
    /// beyond the noise (waves in a tank, hum, a swinging cable) does not count as a touch. May
    /// have no rows.
    pub quiet_v: ArrayView2<'a, f64>,
    /// Which measurements are used.
    pub used: &'a [bool],
    /// Index of each measurement's reciprocal; its own index if it has none.
    pub reciprocal: &'a [usize],
    /// Measurements that involve each electrode; empty to turn off the search for faulty electrodes.
    pub of_electrode: &'a [Vec<usize>],
}

/// Rejects lengths that do not match, and used values that are not finite.
pub(in crate::touch) fn check(model: &DetectorModel<'_>) -> Result<(), InverseError> {
    let DetectorModel { surface, jacobian, unknowns, .. } = model;
    let (measurements, elements) = jacobian.dim();
    check_length("Jacobian columns", elements, surface.triangles().len())?;
    check_length("model_v", model.model_v.len(), measurements)?;
    check_length("rows of the unknowns", unknowns.nrows(), measurements)?;
    if !model.kinds.is_empty() {
        check_length("kinds", model.kinds.len(), unknowns.ncols())?;
    }
    check_length("reference_v", model.reference_v.len(), measurements)?;
    check_length("noise_std_v", model.noise_std_v.len(), measurements)?;
    check_length("used", model.used.len(), measurements)?;
    check_length("reciprocal", model.reciprocal.len(), measurements)?;
    if model.quiet_v.nrows() > 0 {
        check_length("quiet_v", model.quiet_v.ncols(), measurements)?;
    }
    for i in (0..measurements).filter(|&i| model.used[i]) {
        let value = model.reference_v[i];
        if !value.is_finite() {
            return Err(InverseError::NonFiniteReference { measurement: i, value });
        }
        check_positive("noise_std_v", model.noise_std_v[i])?;
        check_finite(i, unknowns.row(i))?;
    }
    let stray = model.of_electrode.iter().flatten().find(|&&i| i >= measurements);
    match stray {
        Some(&measurement) => Err(InverseError::UnknownMeasurement { measurement, measurements }),
        None => Ok(()),
    }
}

/// Whitening of the rows by noise, unknowns and what quiet frames show beyond them; and the kinds of those unknowns on
/// which touches act.
pub(super) fn whitening_of(
    model: &DetectorModel<'_>,
    rows: &Rows,
) -> Result<(Whitening, Vec<UnknownKind>), InverseError> {
    let n = rows.of.len();
    let variance = |&[i, j]: &[usize; 2]| {
        let [a, b] = [i, j].map(|k| model.noise_std_v[k].powi(2));
        if i == j { a } else { 0.25 * (a + b) }
    };
    let variances: Vec<f64> = rows.of.iter().map(variance).collect();
    let unknowns = Mat::from_fn(n, model.unknowns.ncols(), |row, k| {
        rows.scaled_mean(row, |i| model.unknowns[(i, k)])
    });
    let kind_of = |k: usize| model.kinds.get(k).copied().unwrap_or(UnknownKind::Other);
    let acted: Vec<usize> =
        (0..unknowns.ncols()).filter(|&k| kind_of(k) != UnknownKind::Other).collect();
    let local = Mat::from_fn(n, acted.len(), |row, k| unknowns[(row, acted[k])]);
    let unknowns =
        Mat::from_fn(n, unknowns.ncols(), |row, k| kind_of(k).share_alone() * unknowns[(row, k)]);
    let whitening = Whitening::new(&variances, unknowns.as_ref())?;
    let whitening = match quiet::components(rows, &whitening, model.quiet_v) {
        Some(more) => {
            let (known, count) = (unknowns.ncols(), unknowns.ncols() + more.ncols());
            let all = Mat::from_fn(n, count, |i, k| match k.checked_sub(known) {
                None => unknowns[(i, k)],
                Some(k) => more[(i, k)],
            });
            Whitening::new(&variances, all.as_ref())?
        }
        None => whitening,
    };
    let acted = acted.into_iter().map(kind_of).collect();
    Ok((whitening.with_local(local.as_ref()), acted))
}
