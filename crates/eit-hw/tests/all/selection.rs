//! Selection of a protocol's measurements from a recording, and reciprocity.

use crate::common::arrays::npy_of;
use crate::common::{ascending, csv, opposite, parse, refused, rotated, table};
use eit_hw::{
    Component, CountHint, Format, Frame, FrameMap, FrameOrientation, HwError, Layout, Note,
    OrderVerdict, Quadruple, Quality, ReadOptions, Recording, Unit, model_correlation,
    reciprocity_error, recognise_order,
};
use ndarray::{Array2, array};
use proptest::prelude::*;

fn flag(recording: &mut Recording, at: [usize; 2], flags: Quality) {
    recording.quality.get_or_insert_with(|| Array2::default(recording.real.dim()))[at] = flags;
}

/// Returns two complex frames of three values.
fn complex() -> Recording {
    let options = table(FrameOrientation::Rows, true);
    parse(Format::Csv, "3,0,-6\n4,1,-8\n6,0,3\n8,2,4\n", &options).unwrap()
}

#[test]
fn components() {
    let recording = complex();
    let of = |component| recording.frames_for(None, 3, component).unwrap().values;
    assert_eq!(of(Component::Real), array![[3.0, 0.0, -6.0], [6.0, 0.0, 3.0]]);
    assert_eq!(of(Component::Imaginary), array![[4.0, 1.0, -8.0], [8.0, 2.0, 4.0]]);
    assert_eq!(of(Component::Magnitude), array![[5.0, 1.0, 10.0], [10.0, 2.0, 5.0]]);
    let real = csv("1,-2\n").unwrap();
    let of = |component| real.frames_for(None, 2, component);
    assert!(matches!(of(Component::Imaginary), Err(HwError::NoImaginaryPart { .. })));
    assert_eq!(of(Component::Phased).unwrap().values, array![[1.0, -2.0]]);
    assert_eq!(of(Component::Magnitude).unwrap().values, array![[1.0, 2.0]]);
}

/// Lines of one value or one drive are joined to frames, a matrix is turned; what may be frames in columns stays.
#[test]
fn tables_are_compared_with_the_shape_of_the_protocol() {
    let (quadruples, count) = (ascending(6), 18);
    let value = |k: usize| (k + 5).to_string();
    let lines = |columns: usize, rows: usize| -> String {
        let line = |row: usize| (0..columns).map(|c| value(row * columns + c)).collect::<Vec<_>>();
        (0..rows).map(|row| line(row).join(",") + "\n").collect()
    };
    let frame = |k: usize| -> Vec<f64> { (0..count).map(|i| (k * count + i + 5) as f64).collect() };
    let arranged = |options: &ReadOptions, columns, rows| {
        let read = parse(Format::Csv, lines(columns, rows), options).unwrap();
        read.arranged_for(&Layout::ProtocolOrder, Some(&quadruples), count)
    };
    let plain = ReadOptions::default();
    for (columns, rows, joined) in [(3, 12, 6), (1, 36, 18)] {
        let read = arranged(&plain, columns, rows);
        let frames = read.frames_for(Some(&quadruples), count, Component::Real).unwrap();
        assert_eq!(frames.values.row(1).to_vec(), frame(1));
        assert!(read.notes.contains(&Note::Joined { lines: joined }), "{:?}", read.notes);
    }
    for (columns, rows) in [(2, 18), (9, 2), (3, 18), (6, 3)] {
        assert_eq!(arranged(&plain, columns, rows).real.dim(), (rows, columns));
    }
    let none = csv("1\n2\n").unwrap().arranged_for(&Layout::ProtocolOrder, None, 0);
    assert_eq!(none.real.dim(), (2, 1));
    let matrix = |columns, rows| arranged(&table(FrameOrientation::Matrix, false), columns, rows);
    let turned = matrix(3, 6);
    assert_eq!(turned.real.row(0).to_vec(), frame(0));
    assert_eq!(turned.notes, [Note::Turned { drives: 6 }]);
    let right = matrix(6, 3);
    assert!(right.notes.is_empty() && right.real.row(0).to_vec()[..3] == [5.0, 11.0, 17.0]);
}

