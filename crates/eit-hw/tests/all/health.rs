//! The health check finds and names what is broken, and finds nothing in a healthy skin.

use crate::common::{point_electrode_disc, rotated};
use eit_hw::{
    HealthReport, HwError, MeasuredFrames, Quality, StreamFacts, Trouble, Unit, Verdict,
    check_health,
};
use fixtures::Random;
use ndarray::Array2;

const FRAMES: usize = 60;
const NOISE: f64 = 1e-4;

/// Returns frames of a homogeneous disc, 25 per second.
fn healthy() -> MeasuredFrames {
    let quadruples = rotated(16);
    let truth = point_electrode_disc(&quadruples, 16);
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
    // the difference of two uniform numbers is triangular: half of them are within sqrt 3 (2 - sqrt
    // 2) = 1.015 deviations, which the factor for a normal distribution 1.4826 / sqrt 2 turns into
    // 1.064
    let mean = report.noise_std.iter().sum::<f64>() / 208.0;
    // the mean deviates by 1 %, and the median of a finite number is slightly too high
    assert!((mean / NOISE - 1.064).abs() < 0.05, "{mean:e}");
    assert!((report.frame_rate_hz.unwrap() - 25.0).abs() < 1e-9);
    assert!(report.reciprocity.unwrap() < 1e-3);
}

#[test]
fn a_bad_contact_is_found_by_reciprocity() {
    for electrode in [0, 5, 15] {
        let mut frames = healthy();
        let mut random = Random::new(8);
        for (mut column, quadruple) in frames.values.columns_mut().into_iter().zip(rotated(16)) {
            // it senses arbitrary values
            if quadruple[2] == electrode || quadruple[3] == electrode {
                let offset = random.between(-1.0, 1.0);
                column.mapv_inplace(|value| value + offset);
            }
        }
        let report = check(&frames);
        assert_eq!(report.verdict(), Verdict::Faulty);
        assert_eq!(faults(&report), [electrode], "{:?}", report.findings);
        let line = report.findings[0].to_string();
        assert!(line.starts_with(&format!("electrode {}: reciprocity", electrode + 1)), "{line}");
        assert!(line.contains("fasten it"), "{line}");
    }
}

#[test]
fn an_open_electrode_is_found_by_its_flags() {
    let mut frames = healthy();
    for (mut column, quadruple) in frames.quality.columns_mut().into_iter().zip(rotated(16)) {
        if quadruple.contains(&9) {
            column.fill(Quality::SATURATED);
        }
    }
    let report = check(&frames);
    assert_eq!(faults(&report), [9], "{:?}", report.findings);
    assert!(matches!(report.findings[0].trouble, Trouble::Open { flagged_share: 1.0 }));
}

#[test]
fn a_noisy_electrode_is_a_warning() {
    let mut frames = healthy();
    let mut random = Random::new(15);
    for (mut column, quadruple) in frames.values.columns_mut().into_iter().zip(rotated(16)) {
        if quadruple[2] == 3 || quadruple[3] == 3 {
            column.mapv_inplace(|value| value + 20.0 * NOISE * random.between(-1.0, 1.0));
        }
    }
    let report = check(&frames);
    assert_eq!((report.verdict(), faults(&report)), (Verdict::Usable, vec![3]));
    assert!(report.findings[0].to_string().contains("times as noisy"));
}

/// Where a converter hides the noise of most channels, those that change by a step are not noisier than it.
#[test]
fn a_coarse_converter_makes_no_electrode_noisy() {
    let mut frames = healthy();
    let quadruples = rotated(16);
    let mean = frames.values.row(0).to_owned();
    for (frame, mut row) in frames.values.rows_mut().into_iter().enumerate() {
        for ((value, quadruple), mean) in row.iter_mut().zip(&quadruples).zip(&mean) {
            let senses = quadruple[2..].contains(&3);
            *value = mean + if senses && frame % 3 == 0 { NOISE } else { 0.0 };
        }
    }
    let report = check(&frames);
    assert!(report.electrodes.iter().all(|electrode| electrode.noise_ratio < 5.0));
    assert!(faults(&report).is_empty(), "{:?}", report.findings);
}

