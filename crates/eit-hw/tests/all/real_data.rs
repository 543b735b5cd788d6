//! Every reader on real recordings; each figure is stated in the folder's README.md. One file,
//! because all recordings go through the same checks.

use std::path::Path;

use crate::common::{
    ascending, ascending_kept, opposite, point_electrode_disc, rotated, rotated_kept, table,
};
use eit_hw::{
    At, Component, Format, FrameOrientation, HwError, Layout, MeasuredFrames, Note, OrderVerdict,
    Quadruple, Quality, ReadOptions, Recording, SkipReason, SkippedFrame, Unit, model_correlation,
    read_recording, reciprocity_error, recognise_order,
};

const METAL: &str = "pyeidors_tank16/electrode01_metal.csv";
const METAL_AND_PLASTIC: &str = "pyeidors_tank16/electrode01_metal_electrode05_plastic.csv";
const GOLF_BALL: &str = "golf_ball_b/phantom_16elec_1planeB_256xN.npy";

fn recognised(path: &Path) -> Recording {
    read_recording(path, None, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn real_frames(recording: &Recording, quadruples: &[Quadruple]) -> MeasuredFrames {
    recording.frames_for(Some(quadruples), quadruples.len(), Component::Real).unwrap()
}

/// Returns the reciprocity error of each frame.
fn errors(frames: &MeasuredFrames, quadruples: &[Quadruple]) -> Vec<f64> {
    let error = |frame: eit_hw::Frame| reciprocity_error(quadruples, &frame.values).unwrap();
    frames.frames().map(error).collect()
}

/// Asserts that all errors are in a range.
#[track_caller]
fn within(errors: &[f64], low: f64, high: f64) {
    for (frame, &error) in errors.iter().enumerate() {
        assert!(low <= error && error <= high, "frame {frame}: {error}");
    }
}

/// Asserts that the right order is confirmed, and suggested if the scene has the wrong one.
#[track_caller]
fn order_is_recognised(frame: &[f64], right: &[Quadruple], wrong: &[Quadruple]) {
    let verdict = recognise_order(frame, right, &[("wrong", wrong.to_vec())]);
    assert!(matches!(verdict, OrderVerdict::Consistent { .. }), "{verdict:?}");
    let alternatives = [("right", right.to_vec()), ("wrong too", wrong.to_vec())];
    match recognise_order(frame, wrong, &alternatives) {
        OrderVerdict::Other { better, ours } => {
            assert_eq!(better.len(), 1);
            assert_eq!(better[0].setting, "right");
            // wrong orders of all these recordings have errors of at least 0.75
            assert!(ours > 0.75, "{ours}");
        }
        other => panic!("{other:?}"),
    }
}

/// Each recording's reciprocity errors are those stated, and its order of measurements is recognised. Its shape is
/// that of a homogeneous disc with point electrodes, with the sign of the instrument.
#[test]
fn orders_errors_and_signs_are_those_stated() {
    let turned = [rotated(16), ascending(16)];
    let ascends = [ascending(16), rotated(16)];
    let kept = [ascending_kept(16), rotated_kept(16)];
    let (goe, sciospec, lct) = (Format::Goe, Format::Sciospec, Format::Lct);
    let lct_errors = [0.0975, 0.146];
    // the right order of the measurements and a wrong one, the lowest and highest error of a frame, and the sign
    // unless what is in the tank may hide its shape
    for (file, format, dim, [right, wrong], [low, high], sign) in [
        // single frames vary by 0.1 to 0.3 %
        ("goe_mf2_ball/ball_200_frames.get", goe, (200, 208), &turned, [0.0265, 0.0315], -1),
        // frames with and without object vary by 0.4 %
        ("sciospec_tank_adjacent", sciospec, (255, 256), &turned, [0.024, 0.032], 1),
        ("lct_2004/plastic_1.txt", lct, (1, 208), &ascends, [0.0975, 0.0985], 0),
        ("lct_2004/metal_1.txt", lct, (1, 208), &ascends, lct_errors, 0),
        ("lct_2004/metal_2_180.txt", lct, (1, 208), &ascends, lct_errors, 0),
        ("lct_2004/water_1.txt", lct, (1, 208), &ascends, lct_errors, -1),
        ("lct_2004/water_2.txt", lct, (1, 208), &ascends, lct_errors, 0),
        ("lct_2004/water_3.txt", lct, (1, 208), &ascends, lct_errors, 0),
        (METAL, Format::Csv, (2, 208), &turned, [0.012, 0.03], -1),
        (METAL_AND_PLASTIC, Format::Csv, (2, 208), &turned, [0.012, 0.03], 0),
        // the rod adds up to 1.2 %
        ("iirc_rod_2006/iirc_re_101x256.npy", Format::Npy, (101, 256), &kept, [0.055, 0.07], 1),
        (GOLF_BALL, Format::Npy, (4, 256), &kept, [0.0045, 0.0055], -1),
        // frames in which an electrode is off have errors of their own
        ("umitooko_serial16/__3.txt", Format::SerialLog, (243, 208), &turned, [0.0, f64::MAX], -1),
    ] {
        let Some(path) = fixtures::shared_data(file) else { continue };
        let is_csv = format == Format::Csv;
        let columns = table(FrameOrientation::Columns, true);
        let options = if is_csv { columns } else { ReadOptions::default() };
        let recording = read_recording(&path, None, &options).unwrap();
        assert_eq!((recording.format, recording.real.dim()), (format, dim), "{file}");
        let unit = match format {
            Format::Sciospec => Unit::Volt,
            Format::Lct => Unit::Ohm,
            _ => Unit::Arbitrary,
        };
        assert_eq!(recording.unit, unit, "{file}");
        let frames = real_frames(&recording, right);
        within(&errors(&frames, right), low, high);
        let mean = frames.mean_frame();
        order_is_recognised(&mean, right, wrong);
        let correlation = model_correlation(&mean, &point_electrode_disc(right, 16)).unwrap();
        // point electrodes, tanks with objects in them, and instruments of 20 years
        assert!(sign == 0 || f64::from(sign) * correlation > 0.95, "{file}: {correlation}");
    }
}

#[test]
fn goe_and_golf_ball() {
    let Some(goe) = fixtures::shared_data("goe_mf2_ball/ball_200_frames.get") else { return };
    let recording = recognised(&goe);
    assert!(recording.notes.is_empty() && recording.imaginary.is_none());
    assert_eq!(recording.skipped.frames, 0);
    let mean = real_frames(&recording, &rotated(16)).mean_frame();
    let error = reciprocity_error(&rotated(16), &mean).unwrap();
    assert!((error - 0.028).abs() < 0.0005, "{error}");

    let Some(npy) = fixtures::shared_data(GOLF_BALL) else { return };
    let (csv, npy) = (recognised(&npy.with_extension("csv")).real, recognised(&npy).real);
    assert_eq!(csv.dim(), npy.dim());
    // the text has 8 digits
    for (text, binary) in csv.iter().zip(&npy) {
        assert!((text - binary).abs() <= 1e-8 * binary.abs().max(1.0), "{text} {binary}");
    }
}

#[test]
fn sciospec_255_frames_at_20_a_second() {
    let Some(folder) = fixtures::shared_data("sciospec_tank_adjacent") else { return };
    let recording = recognised(&folder);
    assert_eq!((recording.frequency_hz, recording.current_a), (Some(10e3), Some(5e-3)));
    let Layout::Potentials { drives, electrodes: 16, driven: true } = &recording.layout else {
        panic!()
    };
    assert_eq!(drives[15], [15, 0]);

    let frames = real_frames(&recording, &rotated(16));
    let times = frames.device_time_s.as_ref().unwrap();
    assert_eq!(times[0], 0.0);
    // 254 periods of 50 ms; the time stamps in the files jitter by less than one
    assert!((times[254] - 12.7).abs() < 0.05, "{}", times[254]);

    // the scene's current of 1 mA instead of the file's 5 mA: a fifth of the volts
    let mut scaled = frames.clone();
    scaled.to_volts(1e-3);
    assert_eq!((frames.current_a, scaled.current_a), (Some(5e-3), Some(1e-3)));
    assert_eq!(scaled.values, &frames.values * (1e-3 / 5e-3));
    assert_eq!((scaled.unit, scaled.frequency_hz), (Unit::Volt, Some(10e3)));

    // current enters at the first channel of a drive, which has the highest potential
    for (index, &[a, b]) in drives.iter().enumerate() {
        let row = recording.real.row(0).to_owned();
        let potentials = &row.as_slice().unwrap()[index * 16..][..16];
        assert!(potentials.iter().all(|&potential| potential <= potentials[a as usize]));
        assert!(potentials.iter().all(|&potential| potential >= potentials[b as usize]));
    }
}

#[test]
fn sciospec_gives_any_pairs_of_its_drives_with_their_sign() {
    let Some(folder) = fixtures::shared_data("sciospec_tank_adjacent") else { return };
    let recording = recognised(&folder.join("setup_00001.eit"));
    assert_eq!(recording.frame_count(), 1);
    let quadruples = [[0, 1, 0, 1], [1, 0, 0, 1], [0, 1, 1, 0], [0, 1, 0, 0]];
    let frames = real_frames(&recording, &quadruples);
    // first line of the file: 1.2616... and -1.2601...
    let first = 1.261_636_853_218_078_6 + 1.260_147_690_773_010_3;
    assert_eq!(frames.values.row(0).to_vec(), [first, -first, -first, 0.0]);
    assert!(matches!(
        recording.frames_for(Some(&[[0, 8, 2, 3]]), 1, Component::Real),
        Err(HwError::MissingDrive { a: 0, b: 8, first_a: 0, first_b: 1, .. })
    ));
    assert!(matches!(
        recording.frames_for(Some(&[[0, 1, 2, 16]]), 1, Component::Real),
        Err(HwError::MissingElectrode { electrode: 16, count: 16, .. })
    ));
}

#[test]
fn lct_voltage_over_current() {
    let Some(folder) = fixtures::shared_data("lct_2004") else { return };
    for name in ["metal_1", "metal_2_180", "plastic_1", "water_1", "water_2", "water_3"] {
        let recording = recognised(&folder.join(format!("{name}.txt")));
        assert_eq!(recording.frequency_hz, Some(10e3));
        // 13 header lines, 208 rows, and one more
        assert_eq!(recording.notes, [Note::RepeatedLastRow { line: 222 }]);
        let frames = real_frames(&recording, &ascending(16));
        let mut volts = frames.clone();
        volts.to_volts(2e-3);
        assert_eq!((volts.unit, volts.values), (Unit::Volt, frames.values * 2e-3));
    }
}

#[test]
fn pyeidors_columns_alternate() {
    let frames_are = Some(FrameOrientation::Columns);
    let options = ReadOptions { frames_are, complex: true, ..ReadOptions::default() };
    for file in [METAL, METAL_AND_PLASTIC] {
        let Some(path) = fixtures::shared_data(file) else { return };
        let recording = read_recording(&path, None, &options).unwrap();
        let phased = recording.frames_for(Some(&rotated(16)), 208, Component::Phased).unwrap();
        within(&errors(&phased, &rotated(16)), 0.012, 0.03);
        order_is_recognised(&phased.mean_frame(), &rotated(16), &ascending(16));
        // read as rows, the file is rejected with the right key
        let refused = recognised(&path).frames_for(None, 208, Component::Real).unwrap_err();
        assert!(refused.to_string().contains("frames_are = \"columns\""), "{refused}");
    }
    let path = fixtures::shared_data(METAL).unwrap();
    let first = read_recording(&path, None, &options).unwrap();
    // first row of the file
    assert_eq!(first.real[[0, 0]], 0.105_571_510_388_850_71);
    assert_eq!(first.imaginary.unwrap()[[0, 0]], -0.050_626_061_392_131_43);
    assert_eq!(first.real[[1, 0]], 0.104_302_972_966_099_57);
}

#[test]
fn umitooko_logs() {
    let Some(folder) = fixtures::shared_data("umitooko_serial16") else { return };
    // a reference and 242 frames that start with `s`, all complete
    let recording = recognised(&folder.join("__3.txt"));
    assert_eq!(recording.skipped.frames, 0);
    assert_eq!(recording.reference_frame, Some(0));
    assert_eq!(recording.notes, [Note::Reference { line: 1, frame: 0 }]);
    let frames = real_frames(&recording, &rotated(16));
    let saturated: Vec<_> = frames
        .frames()
        .filter(|frame| frame.quality.contains(&Quality::SATURATED))
        .map(|frame| frame.sequence)
        .collect();
    // in two frames one electrode is off: its 25 values are at the full scale of 6.55
    assert_eq!(saturated, [74, 75]);
    let good: Vec<_> =
        frames.frames().filter(|frame| frame.quality.iter().all(|q| q.is_good())).collect();
    let error = |frame: &eit_hw::Frame| reciprocity_error(&rotated(16), &frame.values).unwrap();
    let mean = good.iter().map(error).sum::<f64>() / good.len() as f64;
    // stated: 1.5 to 4 %
    assert!((0.015..0.04).contains(&mean), "{mean}");

    // with an electrode off no order fits, and none is suggested
    let off = frames.frames().nth(74).unwrap();
    let verdict = recognise_order(&off.values, &rotated(16), &[("other", ascending(16))]);
    assert!(matches!(verdict, OrderVerdict::Unclear { ours: Some(_), .. }), "{verdict:?}");
}

#[test]
fn umitooko_log_that_starts_within_a_frame_and_reference_of_one_line() {
    let Some(folder) = fixtures::shared_data("umitooko_serial16") else { return };
    let recording = recognised(&folder.join("efl_4_good.txt"));
    assert_eq!(recording.real.dim(), (284, 208));
    assert_eq!(recording.skipped.frames, 1);
    let reason = SkipReason::NoStart;
    assert_eq!(recording.skipped.first, [SkippedFrame { at: At::Line(1), reason }]);
    let found = errors(&real_frames(&recording, &rotated(16)), &rotated(16));
    // stated: 1.5 to 4 %; single frames up to 5.1 %
    within(&found, 0.015, 0.052);
    assert!(found.iter().sum::<f64>() / 284.0 < 0.04);

    let path = folder.join("ref_data.txt");
    let log = read_recording(&path, Some(Format::SerialLog), &ReadOptions::default()).unwrap();
    let csv = recognised(&path);
    assert_eq!(log.real.dim(), (1, 208));
    assert_eq!(csv.format, Format::Csv);
    assert_eq!(log.real, csv.real);
    within(&errors(&real_frames(&log, &rotated(16)), &rotated(16)), 0.015, 0.04);
}

#[test]
fn khu_volts_gain_and_overflow() {
    let Some(folder) = fixtures::shared_data("khu_mark25") else { return };
    for name in ["B1", "P1"] {
        let recording = recognised(&folder.join(name));
        assert_eq!(recording.format, Format::Khu);
        // 20 scans of 31 projections of 32 channels
        assert_eq!(recording.real.dim(), (20, 31 * 32));
        assert_eq!(recording.unit, Unit::Volt);
        assert!(recording.notes.is_empty());
        let Layout::Quadruples(quadruples) = &recording.layout else { panic!() };
        for (frame, flags) in recording.quality.as_ref().unwrap().rows().into_iter().enumerate() {
            for (projection, flags) in flags.as_slice().unwrap().chunks(32).enumerate() {
                let overflowed: Vec<_> =
                    (0..32).filter(|&c| flags[c].contains(Quality::SATURATED)).collect();
                assert_eq!(overflowed.len(), 2, "frame {frame}, projection {projection}");
                for channel in overflowed {
                    let quadruple @ [a, b, m, n] = quadruples[projection * 32 + channel];
                    let on_driven = [m, n].contains(&a) || [m, n].contains(&b);
                    // for the drive of neighbours (0, 31) another pair overflows
                    assert!(on_driven || quadruple == [0, 31, 1, 2], "{quadruple:?}");
                }
            }
        }
        // in a passive body the potential is highest where current enters
        let frames = real_frames(&recording, quadruples);
        for (&[a, b, m, n], &value) in quadruples.iter().zip(&frames.mean_frame()) {
            if m == a || n == b {
                assert!(value > 0.0 || value.is_nan(), "{:?} {value}", [a, b, m, n]);
            }
            if n == a || m == b {
                assert!(value < 0.0 || value.is_nan(), "{:?} {value}", [a, b, m, n]);
            }
        }
    }
}

#[test]
fn khu_noise() {
    let Some(folder) = fixtures::shared_data("khu_mark25") else { return };
    let recording = recognised(&folder.join("B1"));
    let Layout::Quadruples(all) = &recording.layout else { panic!() };
    let four_point: Vec<Quadruple> = all
        .iter()
        .copied()
        .filter(|[a, b, m, n]| ![m, n].contains(&a) && ![m, n].contains(&b))
        .collect();
    let frames =
        recording.frames_for(Some(&four_point), four_point.len(), Component::Magnitude).unwrap();
    let columns = frames.values.columns().into_iter().zip(frames.quality.columns());
    let mut deviations: Vec<_> = columns
        .filter(|(_, quality)| quality.iter().all(|quality| quality.is_good()))
        .map(|(values, _)| values.std(1.0))
        .collect();
    let mut means = frames.mean_frame();
    means.retain(|mean| !mean.is_nan());
    // 31 projections of 28 records, less one (of 29 and overflowed) where the drive is a pair
    assert_eq!((deviations.len(), means.len()), (31 * 28, 31 * 28));
    deviations.sort_by(f64::total_cmp);
    means.sort_by(f64::total_cmp);
    let percentile = |sorted: &[f64], percent: usize| sorted[(sorted.len() - 1) * percent / 100];
    // stated, to the last digit given: 0.41, 0.61 and 1.37 uV (with 19 degrees of freedom); |V|
    // from 5 uV to 18 mV, median 1.46 mV
    let close = |found: f64, stated: f64, digit: f64| {
        assert!((found - stated).abs() <= digit, "{found} {stated}");
    };
    close(percentile(&deviations, 5), 0.41e-6, 0.01e-6);
    close(percentile(&deviations, 50), 0.61e-6, 0.01e-6);
    close(percentile(&deviations, 95), 1.37e-6, 0.01e-6);
    close(means[0], 5e-6, 0.5e-6);
    close(percentile(&means, 50), 1.46e-3, 0.01e-3);
    close(means[means.len() - 1], 18e-3, 0.5e-3);
}

#[test]
fn iirc_rod_with_driven_electrodes() {
    let Some(folder) = fixtures::shared_data("iirc_rod_2006") else { return };
    let recording = recognised(&folder.join("iirc_re_101x256.npy"));
    let errors = errors(&real_frames(&recording, &ascending_kept(16)), &ascending_kept(16));
    // the reference
    assert!((errors[0] - 0.056).abs() < 0.0005, "{}", errors[0]);
    // for a scene that drops driven electrodes, the error says so
    let refused = recording.frames_for(None, 208, Component::Real).unwrap_err();
    assert!(refused.to_string().contains("driven_electrodes = \"keep\""), "{refused}");
}

#[test]
fn uef_matrix_is_one_frame() {
    let Some(folder) = fixtures::shared_data("uef2017_kit4") else { return };
    let path = folder.join("Uel_1_0.npy");
    let by_matrix = table(FrameOrientation::Matrix, false);
    let matrix = recognised(&path);
    let frame = read_recording(&path, None, &by_matrix).unwrap();
    assert_eq!(matrix.real.dim(), (16, 79));
    assert_eq!(frame.real.dim(), (1, 16 * 79));
    for ((measurement, pattern), value) in matrix.real.indexed_iter() {
        assert_eq!(frame.real[[0, pattern * 16 + measurement]], *value);
    }
    // general patterns have no quadruples
    assert_eq!(frame.frames_for(None, 1264, Component::Real).unwrap().values.dim(), (1, 1264));
    let refused = matrix.frames_for(None, 1264, Component::Real).unwrap_err();
    assert!(refused.to_string().contains("frames_are = \"matrix\""), "{refused}");
    // stated for the 16 adjacent patterns: 5.3 %
    let adjacent = &frame.real.into_raw_vec_and_offset().0[..256];
    let error = reciprocity_error(&ascending_kept(16), adjacent).unwrap();
    assert!((error - 0.053).abs() < 0.0005, "{error}");
}

#[test]
fn ktc_is_one_frame() {
    let Some(folder) = fixtures::shared_data("ktc2023_training") else { return };
    for name in ["Uel_ref", "Uel_1", "Uel_2", "Uel_3", "Uel_4"] {
        let recording = recognised(&folder.join(format!("{name}.npy")));
        assert_eq!(recording.real.dim(), (1, 2356));
        assert!(recording.frames_for(None, 2356, Component::Real).is_ok());
    }
}

#[test]
fn hydrogel_has_no_reciprocal_pairs() {
    let Some(folder) = fixtures::shared_data("hydrogel_superpose500") else { return };
    let recording = recognised(&folder.join("superpose500_responseups.npy"));
    assert_eq!(recording.real.dim(), (500, 192));
    // stated: raw magnitudes 260 to 90000
    assert!(recording.real.iter().all(|&value| (250.0..95_000.0).contains(&value)));
    let codes = recognised(&folder.join("quadruples_192.csv")).real;
    let quadruples: Vec<Quadruple> = codes
        .rows()
        .into_iter()
        .map(|row| [row[0], row[1], row[2], row[3]].map(|code| (code / 2.0) as u32))
        .collect();
    assert_eq!(quadruples.len(), opposite(16).len());
    let frames = real_frames(&recording, &quadruples);
    let verdict = recognise_order(&frames.mean_frame(), &quadruples, &[]);
    assert_eq!(verdict, OrderVerdict::Unclear { ours: None, best: None });
    let refused = recording.frames_for(None, 208, Component::Real).unwrap_err();
    assert!(refused.to_string().contains("opposite drive"), "{refused}");
}

#[test]
fn black_sensor_logs_read_as_frames() {
    let Some(folder) = fixtures::shared_data("black_sensor_skin") else { return };
    for name in ["testv2_10.csv", "testv2_7.csv"] {
        let path = folder.join(name);
        let recording = read_recording(&path, None, &ReadOptions::default()).unwrap();
        assert_eq!(recording.format, Format::BlackSensor);
        // counted independently: a mark directly followed by 16 rows of a time and 16 counts
        let bytes = std::fs::read(&path).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        let lines: Vec<&str> = text.lines().map(|line| line.trim_end_matches(',')).collect();
        let row = |line: &&str| {
            let fields: Vec<&str> = line.split(',').skip(3).collect();
            let counts: Vec<f64> = fields.iter().filter_map(|field| field.parse().ok()).collect();
            (fields.len() == 16 && counts.len() == 16).then_some(counts)
        };
        let is_mark = |line: &str| line.split(',').skip(2).eq(["A"]);
        let marks = lines.iter().filter(|line| is_mark(line)).count();
        let whole: Vec<Vec<f64>> = lines
            .split(|line| is_mark(line))
            .skip(1)
            .filter_map(|block| {
                // a banner before the first row is between frames
                let rows = block.iter().skip_while(|line| row(line).is_none()).take(16);
                let rows: Vec<Vec<f64>> = rows.map(row).collect::<Option<_>>()?;
                (rows.len() == 16).then(|| rows.concat())
            })
            .collect();
        let found: Vec<Vec<f64>> = recording.real.rows().into_iter().map(|r| r.to_vec()).collect();
        println!("{name}: {} frames of {marks} marks", found.len());
        assert!(whole.len() > 20 && found == whole, "{name}: {} and {}", found.len(), whole.len());
        // the end of the log may truncate the last frame, which is no fault of its lines
        let skipped = recording.skipped.frames;
        assert!([skipped, skipped + 1].contains(&(marks - whole.len())), "{name}: {skipped}");
        // the largest is far from the rail of 16 bits, and above that of 15
        let largest = whole.iter().flatten().fold(0.0_f64, |most, &count| most.max(count));
        assert!((32_767.0..65_535.0).contains(&largest), "{name}: {largest}");
        assert_eq!(recording.quality, None, "{name}");
    }
}

#[test]
fn every_file_at_hand_is_read_or_refused_in_one_line() {
    let Some(root) = fixtures::shared_data("README.md") else { return };
    let mut seen = 0;
    for folder in std::fs::read_dir(root.parent().unwrap()).unwrap().flatten() {
        if !folder.path().is_dir() {
            continue;
        }
        for file in std::fs::read_dir(folder.path()).unwrap().flatten() {
            for format in [None].into_iter().chain(Format::ALL.map(Some)) {
                seen += 1;
                if let Err(error) = read_recording(&file.path(), format, &ReadOptions::default()) {
                    let message = error.to_string();
                    assert!(!message.contains('\n') && message.len() < 600, "{message}");
                }
            }
        }
    }
    assert!(seen > 1000, "{seen}");
}