#[test]
fn phased_turns_one_phase_to_the_real_axis() {
    let mut recording = complex();
    // all on the axis of 3 + 4i, with either sign: the projection is the signed magnitude
    recording.imaginary = Some(&recording.real * (4.0 / 3.0));
    let phased = recording.frames_for(None, 3, Component::Phased).unwrap().values;
    for (phased, real) in phased.iter().zip(&recording.real) {
        // a few roundings of numbers of order 10
        assert!((phased - real * 5.0 / 3.0).abs() < 1e-14, "{phased} {real}");
    }
    // flagged values do not rotate it
    recording.real[[0, 1]] = f64::NAN;
    flag(&mut recording, [0, 1], Quality::NON_FINITE);
    let flagged = recording.frames_for(None, 3, Component::Phased).unwrap();
    assert_eq!(flagged.values.row(1), phased.row(1));
    assert_eq!((flagged.quality[[0, 1]], flagged.mean_frame()[1]), (Quality::NON_FINITE, 0.0));
}

#[test]
fn quadruples_are_found_with_their_sign() {
    let mut recording = complex();
    recording.layout = Layout::Quadruples(vec![[0, 1, 2, 3], [0, 1, 3, 4], [1, 2, 3, 4]]);
    flag(&mut recording, [1, 2], Quality::OPEN);
    let wanted = [[1, 2, 3, 4], [1, 0, 2, 3], [0, 1, 3, 2], [1, 0, 3, 2]];
    let frames = recording.frames_for(Some(&wanted), 4, Component::Real).unwrap();
    assert_eq!(frames.values.row(0).to_vec(), [-6.0, -3.0, -3.0, 3.0]);
    assert_eq!(frames.quality[[1, 0]], Quality::OPEN);
    for (quadruples, count, words) in [
        (Some(&[[2, 3, 0, 1]][..]), 1, "has no drive (2, 3)"),
        (Some(&[[0, 1, 2, 4]]), 1, "has no measurement [0, 1, 2, 4]"),
        (None, 3, "names the electrodes of each value"),
        (Some(&wanted), 3, "4 quadruples given for 3 measurements"),
    ] {
        refused(recording.frames_for(quadruples, count, Component::Real), &[words]);
    }
}

#[test]
fn potentials_are_subtracted() {
    let mut recording = complex();
    recording.layout = Layout::Potentials { drives: vec![[0, 1]], electrodes: 3, driven: true };
    flag(&mut recording, [0, 2], Quality::OPEN);
    let wanted = [[0, 1, 0, 2], [1, 0, 0, 2], [0, 1, 2, 0], [0, 1, 0, 1]];
    let frames = recording.frames_for(Some(&wanted), 4, Component::Real).unwrap();
    assert_eq!(frames.values.row(0).to_vec(), [9.0, -9.0, -9.0, 3.0]);
    let open = [true, true, true, false].map(|is| if is { Quality::OPEN } else { Quality::GOOD });
    assert_eq!(frames.quality.row(0).to_vec(), open);
    // the magnitude is that of the difference
    let frames = recording.frames_for(Some(&wanted), 4, Component::Magnitude).unwrap();
    assert_eq!(frames.values[[0, 0]], 15.0);
}

#[test]
fn fields_that_do_not_fit_are_refused() {
    let changes: [fn(&mut Recording); 7] = [
        |recording| recording.quality = Some(Array2::default((2, 2))),
        |recording| recording.quality = Some(Array2::default((1, 3))),
        |recording| recording.imaginary = Some(Array2::zeros((1, 3))),
        |recording| recording.imaginary = Some(Array2::zeros((2, 2))),
        |recording| recording.device_time_s = Some(vec![0.0]),
        |recording| recording.layout = Layout::Quadruples(Vec::new()),
        |recording| {
            let drives = vec![[0, 1]];
            recording.layout = Layout::Potentials { drives, electrodes: usize::MAX, driven: true };
        },
    ];
    for change in changes {
        let mut recording = complex();
        change(&mut recording);
        let result = recording.frames_for(None, 3, Component::Real);
        assert!(matches!(result, Err(HwError::Inconsistent { .. })), "{result:?}");
    }
}

