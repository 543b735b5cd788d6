//! Selection of a protocol's measurements from a recording, and reciprocity. One file, because all
//! tests share the same recordings.

use crate::common::{ascending, opposite, parse, rotated, table};
use eit_hw::{
    Component, CountHint, Format, Frame, FrameMap, FrameOrientation, HwError, Layout, Note,
    OrderVerdict, Quadruple, Quality, ReadOptions, Recording, Unit, read_recording,
    reciprocity_error, recognise_order,
};
use ndarray::{Array2, array};
use proptest::prelude::*;

/// Sets the flags of one value.
fn flag(recording: &mut Recording, at: [usize; 2], flags: Quality) {
    let all = recording.quality.get_or_insert_with(|| Array2::default(recording.real.dim()));
    all[at] = flags;
}

fn csv(text: &str) -> Result<Recording, HwError> {
    parse(Format::Csv, text, &ReadOptions::default())
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
}

/// Lines of one value or one drive are joined to frames; a matrix with a line for each drive is turned. What may be frames in
/// columns, and lines of another length, stay as they are.
#[test]
fn tables_are_compared_with_the_shape_of_the_protocol() {
    let (quadruples, count) = (ascending(6), 18);
    let value = |k: usize| (k + 5).to_string();
    let lines = |columns: usize, rows: usize| -> String {
        let line = |row: usize| (0..columns).map(|c| value(row * columns + c)).collect::<Vec<_>>();
        (0..rows).map(|row| line(row).join(",") + "\n").collect()
    };
    let frame = |k: usize| -> Vec<f64> { (0..count).map(|i| (k * count + i + 5) as f64).collect() };
    for (columns, rows, joined) in [(3, 12, 6), (1, 36, 18)] {
        let read = csv(&lines(columns, rows)).unwrap().arranged_for(
            &Layout::ProtocolOrder,
            Some(&quadruples),
            count,
        );
        let frames = read.frames_for(Some(&quadruples), count, Component::Real).unwrap();
        assert_eq!(frames.values.row(1).to_vec(), frame(1));
        assert!(read.notes.contains(&Note::Joined { lines: joined }), "{:?}", read.notes);
    }
    for (columns, rows) in [(2, 18), (9, 2), (3, 18), (6, 3)] {
        let read = csv(&lines(columns, rows)).unwrap().arranged_for(
            &Layout::ProtocolOrder,
            Some(&quadruples),
            count,
        );
        assert_eq!(read.real.dim(), (rows, columns));
    }
    assert_eq!(
        csv("1\n2\n").unwrap().arranged_for(&Layout::ProtocolOrder, None, 0).real.dim(),
        (2, 1)
    );
    let matrix = |columns, rows| {
        let options = table(FrameOrientation::Matrix, false);
        let read = parse(Format::Csv, &lines(columns, rows), &options).unwrap();
        read.arranged_for(&Layout::ProtocolOrder, Some(&quadruples), count)
    };
    let turned = matrix(3, 6);
    assert_eq!(
        (turned.real.row(0).to_vec(), &turned.notes[..]),
        (frame(0), &[Note::Turned { drives: 6 }][..])
    );
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
    assert_eq!(flagged.quality[[0, 1]], Quality::NON_FINITE);
    assert_eq!(flagged.mean_frame()[1], 0.0);
}

#[test]
fn real_recordings_have_no_imaginary_part() {
    let recording = csv("1,-2\n").unwrap();
    let of = |component| recording.frames_for(None, 2, component);
    assert!(matches!(of(Component::Imaginary), Err(HwError::NoImaginaryPart { .. })));
    assert_eq!(of(Component::Phased).unwrap().values, array![[1.0, -2.0]]);
    assert_eq!(of(Component::Magnitude).unwrap().values, array![[1.0, 2.0]]);
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
    let of = |quadruple: Quadruple| recording.frames_for(Some(&[quadruple]), 1, Component::Real);
    assert!(matches!(of([2, 3, 0, 1]), Err(HwError::MissingDrive { a: 2, b: 3, .. })));
    assert!(matches!(
        of([0, 1, 2, 4]),
        Err(HwError::MissingMeasurement { quadruple: [0, 1, 2, 4], .. })
    ));
    let none = recording.frames_for(None, 3, Component::Real);
    assert!(matches!(none, Err(HwError::NeedsQuadruples { .. })));
    let short = recording.frames_for(Some(&wanted), 3, Component::Real);
    assert!(matches!(short, Err(HwError::QuadrupleCount { quadruples: 4, count: 3 })));
}

