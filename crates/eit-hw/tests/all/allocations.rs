//! Checks that a running stream allocates nothing per frame, for every codec, driver and recording.

use std::hint::black_box;

use crate::common::rotated;
use crate::common::wire::eits1_frame;
use allocation_counter::measure;
use eit_hw::capture::{CaptureSettings, CaptureWriter, SessionRecord};
use eit_hw::codec::{eits1, sciospec, text};
use eit_hw::driver::{Decoded, Driver, Eits1, Polarity, Sciospec, SciospecSettings};
use eit_hw::{Frame, Quality};

/// Frames that fill every buffer first, and frames for which allocations are counted.
const WARM: usize = 4;
const COUNTED: usize = 20;

fn eits1_wire() -> Vec<Vec<u8>> {
    let payload: Vec<u8> = (0..416).flat_map(|index| (index as f32).to_le_bytes()).collect();
    let frame = |sequence| {
        let mut wire = Vec::new();
        let message = eits1::Message {
            kind: eits1::Kind::Frame,
            sequence,
            device_time_us: 0,
            flags: eits1::flags::COMPLEX,
            count: 416,
            payload: &payload,
        };
        eits1::encode(&message, &mut wire).unwrap();
        wire
    };
    (0..(WARM + COUNTED) as u32).map(frame).collect()
}

fn sciospec_wire() -> Vec<Vec<u8>> {
    let frame = |number: usize| {
        let mut wire = Vec::new();
        for drive in 1..17 {
            let data = sciospec::DataFrame {
                group: 1,
                drive: Some([drive, drive % 16 + 1]),
                frequency_row: Some(1),
                time_ms: Some(number as u32),
                potentials_v: [[0.25, f32::from(drive)]; 16],
            };
            sciospec::encode_data(&data, &mut wire);
        }
        wire
    };
    (0..WARM + COUNTED).map(frame).collect()
}

/// Feeds the first frames, then counts allocations while decoding the others.
fn counted(frames: &[Vec<u8>], mut decode: impl FnMut(&[u8]) -> usize) -> (u64, usize) {
    let warm: usize = frames[..WARM].iter().map(|wire| decode(wire)).sum();
    black_box(warm);
    let mut seen = 0;
    let info = measure(|| {
        for wire in &frames[WARM..] {
            // in pieces, as they arrive
            seen += wire.chunks(500).map(&mut decode).sum::<usize>();
        }
    });
    (info.count_total, seen)
}

#[test]
fn codecs_allocate_nothing_per_frame() {
    let mut decoder = eits1::Decoder::new();
    let mut decode = |bytes: &[u8]| {
        let mut seen = 0;
        decoder.push(bytes, &mut |event| {
            seen += usize::from(matches!(event, eits1::Event::Message(_)));
        });
        seen
    };
    assert_eq!(counted(&eits1_wire(), &mut decode), (0, COUNTED));

    let mut decoder = sciospec::Decoder::new(sciospec::Output::default());
    let mut decode = |bytes: &[u8]| {
        let mut seen = 0;
        decoder.push(bytes, &mut |event| {
            seen += usize::from(matches!(event, sciospec::Event::Data(_)));
        });
        seen
    };
    assert_eq!(counted(&sciospec_wire(), &mut decode), (0, 16 * COUNTED));

    let line: String = (0..208).map(|index| format!("{}.5,", index)).collect();
    let lines = vec![format!("{line}\r\n").into_bytes(); WARM + COUNTED];
    let mut decoder = text::Decoder::new(text::TextFormat::csv(208)).unwrap();
    let mut decode = |bytes: &[u8]| {
        let mut seen = 0;
        decoder.push(bytes, &mut |event| {
            seen += usize::from(matches!(event, text::Event::Frame { .. }));
        });
        seen
    };
    assert_eq!(counted(&lines, &mut decode), (0, COUNTED));
    // verifies that the counter counts
    assert!(measure(|| drop(black_box(vec![0_u8; 100]))).count_total > 0);
}

#[test]
fn drivers_allocate_nothing_per_frame() {
    let frames = |driver: &mut dyn Driver, bytes: &[u8]| {
        let mut seen = 0;
        driver.receive(bytes, &mut |decoded| {
            seen += usize::from(matches!(decoded, Decoded::Frame(_)))
        });
        seen
    };
    let settings = SciospecSettings {
        polarity: Polarity::AsListed,
        ..SciospecSettings::for_quadruples(16, &rotated(16))
    };
    let mut driver = Sciospec::new(settings).unwrap();
    let found = counted(&sciospec_wire(), |bytes| frames(&mut driver, bytes));
    assert_eq!(found, (0, COUNTED));

    // a connection sets up complex values; real ones need none
    let mut driver = Eits1::new(&rotated(16), 10.0, 1e-4, 0.0).unwrap();
    let values: Vec<f32> = (0..208).map(|index| index as f32).collect();
    let wire = |sequence| eits1_frame(sequence, 0, &values);
    let wires: Vec<_> = (0..(WARM + COUNTED) as u32).map(wire).collect();
    assert_eq!(counted(&wires, |bytes| frames(&mut driver, bytes)), (0, COUNTED));
}

/// Recording copies no frame; only the container allocates, per chunk.
#[test]
fn a_recorder_allocates_nothing_per_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let frame = Frame {
        values: (0..208).map(|index| f64::from(index).sin()).collect(),
        imaginary: Some((0..208).map(|index| f64::from(index).cos()).collect()),
        quality: vec![Quality::GOOD; 208],
        sequence: 0,
        epoch: 0,
        device_time_s: Some(0.1),
        host_time_s: Some(1.79e9),
    };
    let settings = CaptureSettings { flush_s: 3600.0, ..CaptureSettings::default() };
    let mut writer = CaptureWriter::create(&path, &SessionRecord::default(), settings).unwrap();
    // within one chunk only the container's list of messages grows, by doubling
    (0..40).for_each(|_| writer.frame(&frame).unwrap());
    let info = measure(|| (0..20).for_each(|_| writer.frame(&frame).unwrap()));
    assert!(info.count_total <= 4, "{}", info.count_total);
    writer.finish().unwrap();
}