#[test]
fn counts_that_differ_are_explained() {
    let hint = |recording: &Recording, wanted: usize| {
        let refused = recording.frames_for(None, wanted, Component::Real).unwrap_err();
        let HwError::CountMismatch { found, frames, wanted: w, hint, .. } = refused else {
            panic!()
        };
        assert_eq!((frames, found, w), (recording.frame_count(), recording.value_count(), wanted));
        hint
    };
    for (found, frames, wanted, expected) in [
        (4, 208, 208, CountHint::Transposed),
        (13, 16, 208, CountHint::OneFrame),
        (416, 1, 208, CountHint::Complex),
        (256, 1, 208, CountHint::DrivenKept { electrodes: 16 }),
        (256, 1, 192, CountHint::DrivenKept { electrodes: 16 }),
        (208, 1, 256, CountHint::DrivenDropped { electrodes: 16 }),
        (104, 1, 208, CountHint::ReciprocalOnly),
        (928, 1, 208, CountHint::Adjacent { electrodes: 32 }),
        (192, 1, 208, CountHint::Opposite { electrodes: 16 }),
        // a column of times or frame numbers
        (209, 1, 208, CountHint::OneMore),
        (207, 1, 208, CountHint::Unknown),
    ] {
        let text = vec![vec!["1"; found].join(","); frames].join("\n");
        assert_eq!(hint(&csv(&text).unwrap(), wanted), expected, "{found} of {wanted}");
    }
    assert!(CountHint::OneMore.to_string().contains("remove that column"));
    // a format that is no table has no hint about tables
    let mut other = complex();
    other.frames_are = None;
    assert_eq!([2, 6].map(|n| hint(&other, n)), [CountHint::Unknown, CountHint::ReciprocalOnly]);
}

/// A table of 2 frames of 4 values in either file format: following the message fixes it.
#[test]
fn a_swapped_table_is_mended_by_the_key_of_the_message() {
    use FrameOrientation::{Columns, Matrix, Rows};
    let bytes = [1_u8, 5, 2, 6, 3, 7, 4, 8];
    let npy = npy_of("|u1", "(4, 2)", &bytes);
    for (format, bytes) in [(Format::Csv, &b"1,5\n2,6\n3,7\n4,8\n"[..]), (Format::Npy, &npy)] {
        let frames = |frames_are, count| {
            let options = ReadOptions { frames_are, ..ReadOptions::default() };
            parse(format, bytes, &options).unwrap().frames_for(None, count, Component::Real)
        };
        for (frames_are, count, key, mended) in [
            (None, 4, "columns", Columns),
            (Some(Rows), 4, "columns", Columns),
            (Some(Columns), 2, "rows", Rows),
            (None, 8, "matrix", Matrix),
            (Some(Columns), 8, "matrix", Matrix),
        ] {
            let message = frames(frames_are, count).unwrap_err().to_string();
            let key = format!("set `[recording] frames_are = \"{key}\"`");
            assert!(message.contains(&key) && frames(Some(mended), count).is_ok(), "{message}");
        }
    }
}

#[test]
fn means_are_of_good_values_of_some_frames() {
    let mut recording = csv("1,2\n3,4\n5,6\n7,8\n").unwrap();
    recording.device_time_s = Some(vec![0.0, 0.05, 0.1, 0.15]);
    for frame in [1, 2] {
        flag(&mut recording, [frame, 1], Quality::STUCK);
        recording.real[[frame, 1]] = f64::NAN;
    }
    let frames = recording.frames_for(None, 2, Component::Real).unwrap();
    assert_eq!(frames.mean_of(0..2), (vec![2.0, 2.0], vec![true, true]));
    assert_eq!(frames.mean_of(0..4), (vec![4.0, 5.0], vec![true, true]));
    assert_eq!(frames.mean_of(3..usize::MAX), (vec![7.0, 8.0], vec![true, true]));
    let (mean, good) = frames.mean_of(1..3);
    assert_eq!((mean[0], good), (4.0, vec![true, false]));
    assert!(mean[1].is_nan());
    assert_eq!([2..2, 9..12].map(|none| frames.mean_of(none).1), [[false; 2]; 2]);
    assert_eq!(frames.mean_frame(), frames.mean_of(0..4).0);
    let last = frames.frames().nth(3).unwrap();
    assert_eq!((&last.values[..], last.sequence), (&[7.0, 8.0][..], 3));
    assert_eq!((last.device_time_s, frames.frames().count()), (Some(0.15), 4));
}

