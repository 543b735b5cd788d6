//! Checks whether an instrument and its skin are fit for use, and what to try if not.

mod finding;
mod measure;
mod resolution;

pub use resolution::Resolution;

pub use finding::{Finding, Severity, Trouble, Verdict};

use self::measure::{drift, finite_median, flagged_shares, noise_std, open_electrodes};
use eit_core::median;
use ndarray::ArrayView1;

use super::order::{CLEAR_FACTOR, MOST_ERROR, reciprocity_error};
use crate::error::{HwError, Place};
use crate::frame::{Quadruple, Quality};
use crate::recording::MeasuredFrames;

/// Noise of an electrode's measurements, relative to the rest, from which it is reported.
const NOISY_FACTOR: f64 = 4.0;
/// Fraction of all values, or of frames, above which a loss is reported.
const LOST_SHARE: f64 = 0.01;
/// Relative error of the frame rate above which it is reported.
const RATE_ERROR: f64 = 0.05;
/// Median drift, in multiples of the noise of one value, above which it is reported.
const DRIFT_FACTOR: f64 = 5.0;

/// What is known of the stream besides its values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StreamFacts {
    /// Number of lost frames, such as [`Statistics::lost`](crate::driver::Statistics::lost).
    pub lost_frames: u64,
    /// Frame rate that was requested, in hertz.
    pub wanted_rate_hz: Option<f64>,
}

/// The state of one electrode.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ElectrodeHealth {
    /// Number of measurements that use the electrode.
    pub measurements: usize,
    /// Fraction of their values with a flag.
    pub flagged_share: f64,
    /// Median noise of the measurements that sense at the electrode, relative to that of all, each at least that of
    /// rounding; NaN without noise.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::nan"))]
    pub noise_ratio: f64,
    /// Reciprocity error of the measurements without this electrode; `None` if none of them are
    /// reciprocal. If it is far below the error of all measurements, this electrode is at fault.
    pub reciprocity_without: Option<f64>,
}

/// What a health check measured and found wrong.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct HealthReport {
    /// Reciprocity error of the mean frame, see [`reciprocity_error`].
    pub reciprocity: Option<f64>,
    /// Standard deviation of each measurement's noise, in the unit of the values. From the median
    /// absolute difference of successive frames, so that neither drift nor single outliers count.
    pub noise_std: Vec<f64>,
    /// Change of each measurement from the first to the last quarter of the frames.
    pub drift: Vec<f64>,
    /// Median over the measurements of 20 lg(|mean| / noise), in dB.
    pub signal_to_noise_db: Option<f64>,
    /// Resolution of the values; `None` if no value changes.
    pub resolution: Option<Resolution>,
    /// Frames per second by the frames' clock.
    pub frame_rate_hz: Option<f64>,
    /// Fraction of frames that were lost.
    pub lost_share: f64,
    /// State of each electrode, from 0.
    pub electrodes: Vec<ElectrodeHealth>,
    /// Problems found, worst first.
    pub findings: Vec<Finding>,
}

impl HealthReport {
    /// Minimum number of frames, from which the noise is estimated.
    pub const LEAST_FRAMES: usize = 8;

    /// Returns the verdict that follows from the worst finding.
    pub fn verdict(&self) -> Verdict {
        match self.findings.first().map(|finding| finding.severity) {
            None => Verdict::Good,
            Some(Severity::Warning) => Verdict::Usable,
            Some(Severity::Fault) => Verdict::Faulty,
        }
    }
}