#[test]
fn potentials_are_subtracted() {
    let mut recording = complex();
    recording.layout = Layout::Potentials { drives: vec![[0, 1]], electrodes: 3, driven: true };
    flag(&mut recording, [0, 2], Quality::OPEN);
    let wanted = [[0, 1, 0, 2], [1, 0, 0, 2], [0, 1, 2, 0], [0, 1, 0, 1]];
    let frames = recording.frames_for(Some(&wanted), 4, Component::Real).unwrap();
    assert_eq!(frames.values.row(0).to_vec(), [9.0, -9.0, -9.0, 3.0]);
    assert_eq!(
        frames.quality.row(0).to_vec(),
        [Quality::OPEN, Quality::OPEN, Quality::OPEN, Quality::GOOD]
    );
    // the magnitude is that of the difference
    let frames = recording.frames_for(Some(&wanted), 4, Component::Magnitude).unwrap();
    assert_eq!(frames.values[[0, 0]], 15.0);
}

#[test]
fn fields_that_do_not_fit_are_refused() {
    let refused = |change: fn(&mut Recording)| {
        let mut recording = complex();
        change(&mut recording);
        let result = recording.frames_for(None, 3, Component::Real);
        assert!(matches!(result, Err(HwError::Inconsistent { .. })), "{result:?}");
    };
    refused(|recording| recording.quality = Some(Array2::default((2, 2))));
    refused(|recording| recording.quality = Some(Array2::default((1, 3))));
    refused(|recording| recording.imaginary = Some(Array2::zeros((1, 3))));
    refused(|recording| recording.imaginary = Some(Array2::zeros((2, 2))));
    refused(|recording| recording.device_time_s = Some(vec![0.0]));
    refused(|recording| recording.layout = Layout::Quadruples(Vec::new()));
    refused(|recording| {
        recording.layout =
            Layout::Potentials { drives: vec![[0, 1]], electrodes: usize::MAX, driven: true };
    });
}