#[test]
fn values_become_volts() {
    for (unit, current_a, factor) in [
        (Unit::Ohm, None, 0.5),
        (Unit::Volt, Some(0.25), 2.0),
        (Unit::Volt, None, 1.0),
        (Unit::Volt, Some(0.0), 1.0),
        (Unit::Arbitrary, Some(0.25), 1.0),
    ] {
        let mut recording = csv("1,-2\n").unwrap();
        (recording.unit, recording.current_a) = (unit, current_a);
        recording.frequency_hz = Some(1e3);
        let mut frames = recording.frames_for(None, 2, Component::Real).unwrap();
        assert_eq!((frames.current_a, frames.frequency_hz), (current_a, Some(1e3)));
        frames.to_volts(0.5);
        let once = frames.clone();
        frames.to_volts(0.5);
        assert_eq!(frames, once);
        assert_eq!(frames.values, factor * array![[1.0, -2.0]]);
        let volts = (Unit::Volt, Some(0.5));
        let wanted = if unit == Unit::Arbitrary { (unit, current_a) } else { volts };
        assert_eq!((frames.unit, frames.current_a), wanted);
    }
}

/// The other direction has the opposite sign, which magnitudes do not show, and faults of its own.
#[test]
fn each_direction_of_a_measurement_is_its_own() {
    let both = [[0, 2, 1, 3], [2, 0, 1, 3], [0, 2, 3, 1]];
    let layout = Layout::Quadruples(both.to_vec());
    let map = FrameMap::new(&layout, 3, Some(&both), 3, "both").unwrap();
    let mut frame = Frame::new(0, Vec::new());
    let recorded = [Quality::GOOD, Quality::OPEN, Quality::GOOD];
    map.apply(&[1.0, 2.0, 3.0], None, &recorded, &mut frame).unwrap();
    assert_eq!((&frame.values[..], &frame.quality[..]), (&[1.0, 2.0, 3.0][..], &recorded[..]));
    // one that is recorded the other way only is turned
    let map = FrameMap::new(&layout, 3, Some(&[[2, 0, 3, 1]]), 1, "both").unwrap();
    map.apply(&[1.0, 2.0, 3.0], None, &recorded, &mut frame).unwrap();
    assert_eq!(frame.values, [1.0]);
}

#[test]
fn frames_one_by_one_are_those_of_the_recording() {
    let mut recording = complex();
    flag(&mut recording, [0, 2], Quality::OPEN);
    let quadruples = [[1, 0, 0, 2], [0, 1, 2, 1]];
    let potentials = Layout::Potentials { drives: vec![[0, 1]], electrodes: 3, driven: true };
    let named = Layout::Quadruples(vec![[0, 1, 1, 2], [0, 1, 0, 2], [2, 0, 1, 2]]);
    for (layout, quadruples, count) in [
        (Layout::ProtocolOrder, None, 3),
        (potentials, Some(&quadruples[..]), 2),
        (named, Some(&quadruples), 2),
    ] {
        recording.layout = layout;
        let map = FrameMap::new(&recording.layout, 3, quadruples, count, "stream").unwrap();
        assert_eq!((map.measurements(), map.value_count()), (count, 3));
        let part = |component| recording.frames_for(quadruples, count, component).unwrap();
        let (real, imaginary) = (part(Component::Real), part(Component::Imaginary));
        for (index, recorded) in recording.frames().enumerate() {
            let mapped = map.mapped(&recorded).unwrap();
            assert_eq!(mapped.values, real.values.row(index).to_vec());
            assert_eq!(mapped.imaginary, Some(imaginary.values.row(index).to_vec()));
            assert_eq!(mapped.quality, real.quality.row(index).to_vec());
        }
    }
}

#[test]
fn a_map_refuses_what_does_not_fit() {
    let map = FrameMap::new(&Layout::ProtocolOrder, 2, None, 2, "stream").unwrap();
    let (good, pair, one) = ([Quality::GOOD; 3], &[1.0, 2.0][..], &[1.0][..]);
    for (real, imaginary, quality, words) in [
        (one, None, &good[..2], "`real` has 1 entries, but expected 2"),
        (pair, Some(one), &good[..2], "`imaginary` has 1 entries, but expected 2"),
        (pair, None, &good, "`quality` has 3 entries, but expected 2"),
    ] {
        let mut frame = Frame::new(0, vec![7.0]);
        refused(map.apply(real, imaginary, quality, &mut frame), &[words]);
        assert_eq!(frame, Frame::new(0, vec![7.0]));
    }
    let new = |layout, value_count, count| FrameMap::new(&layout, value_count, None, count, "live");
    refused(new(Layout::ProtocolOrder, 256, 208), &["live: 256 values", "\"keep\""]);
    let short = new(Layout::Quadruples(vec![[0, 1, 2, 3]]), 2, 2);
    refused(short, &["`layout` has 1 entries, but expected 2"]);
}

