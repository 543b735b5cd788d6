//! The health check finds and names what is broken, and finds nothing in a healthy skin.

use crate::common::{point_electrode_disc, refused, rotated};
use eit_hw::{
    HealthReport, MeasuredFrames, Quadruple, Quality, StreamFacts, Trouble, Unit, Verdict,
    check_health,
};
use fixtures::Random;
use ndarray::Array2;

const FRAMES: usize = 60;
const NOISE: f64 = 1e-4;

/// Returns frames of a homogeneous disc, 25 per second.
fn healthy() -> MeasuredFrames {
    let truth = point_electrode_disc(&rotated(16), 16);
    let mut random = Random::new(4);
    let values = Array2::from_shape_fn((FRAMES, 208), |(_, m)| truth[m] + NOISE * random.normal());
    MeasuredFrames {
        quality: Array2::default(values.raw_dim()),
        values,
        unit: Unit::Volt,
        device_time_s: Some((0..FRAMES).map(|frame| frame as f64 / 25.0).collect()),
        frequency_hz: None,
        current_a: None,
        phase_rad: None,
    }
}

fn facts() -> StreamFacts {
    StreamFacts { lost_frames: 0, wanted_rate_hz: Some(25.0) }
}

fn check(frames: &MeasuredFrames) -> HealthReport {
    check_health(frames, &rotated(16), &facts()).unwrap()
}

fn faults(report: &HealthReport) -> Vec<u32> {
    report.findings.iter().filter_map(|finding| finding.electrode).collect()
}

#[test]
fn nothing_is_found_where_nothing_is_wrong() {
    let report = check(&healthy());
    assert_eq!((report.verdict(), report.findings.len()), (Verdict::Good, 0), "{report:?}");
    // a median of 59 values has a deviation of about 15 %; 208 of them stay within five
    for noise in &report.noise_std {
        assert!((noise / NOISE - 1.0).abs() < 0.75, "{noise:e}");
    }
    // the difference of two uniform numbers is triangular: half of them are within 1.015 deviations,
    // which the factor for a normal distribution, 1.4826 / sqrt 2, turns into 1.064
    let mean = report.noise_std.iter().sum::<f64>() / 208.0;
    // the mean deviates by 1 %, and the median of a finite number is slightly too high
    assert!((mean / NOISE - 1.064).abs() < 0.05, "{mean:e}");
    assert!((report.frame_rate_hz.unwrap() - 25.0).abs() < 1e-9);
    assert!(report.reciprocity.unwrap() < 1e-3);
}

/// Healthy frames, but for the measurements that this holds for: their flags and values by frame and measurement.
fn with(
    of: impl Fn(Quadruple) -> bool,
    flags: Quality,
    value: impl Fn(usize, usize, f64) -> f64,
) -> MeasuredFrames {
    let mut frames = healthy();
    for (m, _) in rotated(16).into_iter().enumerate().filter(|(_, quadruple)| of(*quadruple)) {
        frames.quality.column_mut(m).fill(flags);
        let column = frames.values.column_mut(m).into_iter().enumerate();
        column.for_each(|(frame, slot)| *slot = value(frame, m, *slot));
    }
    frames
}

fn arbitrary(number: usize) -> f64 {
    Random::new(number as u64).between(-1.0, 1.0)
}

#[test]
fn faults_of_an_electrode_are_found() {
    for electrode in [0, 5, 15] {
        // it senses arbitrary values
        let senses = |q: Quadruple| q[2..].contains(&electrode);
        let report = check(&with(senses, Quality::GOOD, |_, m, value| value + arbitrary(m)));
        assert_eq!(report.verdict(), Verdict::Faulty);
        assert_eq!(faults(&report), [electrode], "{:?}", report.findings);
        let line = report.findings[0].to_string();
        // people count from 1
        assert!(line.starts_with(&format!("electrode {}: reciprocity", electrode + 1)), "{line}");
        assert!(line.contains("fasten it"), "{line}");
    }
    let report = check(&with(|q| q.contains(&9), Quality::SATURATED, |_, _, value| value));
    assert_eq!(faults(&report), [9], "{:?}", report.findings);
    assert!(matches!(report.findings[0].trouble, Trouble::Open { flagged_share: 1.0 }));

    let senses = |q: Quadruple| q[2..].contains(&3);
    let noise = |frame, m, value| value + 20.0 * NOISE * arbitrary(208 * frame + m);
    let report = check(&with(senses, Quality::GOOD, noise));
    assert_eq!((report.verdict(), faults(&report)), (Verdict::Usable, vec![3]));
    assert!(report.findings[0].to_string().contains("times as noisy"));
    // where a converter hides the noise of most channels, those that change by a step are not noisier than it
    let mean = healthy().values.row(0).to_owned();
    let coarse = |frame: usize, m: usize, _| {
        let is_step = senses(rotated(16)[m]) && frame.is_multiple_of(3);
        mean[m] + if is_step { NOISE } else { 0.0 }
    };
    let report = check(&with(|_| true, Quality::GOOD, coarse));
    assert!(report.electrodes.iter().all(|electrode| electrode.noise_ratio < 5.0));
    assert!(faults(&report).is_empty(), "{:?}", report.findings);
}