/// Checks frames that were measured while nothing touched the skin.
///
/// `quadruples` are the electrodes of the measurements, in the frames' order.
///
/// # Errors
/// [`HwError::QuadrupleCount`] if their number differs from the values per frame, and
/// [`HwError::Count`] for fewer than [`HealthReport::LEAST_FRAMES`].
pub fn check_health(
    frames: &MeasuredFrames,
    quadruples: &[Quadruple],
    facts: &StreamFacts,
) -> Result<HealthReport, HwError> {
    let (found, count) = frames.values.dim();
    if quadruples.len() != count {
        return Err(HwError::QuadrupleCount { quadruples: quadruples.len(), count });
    }
    if found < HealthReport::LEAST_FRAMES {
        return Err(HwError::count(
            Place::file("health check".as_ref()),
            "frames",
            [found, HealthReport::LEAST_FRAMES],
            "record a second or more of the untouched skin",
        ));
    }
    let mean = frames.mean_frame();
    let columns = || frames.values.columns().into_iter().zip(frames.quality.columns());
    let noise_std: Vec<f64> = columns().map(|(v, q)| noise_std(v, q)).collect();
    let drift = drift(frames);
    let ratios =
        mean.iter().zip(&noise_std).map(|(mean, noise)| 20.0 * (mean.abs() / noise).log10());
    let signal_to_noise_db = median(ratios.filter(|ratio| ratio.is_finite()));
    let rate = frames.device_time_s.as_ref().and_then(|times| {
        let span = times.last()? - times.first()?;
        // lost frames took time, too
        let steps = (times.len() - 1) as f64 + facts.lost_frames as f64;
        (span > 0.0).then_some(steps / span)
    });
    let resolution = Resolution::of(frames, &mean);
    // rounding hides noise below a step, of which a channel that stands still says nothing
    let floor = resolution.map_or(0.0, |resolution| resolution.step / 12.0_f64.sqrt());
    let rounded: Vec<f64> =
        noise_std.iter().map(|n| if n.is_finite() { n.max(floor) } else { *n }).collect();
    let mut report = HealthReport {
        reciprocity: reciprocity_error(quadruples, &mean),
        electrodes: electrodes(frames, quadruples, &mean, &rounded),
        noise_std,
        drift,
        signal_to_noise_db,
        resolution,
        frame_rate_hz: rate,
        lost_share: facts.lost_frames as f64 / (facts.lost_frames as f64 + found as f64),
        findings: Vec::new(),
    };
    report.findings = findings(&report, frames, quadruples, facts);
    report.findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    Ok(report)
}

fn electrodes(
    frames: &MeasuredFrames,
    quadruples: &[Quadruple],
    mean: &[f64],
    noise_std: &[f64],
) -> Vec<ElectrodeHealth> {
    let count = quadruples.iter().flatten().max().map_or(0, |&last| last + 1);
    let all_noise = finite_median(noise_std.iter().copied());
    let flagged = flagged_shares(frames);
    (0..count)
        .map(|electrode| {
            let with = |quadruple: &Quadruple| quadruple.contains(&electrode);
            let of = |values: &[f64]| -> Vec<f64> {
                values.iter().zip(quadruples).filter(|(_, q)| with(q)).map(|(v, _)| *v).collect()
            };
            let shares = of(&flagged);
            let senses = |[_, _, m, n]: &Quadruple| *m == electrode || *n == electrode;
            let noise =
                noise_std.iter().zip(quadruples).filter(|(_, q)| senses(q)).map(|(n, _)| *n);
            let (others, values): (Vec<Quadruple>, Vec<f64>) =
                quadruples.iter().zip(mean).filter(|(q, _)| !with(q)).unzip();
            ElectrodeHealth {
                measurements: shares.len(),
                flagged_share: shares.iter().sum::<f64>() / shares.len().max(1) as f64,
                noise_ratio: finite_median(noise) / all_noise,
                reciprocity_without: reciprocity_error(&others, &values),
            }
        })
        .collect()
}