#[test]
fn the_memory_order_of_a_recording_does_not_matter() {
    let recording = complex();
    let transposed = |a: &Array2<f64>| a.t().as_standard_layout().into_owned().reversed_axes();
    let mut other = recording.clone();
    other.real = transposed(&recording.real);
    other.imaginary = recording.imaginary.as_ref().map(transposed);
    assert!(!other.real.is_standard_layout());
    assert_eq!(other, recording);
    for component in [Component::Real, Component::Phased] {
        let of = |recording: &Recording| recording.frames_for(None, 3, component).unwrap();
        assert_eq!(of(&other), of(&recording));
    }
}

#[test]
fn flags_come_back_from_their_bits() {
    for bits in 0..=u16::MAX {
        // bits of no flag are rejected
        assert_eq!(Quality::from_bits(bits).map(Quality::bits), (bits < 64).then_some(bits));
    }
}

/// A value for each quadruple: symmetric in drive and measured pair, odd in either.
fn reciprocal([a, b, m, n]: Quadruple, seed: f64) -> f64 {
    let g = |i: u32, j: u32| (seed + f64::from(i.min(j)) * 7.1 + f64::from(i.max(j)) * 3.3).sin();
    g(a, m) - g(a, n) - g(b, m) + g(b, n)
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    #[test]
    fn reciprocal_frames_have_no_error(
        seed in 0.0..10.0_f64,
        scale in prop::sample::select(vec![1e-200, 1e-6, 1.0, 1e200]),
        flips in prop::collection::vec(0..4_u8, 208),
    ) {
        let mut order = rotated(16);
        for ([a, b, m, n], flip) in order.iter_mut().zip(flips) {
            if flip % 2 == 1 {
                std::mem::swap(a, b);
            }
            if flip > 1 {
                std::mem::swap(m, n);
            }
        }
        let frame: Vec<_> = order.iter().map(|&q| scale * reciprocal(q, seed)).collect();
        // four rounded terms of order 1, relative to a root mean square of order 1
        prop_assert!(reciprocity_error(&order, &frame).unwrap() < 1e-14);
    }

    #[test]
    fn a_relative_difference_is_found(seed in 0.0..10.0_f64, relative in 1e-6..0.5_f64) {
        let order = rotated(16);
        let frame: Vec<_> = order
            .iter()
            .map(|&q| reciprocal(q, seed) * (1.0 + if q[0] < q[2] { relative } else { -relative }))
            .collect();
        // v (1 + r) compared with v (1 - r): 2 r / sqrt(1 + r^2), rounded to about 1e-16 / r
        let expected = 2.0 * relative / (1.0 + relative * relative).sqrt();
        let error = reciprocity_error(&order, &frame).unwrap();
        prop_assert!((error / expected - 1.0).abs() < 1e-9, "{error} {expected}");
    }
}

#[test]
fn errors_at_the_edges() {
    let order = [[0, 1, 2, 3], [2, 3, 0, 1]];
    assert_eq!(reciprocity_error(&order, &[1.0]), None);
    assert_eq!(reciprocity_error(&order, &[0.0, 0.0]), None);
    assert_eq!(reciprocity_error(&order, &[f64::NAN, 1.0]), None);
    assert_eq!(reciprocity_error(&order, &[f64::INFINITY, 1.0]), None);
    assert_eq!(reciprocity_error(&[], &[]), None);
    // orders without reciprocal pairs say nothing
    assert_eq!(reciprocity_error(&opposite(16), &vec![0.5; 192]), None);
    // driven electrodes are ignored
    assert_eq!(reciprocity_error(&[[0, 1, 1, 2], [1, 2, 0, 1]], &[1.0, 5.0]), None);
}

