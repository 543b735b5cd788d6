//! Checks whether an instrument and its skin are ready for use: the instrument's stream as a whole, and
//! faulty electrodes by the same criteria as in use.

use crate::error::SkinError;
use crate::faults::{self, FaultKind};
use crate::frames::{ALIKE, are_magnitudes};
use crate::scene::Instrument;
use crate::skin::Skin;
use crate::twins;
use eit_hw::{Finding, HealthReport, Quadruple, Quality, ReferenceFrames, Severity, Trouble};

/// An electrode is noisy if its measurements without faulty electrodes have more than this multiple of the
/// noise of all such measurements.
const NOISY_TIMES: f64 = 4.0;

/// Checks frames of the untouched skin.
///
/// [`ReferenceFrames::check`] judges the stream (losses, rate, drift, saturation, overall reciprocity) and
/// computes figures per electrode; `faults::of_frames` finds the electrodes that would be excluded in use.
/// An electrode found by both is reported once.
///
/// # Errors
///
/// Too few frames; frames with the wrong length for the protocol.
pub fn check(quiet: &ReferenceFrames, instrument: &Instrument) -> Result<HealthReport, SkinError> {
    let mut report = quiet.check(&instrument.quadruples)?;
    let found = faults::of_frames(&instrument.quadruples, instrument.electrodes, &quiet.frames)?;
    for fault in &found {
        let electrode = fault.electrode as u32;
        let of_electrode = |finding: &&mut Finding| finding.electrode == Some(electrode);
        if let Some(known) = report.findings.iter_mut().find(of_electrode) {
            // excluded in use, so more than a warning
            known.severity = Severity::Fault;
            continue;
        }
        let trouble = match fault.kind {
            FaultKind::Contradicts | FaultKind::Drifts => Trouble::Contradicts,
            FaultKind::Stuck => Trouble::Repeats,
            FaultKind::Flagged => Trouble::Open {
                flagged_share: report
                    .electrodes
                    .get(fault.electrode)
                    .map_or(f64::NAN, |health| health.flagged_share),
            },
        };
        report.findings.push(Finding::of_electrode(electrode, trouble));
    }
    if !found.is_empty() {
        let faulty: Vec<u32> = found.iter().map(|fault| fault.electrode as u32).collect();
        let explained = Explained::new(&report, quiet, &instrument.quadruples, &faulty);
        report.findings.retain_mut(|finding| explained.leaves(finding));
    }
    report.findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    Ok(report)
}

/// Compares the mean frame with the model of the untouched skin: an order that is wrong as a whole, such as electrodes
/// counted from another one, does not violate reciprocity. Nothing is compared if an electrode is faulty. Magnitudes are
/// compared with magnitudes. Also finds places that the protocol cannot tell apart.
///
/// # Errors
///
/// A skin that cannot be solved; frames with the wrong length.
pub fn check_model(
    report: &mut HealthReport,
    quiet: &ReferenceFrames,
    skin: &Skin,
) -> Result<(), SkinError> {
    if report.findings.iter().any(|finding| finding.severity == Severity::Fault) {
        return Ok(());
    }
    let mut workspace = skin.model.workspace()?;
    let model = skin.solve(&skin.background_s(), &mut workspace)?.measurements().to_vec();
    let mean = quiet.frames.mean_frame();
    SkinError::check_measurements("the frames", mean.len(), model.len())?;
    let (mean, model): (Vec<f64>, Vec<f64>) =
        mean.into_iter().zip(model).filter(|(v, _)| v.is_finite()).unzip();
    let sizes = |values: &[f64]| -> Vec<f64> { values.iter().map(|v| v.abs()).collect() };
    let of_values = eit_hw::model_correlation(&mean, &model).map(f64::abs);
    let of_sizes = match are_magnitudes(&mean) {
        true => eit_hw::model_correlation(&mean, &sizes(&model)),
        false => None,
    };
    let correlation = of_values.into_iter().chain(of_sizes).reduce(f64::max);
    if let Some(correlation) = correlation.filter(|correlation| *correlation < ALIKE) {
        report.findings.push(Finding::of_whole(Trouble::Model { correlation }));
    }
    report.findings.extend(twins::finding(skin.twins()?.share()));
    report.findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    Ok(())
}

/// The measurements without faulty electrodes: those against a faulty electrode are noisy, too.
struct Explained<'a> {
    faulty: &'a [u32],
    /// Quadruple and noise of each measurement of sound electrodes.
    sound: Vec<(Quadruple, f64)>,
    noise: f64,
    /// Measurements of sound electrodes that are stuck.
    stuck: Vec<Quadruple>,
}

impl<'a> Explained<'a> {
    fn new(
        report: &HealthReport,
        quiet: &ReferenceFrames,
        quadruples: &[Quadruple],
        faulty: &'a [u32],
    ) -> Self {
        let is_sound = |quadruple: &Quadruple| !quadruple.iter().any(|e| faulty.contains(e));
        let measured = quadruples.iter().copied().zip(report.noise_std.iter().copied());
        let sound: Vec<_> = measured.filter(|(quadruple, _)| is_sound(quadruple)).collect();
        let columns = quiet.frames.quality.columns().into_iter();
        let is_stuck = |column: ndarray::ArrayView1<'_, Quality>| {
            column.iter().any(|quality| quality.contains(Quality::STUCK))
        };
        let stuck = columns.zip(quadruples).filter(|(column, q)| is_sound(q) && is_stuck(*column));
        Self {
            faulty,
            noise: finite_median(sound.iter().map(|(_, noise)| *noise)),
            stuck: stuck.map(|(_, quadruple)| *quadruple).collect(),
            sound,
        }
    }

    /// Returns whether a finding remains without the faulty electrodes; reduces its numbers to the
    /// others.
    fn leaves(&self, finding: &mut Finding) -> bool {
        match (&mut finding.trouble, finding.electrode) {
            (Trouble::Reciprocity { .. }, _) => false,
            (Trouble::Noisy { ratio }, Some(electrode)) if !self.faulty.contains(&electrode) => {
                let senses = |[_, _, m, n]: &Quadruple| *m == electrode || *n == electrode;
                let own = self.sound.iter().filter(|(q, _)| senses(q)).map(|(_, noise)| *noise);
                *ratio = finite_median(own) / self.noise;
                *ratio > NOISY_TIMES
            }
            (Trouble::Stuck { measurements, first, second }, _) => {
                *measurements = self.stuck.len();
                *second = self.stuck.get(1).copied();
                let still = self.stuck.first();
                still.iter().for_each(|quadruple| *first = **quadruple);
                still.is_some()
            }
            _ => true,
        }
    }
}

/// Median of the finite values; NaN if there are none.
fn finite_median(values: impl Iterator<Item = f64>) -> f64 {
    eit_core::median(values.filter(|value| value.is_finite())).unwrap_or(f64::NAN)
}
