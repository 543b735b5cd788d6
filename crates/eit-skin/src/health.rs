//! Whether an instrument and its skin are fit for use: what the frames say of the instrument as a whole,
//! and who is faulty by the same judgement as while the skin is in use.

use crate::error::SkinError;
use crate::faults::{self, FaultKind};
use crate::scene::Instrument;
use eit_hw::{Finding, HealthReport, ReferenceFrames, Severity, Trouble};

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
        // the electrodes explain it
        report.findings.retain(|finding| !matches!(finding.trouble, Trouble::Reciprocity { .. }));
    }
    report.findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    Ok(report)
}