#[test]
fn correlation_with_a_model() {
    let model = [1.0, -2.0, 3.0];
    let scaled = model.map(|value| -1e200 * value);
    // squares, sum and root of numbers of order 1
    assert!((model_correlation(&scaled, &model).unwrap() + 1.0).abs() < 1e-15);
    assert!((model_correlation(&model, &model).unwrap() - 1.0).abs() < 1e-15);
    assert_eq!(model_correlation(&[2.0, 1.0, 0.0], &model), Some(0.0));
    assert_eq!(model_correlation(&[5.0, f64::NAN, 0.0], &[0.5, 1.0, f64::INFINITY]), Some(1.0));
    assert_eq!(model_correlation(&[0.0; 3], &model), None);
    assert_eq!(model_correlation(&model[..2], &model), None);
}

#[test]
fn verdicts() {
    let frame: Vec<_> = ascending(16).iter().map(|&q| reciprocal(q, 1.0)).collect();
    let scene = rotated(16);
    let alternatives = [
        ("right", ascending(16)),
        ("another length", ascending(8)),
        ("right too", ascending(16).into_iter().map(|[a, b, m, n]| [m, n, a, b]).collect()),
        ("no pairs", vec![[0, 1, 2, 3]; 208]),
    ];
    let verdict = recognise_order(&frame, &scene, &alternatives);
    let OrderVerdict::Other { better, ours } = verdict else { panic!("{verdict:?}") };
    let settings: Vec<_> = better.iter().map(|other| other.setting.as_str()).collect();
    assert_eq!(settings, ["right", "right too"]);
    assert!(ours > 0.5, "{ours}");
    let verdict = recognise_order(&frame, &ascending(16), &alternatives);
    assert!(matches!(verdict, OrderVerdict::Consistent { .. }));
    let verdict = recognise_order(&frame, &scene, &alternatives[1..2]);
    assert!(matches!(verdict, OrderVerdict::Unclear { ours: Some(_), best: None }));
}

/// Potentials with zeros where current flows or without these, in rows, one per line, or by drives.
#[test]
fn pairs_are_formed_from_potentials_against_the_sink() {
    let drives = vec![[0, 1], [3, 2], [1, 4]];
    let potential = |drive: usize, e: u32| f64::from((7 * e * e + 3 * e + 1) * (drive as u32 + 2));
    let wanted = [[0, 1, 2, 3], [0, 1, 3, 4], [2, 3, 4, 0], [1, 4, 2, 3]];
    let of = |drive, m, n| potential(drive, m) - potential(drive, n);
    let pairs = [of(0, 2, 3), of(0, 3, 4), -of(1, 4, 0), of(2, 2, 3)];
    let expected = |driven| Layout::Potentials { drives: drives.clone(), electrodes: 5, driven };
    for (driven, columns) in [(true, 15), (true, 5), (true, 1), (false, 9), (false, 3), (false, 1)]
    {
        let values = |drive: usize| {
            let pair = drives[drive];
            let value = move |e| if pair.contains(&e) { 0.0 } else { potential(drive, e) };
            (0..5).filter(move |e| driven || !pair.contains(e)).map(value)
        };
        // two frames; those of the file decide, whatever the scene says
        let all: Vec<String> = (0..6).flat_map(|k| values(k % 3)).map(|v| v.to_string()).collect();
        let lines: Vec<String> = all.chunks(columns).map(|line| line.join(",")).collect();
        let read = csv(&lines.join("\n")).unwrap();
        let read = read.arranged_for(&expected(!driven), Some(&wanted), wanted.len());
        assert_eq!(read.layout, expected(driven), "{columns}");
        let frames = read.frames_for(Some(&wanted), wanted.len(), Component::Real).unwrap();
        assert_eq!(frames.values.dim(), (2, 4));
        assert_eq!(frames.values.row(1).to_vec(), pairs, "{columns}");
    }
    // a drive of one electrode, which no protocol has
    let one = Layout::Potentials { drives: vec![[0, 0]], electrodes: 2, driven: false };
    let map = FrameMap::new(&one, 0, Some(&[[0, 0, 1, 1]]), 1, "board");
    refused(map, &["has no measurement [0, 0, 1, 1]"]);
    // a pair with a driven electrode, of which there is no potential
    let map = FrameMap::new(&expected(false), 9, Some(&[[0, 1, 1, 2]]), 1, "board");
    refused(map, &["has no measurement [0, 1, 1, 2]"]);
}