#[test]
fn troubles_of_the_whole_are_reported_with_what_to_try() {
    let only = |report: &HealthReport, start: &str| {
        assert_eq!(report.findings.len(), 1, "{:?}", report.findings);
        let line = report.findings[0].to_string();
        assert!(line.starts_with(start), "{line}");
    };
    let mut saturated = healthy();
    saturated.quality.column_mut(0).fill(Quality::SATURATED);
    saturated.quality.column_mut(60).fill(Quality::SATURATED);
    saturated.quality.column_mut(120).fill(Quality::OVER_RANGE);
    only(&check(&saturated), "1.4 % of the values are saturated; lower the gain");

    let mut drifting = healthy();
    for (frame, mut row) in drifting.values.rows_mut().into_iter().enumerate() {
        row.mapv_inplace(|value| value + frame as f64 * NOISE);
    }
    only(&check(&drifting), "values drift by");

    let mut swapped = healthy();
    // swapping the wires of two electrodes at the voltmeter is not the fault of one electrode
    let mut random = Random::new(1);
    swapped
        .values
        .columns_mut()
        .into_iter()
        .for_each(|mut column| column.fill(random.between(-1.0, 1.0)));
    let report = check(&swapped);
    assert!(report.findings[0].to_string().starts_with("reciprocity error"), "{report:?}");

    let mut stuck = healthy();
    stuck.quality.column_mut(13).fill(Quality::STUCK);
    only(&check(&stuck), "drive (2, 3), pair (4, 5) does not change; check the multiplexer");

    let lossy = StreamFacts { lost_frames: 6, wanted_rate_hz: None };
    let report = check_health(&healthy(), &rotated(16), &lossy).unwrap();
    only(&report, "9.1 % of the data are lost");
    let slow = StreamFacts { lost_frames: 0, wanted_rate_hz: Some(50.0) };
    let report = check_health(&healthy(), &rotated(16), &slow).unwrap();
    only(&report, "25.00 frames per second instead of 50.00");

    let mut silent = healthy();
    silent.values.fill(0.0);
    let report = check(&silent);
    assert_eq!(report.verdict(), Verdict::Faulty);
    assert!(report.findings.iter().any(|finding| finding.trouble == Trouble::Silent));
}

/// A board that repeats an old frame has no noise, no drift and no loss.
#[test]
fn frames_that_are_all_equal_are_named() {
    let is_frozen = |report: &HealthReport| {
        report.findings.iter().any(|finding| finding.trouble == Trouble::Frozen { frames: FRAMES })
    };
    let mut frozen = healthy();
    let first = frozen.values.row(0).to_owned();
    frozen.values.rows_mut().into_iter().for_each(|mut row| row.assign(&first));
    let report = check(&frozen);
    assert!(is_frozen(&report), "{:?}", report.findings);
    assert!(report.findings.iter().any(|f| f.to_string().starts_with("all 60 frames are equal;")));
    // the last digit of one value
    let mut moving = frozen;
    moving.values[[FRAMES - 1, 207]] *= 1.0 + 2.0 * f64::EPSILON;
    assert!(!is_frozen(&check(&moving)));
    assert!(!is_frozen(&check(&healthy())));
}

/// Frames without numbers are lost; those of an electrode without contact are its fault alone.
#[test]
fn frames_without_numbers_are_lost() {
    let lost = |report: &HealthReport| {
        report.findings.iter().find_map(|finding| match finding.trouble {
            Trouble::Loss { share } => Some(share),
            _ => None,
        })
    };
    let mut broken = healthy();
    for frame in [7, 20, 41] {
        broken.values.row_mut(frame).fill(f64::NAN);
        broken.quality.row_mut(frame).fill(Quality::NON_FINITE);
    }
    let report = check(&broken);
    assert_eq!(lost(&report), Some(3.0 / 60.0), "{:?}", report.findings);
    assert!(faults(&report).is_empty(), "{:?}", report.findings);

    let mut open = healthy();
    for (m, quadruple) in rotated(16).iter().enumerate() {
        if quadruple.contains(&9) {
            open.values.column_mut(m).fill(f64::NAN);
            open.quality.column_mut(m).fill(Quality::NON_FINITE);
        }
    }
    let report = check(&open);
    assert_eq!((lost(&report), faults(&report)), (None, vec![9]), "{:?}", report.findings);
}

#[test]
fn bad_input_is_refused() {
    let frames = healthy();
    let error = check_health(&frames, &rotated(8), &facts()).unwrap_err();
    assert!(matches!(error, HwError::QuadrupleCount { quadruples: 40, count: 208 }));
    let mut few = healthy();
    few.values = few.values.select(ndarray::Axis(0), &[0, 1, 2]);
    few.quality = few.quality.select(ndarray::Axis(0), &[0, 1, 2]);
    let error = check_health(&few, &rotated(16), &facts()).unwrap_err();
    assert!(error.to_string().contains("3 frames, but expected 8"), "{error}");
    let mut wild = healthy();
    wild.values.fill(f64::NAN);
    assert_eq!(check(&wild).verdict(), Verdict::Faulty);
}

/// A real tank and instrument without known faults.
#[test]
fn a_real_tank_is_healthy() {
    let Some(folder) = fixtures::shared_data("sciospec_tank_adjacent") else { return };
    let recording = eit_hw::read_recording(&folder, None, &eit_hw::ReadOptions::default()).unwrap();
    let wanted = rotated(16);
    let frames = recording.frames_for(Some(&wanted), 208, eit_hw::Component::Phased).unwrap();
    let report = check_health(&frames, &wanted, &StreamFacts::default()).unwrap();
    println!("{:?} dB, reciprocity {:?}", report.signal_to_noise_db, report.reciprocity);
    report.findings.iter().for_each(|finding| println!("{finding}"));
    assert!(faults(&report).is_empty() && report.verdict() != Verdict::Faulty);
}