fn findings(
    report: &HealthReport,
    frames: &MeasuredFrames,
    quadruples: &[Quadruple],
    facts: &StreamFacts,
) -> Vec<Finding> {
    let share_of = |flag: Quality| {
        let with = frames.quality.iter().filter(|quality| quality.contains(flag)).count();
        with as f64 / frames.quality.len().max(1) as f64
    };
    let mut findings = electrode_findings(report, frames, quadruples);
    let are_all_good = findings.is_empty();
    if let Some(error) = report.reciprocity.filter(|error| *error > MOST_ERROR && are_all_good) {
        findings.push(Finding::of_whole(Trouble::Reciprocity { error }));
    }
    let limit = share_of(Quality::SATURATED) + share_of(Quality::OVER_RANGE);
    // an open electrode saturates its measurements and is reported already
    if limit > LOST_SHARE && are_all_good {
        findings.push(Finding::of_whole(Trouble::Saturation { share: limit }));
    }
    let is_missing = |quality: &&Quality| {
        let is_no_number = quality.contains(Quality::NON_FINITE) && are_all_good;
        quality.contains(Quality::MISSING) || is_no_number
    };
    let missing = frames.quality.iter().filter(is_missing).count() as f64
        / frames.quality.len().max(1) as f64;
    let lost = report.lost_share + missing;
    if lost > LOST_SHARE {
        findings.push(Finding::of_whole(Trouble::Loss { share: lost }));
    }
    findings.extend(stuck(frames, quadruples).map(Finding::of_whole));
    if let Some(resolution) = report.resolution.filter(Resolution::is_coarse) {
        let Resolution { step, steps_per_touch, still } = resolution;
        let measurements = quadruples.len();
        let trouble = Trouble::Coarse { step, steps_per_touch, still, measurements };
        findings.push(Finding::of_whole(trouble));
    }
    if let (Some(rate), Some(wanted)) = (report.frame_rate_hz, facts.wanted_rate_hz)
        && (rate / wanted - 1.0).abs() > RATE_ERROR
    {
        findings.push(Finding::of_whole(Trouble::Rate { found_hz: rate, wanted_hz: wanted }));
    }
    let drifts = report.drift.iter().zip(&report.noise_std).map(|(d, n)| d.abs() / n);
    let drift = finite_median(drifts);
    if drift > DRIFT_FACTOR {
        findings.push(Finding::of_whole(Trouble::Drift { over_noise: drift }));
    }
    if frames.values.iter().all(|value| *value == 0.0 || !value.is_finite()) {
        findings.push(Finding::of_whole(Trouble::Silent));
    } else if frames.are_equal() {
        findings.push(Finding::of_whole(Trouble::Frozen { frames: frames.values.nrows() }));
    }
    findings
}

/// Returns open electrodes; without any, those that are noisy or have a poor contact: flagged values would distort
/// the mean, and with it the reciprocity.
fn electrode_findings(
    report: &HealthReport,
    frames: &MeasuredFrames,
    quadruples: &[Quadruple],
) -> Vec<Finding> {
    let open = open_electrodes(frames, quadruples, report.electrodes.len());
    if !open.is_empty() {
        let finding = |(electrode, flagged_share)| {
            Finding::of_electrode(electrode, Trouble::Open { flagged_share })
        };
        return open.into_iter().map(finding).collect();
    }
    let troubles = report.electrodes.iter().map(|health| electrode_trouble(report, health));
    let findings = (0..).zip(troubles);
    findings
        .filter_map(|(electrode, trouble)| Some(Finding::of_electrode(electrode, trouble?)))
        .collect()
}

/// Returns the measurements that repeat one value, if any does.
fn stuck(frames: &MeasuredFrames, quadruples: &[Quadruple]) -> Option<Trouble> {
    let is_stuck = |column: &ArrayView1<'_, Quality>| {
        column.iter().any(|quality| quality.contains(Quality::STUCK))
    };
    let columns = frames.quality.columns().into_iter().zip(quadruples);
    let mut stuck = columns.filter(|(column, _)| is_stuck(column)).map(|(_, quadruple)| *quadruple);
    let (first, second) = (stuck.next()?, stuck.next());
    let measurements = 1 + usize::from(second.is_some()) + stuck.count();
    Some(Trouble::Stuck { measurements, first, second })
}

/// Returns what is wrong with one electrode, checking the surest sign first.
fn electrode_trouble(report: &HealthReport, health: &ElectrodeHealth) -> Option<Trouble> {
    if let (Some(with), Some(without)) = (report.reciprocity, health.reciprocity_without)
        && with > MOST_ERROR
        && without * CLEAR_FACTOR <= with
    {
        return Some(Trouble::Contact { with, without });
    }
    let noisiest = report.electrodes.iter().fold(0.0_f64, |most, e| most.max(e.noise_ratio));
    // its neighbours are measured against it and are noisy as well
    (health.noise_ratio > NOISY_FACTOR && health.noise_ratio >= 0.9 * noisiest)
        .then_some(Trouble::Noisy { ratio: health.noise_ratio })
}
