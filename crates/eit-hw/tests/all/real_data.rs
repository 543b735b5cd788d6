//! Every reader on real recordings; each figure is stated in the folder's README.md.

use std::path::Path;

use crate::common::{
    apart, ascending, ascending_kept, opposite, point_electrode_disc, refused, rotated,
    rotated_kept, table,
};
use eit_hw::{
    At, Component, Format, Frame, FrameOrientation, Layout, MeasuredFrames, Note, OrderVerdict,
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

/// Reciprocity error of each frame.
fn errors(frames: &MeasuredFrames, quadruples: &[Quadruple]) -> Vec<f64> {
    let error = |frame: Frame| reciprocity_error(quadruples, &frame.values).unwrap();
    frames.frames().map(error).collect()
}

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
    let verdict = recognise_order(frame, wrong, &alternatives);
    let OrderVerdict::Other { better, ours } = verdict else { panic!("{verdict:?}") };
    assert!(better.len() == 1 && better[0].setting == "right", "{better:?}");
    // wrong orders of all these recordings have errors of at least 0.75
    assert!(ours > 0.75, "{ours}");
}

/// The shape is that of a homogeneous disc with point electrodes, with the sign of the instrument.
#[test]
fn orders_errors_and_signs_are_those_stated() {
    let turned = [rotated(16), ascending(16)];
    let ascends = [ascending(16), rotated(16)];
    let kept = [ascending_kept(16), rotated_kept(16)];
    let (goe, sciospec, lct) = (Format::Goe, Format::Sciospec, Format::Lct);
    let lct_errors = [0.0975, 0.146];
    // right and wrong order, lowest and highest error of a frame, and the sign unless the tank may hide its shape
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
        let columns = table(FrameOrientation::Columns, true);
        let options = if format == Format::Csv { columns } else { ReadOptions::default() };
        let recording = read_recording(&path, None, &options).unwrap();
        assert_eq!((recording.format, recording.real.dim()), (format, dim), "{file}");
        let unit = match format {
            Format::Sciospec => Unit::Volt,
            Format::Lct => Unit::Ohm,
            _ => Unit::Arbitrary,
        };
        assert_eq!(recording.unit, unit, "{file}");
        if format == Format::Lct {
            assert_eq!(recording.frequency_hz, Some(10e3));
            // 13 header lines, 208 rows, and one more
            assert_eq!(recording.notes, [Note::RepeatedLastRow { line: 222 }]);
        }
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
fn sciospec_255_frames_at_20_a_second_with_any_pairs_of_its_drives() {
    let Some(folder) = fixtures::shared_data("sciospec_tank_adjacent") else { return };
    let recording = recognised(&folder);
    assert_eq!((recording.frequency_hz, recording.current_a), (Some(10e3), Some(5e-3)));
    let Layout::Potentials { drives, electrodes: 16, driven: true } = &recording.layout else {
        panic!()
    };
    assert_eq!(drives[15], [15, 0]);

    let times = real_frames(&recording, &rotated(16)).device_time_s.unwrap();
    // current enters at the first channel of a drive, which has the highest potential
    let row = recording.real.row(0).to_vec();
    for (&[a, b], potentials) in drives.iter().zip(row.chunks(16)) {
        let between = potentials[b as usize]..=potentials[a as usize];
        assert!(potentials.iter().all(|potential| between.contains(potential)));
    }
    assert_eq!(times[0], 0.0);
    // 254 periods of 50 ms; the time stamps in the files jitter by less than one
    assert!((times[254] - 12.7).abs() < 0.05, "{}", times[254]);

    // any pairs of its drives, with their sign
    let recording = recognised(&folder.join("setup_00001.eit"));
    assert_eq!(recording.frame_count(), 1);
    let frames = real_frames(&recording, &[[0, 1, 0, 1], [1, 0, 0, 1], [0, 1, 1, 0], [0, 1, 0, 0]]);
    // first line of the file: 1.2616... and -1.2601...
    let first = 1.261_636_853_218_078_6 + 1.260_147_690_773_010_3;
    assert_eq!(frames.values.row(0).to_vec(), [first, -first, -first, 0.0]);
    let of = |quadruple| recording.frames_for(Some(&[quadruple]), 1, Component::Real);
    refused(of([0, 8, 2, 3]), &["has no drive (0, 8)", "such as (0, 1)"]);
    refused(of([0, 1, 2, 16]), &["uses electrode 16; set `[electrodes] count` to 16"]);
}

#[test]
fn pyeidors_columns_alternate() {
    let options = table(FrameOrientation::Columns, true);
    for file in [METAL, METAL_AND_PLASTIC] {
        let Some(path) = fixtures::shared_data(file) else { return };
        let recording = read_recording(&path, None, &options).unwrap();
        let phased = recording.frames_for(Some(&rotated(16)), 208, Component::Phased).unwrap();
        within(&errors(&phased, &rotated(16)), 0.012, 0.03);
        order_is_recognised(&phased.mean_frame(), &rotated(16), &ascending(16));
        // read as rows, the file is rejected with the right key
        let rows = recognised(&path);
        refused(rows.frames_for(None, 208, Component::Real), &["frames_are = \"columns\""]);
    }
    let first = read_recording(&fixtures::shared_data(METAL).unwrap(), None, &options).unwrap();
    // first row of the file
    assert_eq!(first.real[[0, 0]], 0.105_571_510_388_850_71);
    assert_eq!(first.imaginary.unwrap()[[0, 0]], -0.050_626_061_392_131_43);
    assert_eq!(first.real[[1, 0]], 0.104_302_972_966_099_57);
}

#[test]
fn umitooko_logs() {
    let Some(folder) = fixtures::shared_data("umitooko_serial16") else { return };
    let right = rotated(16);
    // a reference and 242 frames that start with `s`, all complete
    let recording = recognised(&folder.join("__3.txt"));
    assert_eq!((recording.skipped.frames, recording.reference_frame), (0, Some(0)));
    assert_eq!(recording.notes, [Note::Reference { line: 1, frame: 0 }]);
    let frames = real_frames(&recording, &right);
    let is_saturated = |frame: &Frame| frame.quality.contains(&Quality::SATURATED);
    let saturated: Vec<_> = frames.frames().filter(is_saturated).map(|f| f.sequence).collect();
    // in two frames one electrode is off: its 25 values are at the full scale of 6.55
    assert_eq!(saturated, [74, 75]);
    let good = frames.frames().filter(|frame| frame.quality.iter().all(|q| q.is_good()));
    let good: Vec<f64> = good.map(|f| reciprocity_error(&right, &f.values).unwrap()).collect();
    let mean = good.iter().sum::<f64>() / good.len() as f64;
    // stated: 1.5 to 4 %
    assert!((0.015..0.04).contains(&mean), "{mean}");
    // with an electrode off no order fits, and none is suggested
    let off = frames.frames().nth(74).unwrap();
    let verdict = recognise_order(&off.values, &right, &[("other", ascending(16))]);
    assert!(matches!(verdict, OrderVerdict::Unclear { ours: Some(_), .. }), "{verdict:?}");

    // one that starts within a frame
    let recording = recognised(&folder.join("efl_4_good.txt"));
    assert_eq!((recording.real.dim(), recording.skipped.frames), ((284, 208), 1));
    let reason = SkipReason::NoStart;
    assert_eq!(recording.skipped.first, [SkippedFrame { at: At::Line(1), reason }]);
    let found = errors(&real_frames(&recording, &right), &right);
    // stated: 1.5 to 4 %; single frames up to 5.1 %
    within(&found, 0.015, 0.052);
    assert!(found.iter().sum::<f64>() / 284.0 < 0.04);

    // a reference of one line
    let path = folder.join("ref_data.txt");
    let log = read_recording(&path, Some(Format::SerialLog), &ReadOptions::default()).unwrap();
    let csv = recognised(&path);
    assert_eq!((log.real.dim(), csv.format), ((1, 208), Format::Csv));
    assert_eq!(log.real, csv.real);
    within(&errors(&real_frames(&log, &right), &right), 0.015, 0.04);
}

#[test]
fn khu_volts_gain_and_overflow() {
    let Some(folder) = fixtures::shared_data("khu_mark25") else { return };
    for name in ["B1", "P1"] {
        let recording = recognised(&folder.join(name));
        assert_eq!(recording.format, Format::Khu);
        // 20 scans of 31 projections of 32 channels
        assert_eq!((recording.real.dim(), recording.unit), ((20, 31 * 32), Unit::Volt));
        assert!(recording.notes.is_empty());
        let Layout::Quadruples(quadruples) = &recording.layout else { panic!() };
        for flags in recording.quality.as_ref().unwrap().rows() {
            let values: Vec<_> = flags.iter().zip(quadruples).collect();
            for projection in values.chunks(32) {
                let is_over = |(flags, _): &&(&Quality, _)| flags.contains(Quality::SATURATED);
                let over: Vec<_> = projection.iter().filter(is_over).map(|(_, q)| **q).collect();
                assert_eq!(over.len(), 2, "{over:?}");
                // for the drive of neighbours (0, 31) another pair overflows
                let on_driven = |q: &Quadruple| apart(vec![*q]).is_empty();
                assert!(over.iter().all(|q| on_driven(q) || *q == [0, 31, 1, 2]), "{over:?}");
            }
        }
        // in a passive body the potential is highest where current enters
        let frames = real_frames(&recording, quadruples);
        for (&[a, b, m, n], &value) in quadruples.iter().zip(&frames.mean_frame()) {
            let sign = i8::from(m == a || n == b) - i8::from(n == a || m == b);
            let is_right = sign == 0 || f64::from(sign) * value > 0.0 || value.is_nan();
            assert!(is_right, "{:?} {value}", [a, b, m, n]);
        }
    }
}

#[test]
fn khu_noise() {
    let Some(folder) = fixtures::shared_data("khu_mark25") else { return };
    let recording = recognised(&folder.join("B1"));
    let Layout::Quadruples(all) = &recording.layout else { panic!() };
    let four_point = apart(all.clone());
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
    // stated, to the last digit given: deviations with 19 degrees of freedom, then |V|
    for (sorted, percent, stated, digit) in [
        (&deviations, 5, 0.41e-6, 0.01e-6),
        (&deviations, 50, 0.61e-6, 0.01e-6),
        (&deviations, 95, 1.37e-6, 0.01e-6),
        (&means, 0, 5e-6, 0.5e-6),
        (&means, 50, 1.46e-3, 0.01e-3),
        (&means, 100, 18e-3, 0.5e-3),
    ] {
        let found = sorted[(sorted.len() - 1) * percent / 100];
        assert!((found - stated).abs() <= digit, "{found} {stated}");
    }
}

#[test]
fn iirc_rod_with_driven_electrodes() {
    let Some(folder) = fixtures::shared_data("iirc_rod_2006") else { return };
    let recording = recognised(&folder.join("iirc_re_101x256.npy"));
    let errors = errors(&real_frames(&recording, &ascending_kept(16)), &ascending_kept(16));
    // the reference
    assert!((errors[0] - 0.056).abs() < 0.0005, "{}", errors[0]);
    // for a scene that drops driven electrodes, the error says so
    refused(recording.frames_for(None, 208, Component::Real), &["driven_electrodes = \"keep\""]);
}

#[test]
fn uef_matrix_is_one_frame() {
    let Some(folder) = fixtures::shared_data("uef2017_kit4") else { return };
    let path = folder.join("Uel_1_0.npy");
    let matrix = recognised(&path);
    let frame = read_recording(&path, None, &table(FrameOrientation::Matrix, false)).unwrap();
    assert_eq!((matrix.real.dim(), frame.real.dim()), ((16, 79), (1, 16 * 79)));
    for ((measurement, pattern), value) in matrix.real.indexed_iter() {
        assert_eq!(frame.real[[0, pattern * 16 + measurement]], *value);
    }
    // general patterns have no quadruples
    assert_eq!(frame.frames_for(None, 1264, Component::Real).unwrap().values.dim(), (1, 1264));
    refused(matrix.frames_for(None, 1264, Component::Real), &["frames_are = \"matrix\""]);
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
    refused(recording.frames_for(None, 208, Component::Real), &["opposite drive"]);
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
            let counts: Vec<_> = line.split(',').skip(3).map(|field| field.parse().ok()).collect();
            counts.into_iter().collect::<Option<Vec<f64>>>().filter(|counts| counts.len() == 16)
        };
        let blocks = lines.split(|line| line.split(',').skip(2).eq(["A"])).skip(1);
        let marks = blocks.clone().count();
        let whole: Vec<f64> = blocks
            .filter_map(|block| {
                // a banner before the first row is between frames
                let rows = block.iter().skip_while(|line| row(line).is_none()).take(16);
                let rows: Vec<Vec<f64>> = rows.map(row).collect::<Option<_>>()?;
                (rows.len() == 16).then(|| rows.concat())
            })
            .flatten()
            .collect();
        let frames = whole.len() / 256;
        assert!(frames > 20 && recording.real.iter().eq(&whole), "{name}: {frames}");
        // the end of the log may truncate the last frame, which is no fault of its lines
        let skipped = recording.skipped.frames;
        assert!([skipped, skipped + 1].contains(&(marks - frames)), "{name}: {skipped}");
        // the largest is far from the rail of 16 bits, and above that of 15
        let largest = whole.iter().fold(0.0_f64, |most, &count| most.max(count));
        assert!((32_767.0..65_535.0).contains(&largest), "{name}: {largest}");
        assert_eq!(recording.quality, None, "{name}");
    }
}

#[test]
fn every_file_at_hand_is_read_or_refused_in_one_line() {
    let Some(root) = fixtures::shared_data("README.md") else { return };
    let mut seen = 0;
    let folders = std::fs::read_dir(root.parent().unwrap()).unwrap().flatten();
    let files = folders.filter_map(|folder| std::fs::read_dir(folder.path()).ok()).flatten();
    for path in files.map(|file| file.unwrap().path()) {
        for format in [None].into_iter().chain(Format::ALL.map(Some)) {
            seen += 1;
            if let Err(error) = read_recording(&path, format, &ReadOptions::default()) {
                let message = error.to_string();
                assert!(!message.contains('\n') && message.len() < 600, "{message}");
            }
        }
    }
    assert!(seen > 1000, "{seen}");
}
