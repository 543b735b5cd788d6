//! Whether an instrument and its skin are fit for use: what the frames say of the instrument as a whole,
//! and who is faulty by the same judgement as while the skin is in use.

use crate::error::SkinError;
use crate::faults::{self, FaultKind};
use crate::scene::Instrument;
use eit_hw::{Finding, HealthReport, Quadruple, Quality, ReferenceFrames, Severity, Trouble};

/// An electrode is noisy by itself where its measurements without the faulty electrodes have so many
/// times the noise of the others.
const NOISY_TIMES: f64 = 4.0;

/// Checks frames that were taken while nothing touched the skin.
///
/// [`ReferenceFrames::check`] judges the stream (losses, rate, drift, saturation, reciprocity as a whole)
/// and puts numbers to electrodes; [`faults::of_frames`] says which of them would be left out in use. An
/// electrode that either names is named once.
///
/// # Errors
///
/// Too few frames, or frames of another length than the protocol.
pub fn check(quiet: &ReferenceFrames, instrument: &Instrument) -> Result<HealthReport, SkinError> {
    let mut report = quiet.check(&instrument.quadruples)?;
    let found = faults::of_frames(&instrument.quadruples, instrument.electrodes, &quiet.frames)?;
    for fault in &found {
        let electrode = fault.electrode as u32;
        let of_electrode = |finding: &&mut Finding| finding.electrode == Some(electrode);
        if let Some(known) = report.findings.iter_mut().find(of_electrode) {
            // left out in use: no mere warning
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

/// What is left without the measurements of faulty electrodes: whoever measures against one of them is
/// noisy, too.
struct Explained<'a> {
    faulty: &'a [u32],
    /// Quadruple and noise of each measurement of sound electrodes.
    sound: Vec<(Quadruple, f64)>,
    noise: f64,
    /// Measurements of sound electrodes that stand still.
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
            noise: median(sound.iter().map(|(_, noise)| *noise)),
            stuck: stuck.map(|(_, quadruple)| *quadruple).collect(),
            sound,
        }
    }

    /// Whether a finding stands beside the faulty electrodes; its numbers are those without them.
    fn leaves(&self, finding: &mut Finding) -> bool {
        match (&mut finding.trouble, finding.electrode) {
            (Trouble::Reciprocity { .. }, _) => false,
            (Trouble::Noisy { ratio }, Some(electrode)) if !self.faulty.contains(&electrode) => {
                let senses = |[_, _, m, n]: &Quadruple| *m == electrode || *n == electrode;
                let own = self.sound.iter().filter(|(q, _)| senses(q)).map(|(_, noise)| *noise);
                *ratio = median(own) / self.noise;
                *ratio > NOISY_TIMES
            }
            (Trouble::Stuck { measurements, first }, _) => {
                *measurements = self.stuck.len();
                let still = self.stuck.first();
                still.iter().for_each(|quadruple| *first = **quadruple);
                still.is_some()
            }
            _ => true,
        }
    }
}

/// Of the finite values; not a number where there is none.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