#[test]
fn troubles_of_the_whole_are_reported_with_what_to_try() {
    let mut saturated = healthy();
    saturated.quality.column_mut(0).fill(Quality::SATURATED);
    saturated.quality.column_mut(60).fill(Quality::SATURATED);
    saturated.quality.column_mut(120).fill(Quality::OVER_RANGE);
    let drifts = |frame, _, value| value + frame as f64 * NOISE;
    let mut stuck = healthy();
    stuck.quality.column_mut(13).fill(Quality::STUCK);
    let of = |lost_frames, wanted_rate_hz| StreamFacts { lost_frames, wanted_rate_hz };
    for (frames, facts, wanted) in [
        (saturated, facts(), "1.4 % of the values are saturated; lower the gain"),
        (with(|_| true, Quality::GOOD, drifts), facts(), "values drift by"),
        (stuck, facts(), "drive (2, 3), pair (4, 5) does not change; check the multiplexer"),
        (healthy(), of(6, None), "9.1 % of the data are lost"),
        (healthy(), of(0, Some(50.0)), "25.00 frames per second instead of 50.00"),
    ] {
        let findings = check_health(&frames, &rotated(16), &facts).unwrap().findings;
        assert_eq!(findings.len(), 1, "{findings:?}");
        assert!(findings[0].to_string().starts_with(wanted), "{findings:?}");
    }

    // swapping the wires of two electrodes at the voltmeter is not the fault of one electrode
    let report = check(&with(|_| true, Quality::GOOD, |_, m, _| arbitrary(m)));
    assert!(report.findings[0].to_string().starts_with("reciprocity error"), "{report:?}");

    let report = check(&with(|_| true, Quality::GOOD, |_, _, _| 0.0));
    assert_eq!(report.verdict(), Verdict::Faulty);
    assert!(report.findings.iter().any(|finding| finding.trouble == Trouble::Silent));
}

/// A board that repeats an old frame has no noise, no drift and no loss.
#[test]
fn frames_that_are_all_equal_are_named() {
    let frozen = |frames: &MeasuredFrames| {
        let is_frozen = |trouble: &Trouble| *trouble == Trouble::Frozen { frames: FRAMES };
        check(frames).findings.into_iter().find(|finding| is_frozen(&finding.trouble))
    };
    assert_eq!(frozen(&healthy()), None);
    let first = healthy().values.row(0).to_owned();
    let mut frames = with(|_| true, Quality::GOOD, |_, m, _| first[m]);
    assert!(frozen(&frames).unwrap().to_string().starts_with("all 60 frames are equal;"));
    // the last digit of one value
    frames.values[[FRAMES - 1, 207]] *= 1.0 + 2.0 * f64::EPSILON;
    assert_eq!(frozen(&frames), None);
}

/// Frames without numbers are lost; those of an electrode without contact are its fault alone.
#[test]
fn frames_without_numbers_are_lost() {
    let found = |frames: &MeasuredFrames| {
        let report = check(frames);
        let lost = report.findings.iter().find_map(|finding| match finding.trouble {
            Trouble::Loss { share } => Some(share),
            _ => None,
        });
        (lost, faults(&report))
    };
    let mut broken = healthy();
    for frame in [7, 20, 41] {
        broken.values.row_mut(frame).fill(f64::NAN);
        broken.quality.row_mut(frame).fill(Quality::NON_FINITE);
    }
    assert_eq!(found(&broken), (Some(3.0 / 60.0), vec![]));
    let open = with(|q| q.contains(&9), Quality::NON_FINITE, |_, _, _| f64::NAN);
    assert_eq!(found(&open), (None, vec![9]));
}

#[test]
fn bad_input_is_refused() {
    refused(check_health(&healthy(), &rotated(8), &facts()), &["40 quadruples given for 208"]);
    let mut few = healthy();
    few.values = few.values.select(ndarray::Axis(0), &[0, 1, 2]);
    few.quality = few.quality.select(ndarray::Axis(0), &[0, 1, 2]);
    refused(check_health(&few, &rotated(16), &facts()), &["3 frames, but expected 8"]);
    let mut wild = healthy();
    wild.values.fill(f64::NAN);
    assert_eq!(check(&wild).verdict(), Verdict::Faulty);
}

#[test]
fn a_real_tank_is_healthy() {
    let Some(folder) = fixtures::shared_data("sciospec_tank_adjacent") else { return };
    let recording = eit_hw::read_recording(&folder, None, &eit_hw::ReadOptions::default()).unwrap();
    let wanted = rotated(16);
    let frames = recording.frames_for(Some(&wanted), 208, eit_hw::Component::Phased).unwrap();
    let report = check_health(&frames, &wanted, &StreamFacts::default()).unwrap();
    assert!(faults(&report).is_empty() && report.verdict() != Verdict::Faulty, "{report:?}");
}