#[test]
fn counts_that_differ_are_explained() {
    let hint = |found: usize, frames: usize, wanted: usize| {
        let text = vec![vec!["1"; found].join(","); frames].join("\n");
        let recording = csv(&text).unwrap();
        match recording.frames_for(None, wanted, Component::Real) {
            Err(HwError::CountMismatch { found: f, frames: n, wanted: w, hint, .. }) => {
                assert_eq!((f, n, w), (found, frames, wanted));
                hint
            }
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(hint(4, 208, 208), CountHint::Transposed);
    assert_eq!(hint(13, 16, 208), CountHint::OneFrame);
    assert_eq!(hint(416, 1, 208), CountHint::Complex);
    assert_eq!(hint(256, 1, 208), CountHint::DrivenKept { electrodes: 16 });
    assert_eq!(hint(256, 1, 192), CountHint::DrivenKept { electrodes: 16 });
    assert_eq!(hint(208, 1, 256), CountHint::DrivenDropped { electrodes: 16 });
    assert_eq!(hint(104, 1, 208), CountHint::ReciprocalOnly);
    assert_eq!(hint(928, 1, 208), CountHint::Adjacent { electrodes: 32 });
    assert_eq!(hint(192, 1, 208), CountHint::Opposite { electrodes: 16 });
    // a column of times or frame numbers
    assert_eq!(hint(209, 1, 208), CountHint::OneMore);
    assert!(CountHint::OneMore.to_string().contains("remove that column"));
    assert_eq!(hint(207, 1, 208), CountHint::Unknown);
}

/// A table of 2 frames of 4 values in either file format, and options that read its columns as
/// frames; following the message fixes it.
#[test]
fn a_swapped_table_is_mended_by_the_key_of_the_message() {
    let folder = tempfile::tempdir().unwrap();
    let columns = [[1_u8, 5], [2, 6], [3, 7], [4, 8]];
    let text: String = columns.iter().map(|[a, b]| format!("{a},{b}\n")).collect();
    let header = b"\x93NUMPY\x01\x00\x39\x00{'descr': '|u1', 'fortran_order': False, \
        'shape': (4, 2)}";
    let npy = [header.as_slice(), columns.as_flattened()].concat();
    for (name, bytes) in [("f.csv", text.as_bytes()), ("f.npy", npy.as_slice())] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let frames = |frames_are, count| {
            let options = ReadOptions { frames_are, ..ReadOptions::default() };
            read_recording(&path, None, &options).unwrap().frames_for(None, count, Component::Real)
        };
        let refused = |frames_are, count, key: &str| {
            let message = frames(frames_are, count).unwrap_err().to_string();
            assert!(
                message.contains(&format!("set `[recording] frames_are = \"{key}\"`")),
                "{message}"
            );
        };
        let by = |orientation, count| frames(Some(orientation), count).unwrap().values;
        refused(None, 4, "columns");
        refused(Some(FrameOrientation::Rows), 4, "columns");
        let wanted = array![[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]];
        assert_eq!(by(FrameOrientation::Columns, 4), wanted);
        refused(Some(FrameOrientation::Columns), 2, "rows");
        assert_eq!(by(FrameOrientation::Rows, 2), wanted.t());
        refused(None, 8, "matrix");
        refused(Some(FrameOrientation::Columns), 8, "matrix");
        let matrix = array![[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]];
        assert_eq!(by(FrameOrientation::Matrix, 8), matrix);
    }
}

#[test]
fn a_format_that_is_no_table_has_no_hint_about_tables() {
    let mut recording = complex();
    recording.frames_are = None;
    for wanted in [2, 6] {
        match recording.frames_for(None, wanted, Component::Real) {
            Err(HwError::CountMismatch { frames: 2, hint, .. }) => {
                assert_eq!(
                    hint,
                    if wanted == 2 { CountHint::Unknown } else { CountHint::ReciprocalOnly }
                );
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn frames_come_one_by_one() {
    let mut recording = complex();
    recording.device_time_s = Some(vec![0.0, 0.05]);
    let frames = recording.frames_for(None, 3, Component::Real).unwrap();
    let list: Vec<_> = frames.frames().collect();
    assert_eq!(list.len(), 2);
    assert_eq!(list[1].values, [6.0, 0.0, 3.0]);
    assert_eq!((list[1].sequence, list[1].device_time_s), (1, Some(0.05)));
    assert_eq!(frames.mean_frame(), [4.5, 0.0, -1.5]);
}

#[test]
fn means_are_of_good_values_of_some_frames() {
    let mut recording = csv("1,2\n3,4\n5,6\n7,8\n").unwrap();
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
    for none in [2..2, 9..12] {
        assert_eq!(frames.mean_of(none).1, [false, false]);
    }
    assert_eq!(frames.mean_frame(), frames.mean_of(0..4).0);
}

#[test]
fn values_become_volts() {
    let frames = |unit, current_a| {
        let mut recording = csv("1,-2\n").unwrap();
        (recording.unit, recording.current_a) = (unit, current_a);
        recording.frequency_hz = Some(1e3);
        let mut frames = recording.frames_for(None, 2, Component::Real).unwrap();
        assert_eq!((frames.current_a, frames.frequency_hz), (current_a, Some(1e3)));
        frames.to_volts(0.5);
        let once = frames.clone();
        frames.to_volts(0.5);
        assert_eq!(frames, once);
        let Unit::Volt = frames.unit else {
            assert_eq!((unit, current_a), (frames.unit, frames.current_a));
            return frames.values;
        };
        assert_eq!(frames.current_a, Some(0.5));
        frames.values
    };
    let unchanged = array![[1.0, -2.0]];
    assert_eq!(frames(Unit::Ohm, None), array![[0.5, -1.0]]);
    assert_eq!(frames(Unit::Volt, Some(0.25)), array![[2.0, -4.0]]);
    assert_eq!(frames(Unit::Volt, None), unchanged);
    assert_eq!(frames(Unit::Volt, Some(0.0)), unchanged);
    assert_eq!(frames(Unit::Arbitrary, Some(0.25)), unchanged);
}

/// A measurement that is recorded in both directions is taken from its own: the other one has the opposite sign, which
/// magnitudes do not show, and faults of its own.
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

/// A stream selects the same measurements as `frames_for` does from a file.
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
    let good = [Quality::GOOD; 3];
    let short: Option<&[f64]> = Some(&[1.0]);
    for (real, imaginary, quality, wrong) in [
        (&[1.0][..], None, &good[..2], "real"),
        (&[1.0, 2.0], short, &good[..2], "imaginary"),
        (&[1.0, 2.0], None, &good, "quality"),
    ] {
        let mut frame = Frame::new(0, vec![7.0]);
        match map.apply(real, imaginary, quality, &mut frame) {
            Err(HwError::Inconsistent { field, wanted: 2, .. }) => assert_eq!(field, wrong),
            other => panic!("{other:?}"),
        }
        assert_eq!(frame, Frame::new(0, vec![7.0]));
    }
    let new = |layout, value_count, count| {
        FrameMap::new(&layout, value_count, None, count, "stream").unwrap_err()
    };
    let message = new(Layout::ProtocolOrder, 256, 208).to_string();
    assert!(message.starts_with("stream: 256 values") && message.contains("\"keep\""), "{message}");
    let short = new(Layout::Quadruples(vec![[0, 1, 2, 3]]), 2, 2);
    assert!(matches!(short, HwError::Inconsistent { field: "layout", found: 1, wanted: 2, .. }));
}

#[test]
fn the_memory_order_of_a_recording_does_not_matter() {
    let recording = complex();
    let transposed =
        |array: &Array2<f64>| array.t().as_standard_layout().into_owned().reversed_axes();
    let mut other = recording.clone();
    other.real = transposed(&recording.real);
    other.imaginary = recording.imaginary.as_ref().map(transposed);
    assert!(!other.real.is_standard_layout());
    assert_eq!(other, recording);
    for component in [Component::Real, Component::Phased] {
        assert_eq!(
            other.frames_for(None, 3, component).unwrap(),
            recording.frames_for(None, 3, component).unwrap()
        );
    }
}

#[test]
fn flags_come_back_from_their_bits() {
    let flags = [
        Quality::SATURATED,
        Quality::STUCK,
        Quality::OPEN,
        Quality::OVER_RANGE,
        Quality::NON_FINITE,
        Quality::MISSING,
    ];
    for bits in 0..=u16::MAX {
        let some = flags.iter().filter(|flag| flag.bits() & bits != 0);
        let quality = some.fold(Quality::GOOD, |all, &flag| all | flag);
        // bits of no flag are rejected
        assert_eq!(Quality::from_bits(bits), (quality.bits() == bits).then_some(quality));
    }
}

/// Returns a reciprocal value for each quadruple: symmetric in drive and measured pair, odd in
/// either.
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
        for (quadruple, flip) in order.iter_mut().zip(flips) {
            let [a, b, m, n] = *quadruple;
            *quadruple = match flip {
                0 => [a, b, m, n],
                1 => [b, a, m, n],
                2 => [a, b, n, m],
                _ => [b, a, n, m],
            };
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

    #[test]
    fn orders_without_reciprocal_pairs_say_nothing(
        frame in prop::collection::vec(-1.0..1.0_f64, 192),
    ) {
        prop_assert_eq!(reciprocity_error(&opposite(16), &frame), None);
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
    // driven electrodes are ignored
    assert_eq!(reciprocity_error(&[[0, 1, 1, 2], [1, 2, 0, 1]], &[1.0, 5.0]), None);
}

#[test]
fn correlation_with_a_model() {
    use eit_hw::model_correlation;
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
    match recognise_order(&frame, &scene, &alternatives) {
        OrderVerdict::Other { better, ours } => {
            let settings: Vec<_> = better.iter().map(|other| other.setting.as_str()).collect();
            assert_eq!(settings, ["right", "right too"]);
            assert!(ours > 0.5, "{ours}");
        }
        other => panic!("{other:?}"),
    }
    assert!(matches!(
        recognise_order(&frame, &ascending(16), &alternatives),
        OrderVerdict::Consistent { .. }
    ));
    assert!(matches!(
        recognise_order(&frame, &scene, &alternatives[1..2]),
        OrderVerdict::Unclear { ours: Some(_), best: None }
    ));
}

/// Potentials against the sink, with zeros where current flows or without these, in rows, one per line, or by drives: pairs are
/// formed from them.
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
            let driven_pair = drives[drive];
            (0..5)
                .filter(move |e| driven || !driven_pair.contains(e))
                .map(move |e| if driven_pair.contains(&e) { 0.0 } else { potential(drive, e) })
        };
        // two frames; those of the file decide, whatever the scene says
        let all: Vec<String> =
            (0..6).flat_map(|k| values(k % 3)).map(|value| value.to_string()).collect();
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
    assert!(matches!(map, Err(HwError::MissingMeasurement { .. })), "{map:?}");
    // a pair with a driven electrode, of which there is no potential
    let map = FrameMap::new(&expected(false), 9, Some(&[[0, 1, 1, 2]]), 1, "board");
    assert!(matches!(map, Err(HwError::MissingMeasurement { quadruple: [0, 1, 1, 2], .. })));
}
