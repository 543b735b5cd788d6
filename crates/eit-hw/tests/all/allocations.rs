//! Checks that a running stream allocates nothing per frame, for every codec, driver and recording.

use std::hint::black_box;

use crate::common::recordings::frame;
use crate::common::wire::{board_frame, eits1_frame, sciospec_frame};
use crate::common::{place, rotated};
use allocation_counter::measure;
use eit_hw::capture::{CaptureSettings, CaptureWriter, SessionRecord};
use eit_hw::codec::text::TextFormat;
use eit_hw::driver::{Board, Decoded, Driver, Eits1, Polarity, Sciospec, SciospecSettings};
use eit_hw::{Frame, Layout};

/// Frames, of which the first fill every buffer and are not counted.
const FRAMES: u32 = 24;
const WARM: usize = 4;

/// With the codecs below them.
#[test]
fn drivers_allocate_nothing_per_frame() {
    let frames = |driver: &mut dyn Driver, bytes: &[u8]| {
        let mut seen = 0;
        driver.receive(bytes, &mut |decoded| {
            seen += usize::from(matches!(decoded, Decoded::Frame(_)));
        });
        seen
    };
    let settings = SciospecSettings::for_quadruples(16, &rotated(16));
    let settings = SciospecSettings { polarity: Polarity::AsListed, ..settings };
    let drives = |time_ms| {
        (1..17).flat_map(move |drive| sciospec_frame(1, [drive, drive % 16 + 1], 1, time_ms))
    };
    let sciospec = (0..FRAMES).map(|number| drives(number).collect()).collect();
    let values: Vec<f32> = (0..208).map(|index| index as f32).collect();
    let eits1 = (0..FRAMES).map(|sequence| eits1_frame(sequence, 0, &values)).collect();
    let format = TextFormat::csv(208);
    let text = vec![board_frame(&format, 0, 1); FRAMES as usize];
    let board = Board::new("csv", 115_200, format, Layout::Quadruples(rotated(16)));
    type Stream = (Box<dyn Driver>, Vec<Vec<u8>>);
    let drivers: [Stream; 3] = [
        (Box::new(Sciospec::new(settings).unwrap()), sciospec),
        // a connection sets up complex values; real ones need none
        (Box::new(Eits1::new(&rotated(16), 10.0, 1e-4, 0.0).unwrap()), eits1),
        (board.driver().unwrap(), text),
    ];
    for (mut driver, wire) in drivers {
        let mut decode = |bytes: &[u8]| frames(&mut *driver, bytes);
        wire[..WARM].iter().for_each(|frame| _ = black_box(decode(frame)));
        let mut seen = 0;
        // in pieces, as they arrive
        let pieces = wire[WARM..].iter().flat_map(|frame| frame.chunks(500));
        let info = measure(|| seen = pieces.map(&mut decode).sum());
        assert_eq!((info.count_total, seen), (0, FRAMES as usize - WARM), "{}", driver.name());
    }
    // verifies that the counter counts
    assert!(measure(|| drop(black_box(vec![0_u8; 100]))).count_total > 0);
}

/// Recording copies no frame; only the container allocates, per chunk.
#[test]
fn a_recorder_allocates_nothing_per_frame() {
    let (_folder, path) = place("a.mcap");
    let frame = Frame { imaginary: Some(frame(1).values), ..frame(0) };
    let settings = CaptureSettings { flush_s: 3600.0, ..CaptureSettings::default() };
    let mut writer = CaptureWriter::create(&path, &SessionRecord::default(), settings).unwrap();
    // within one chunk only the container's list of messages grows, by doubling
    (0..40).for_each(|_| writer.frame(&frame).unwrap());
    let info = measure(|| (0..20).for_each(|_| writer.frame(&frame).unwrap()));
    assert!(info.count_total <= 4, "{}", info.count_total);
    writer.finish().unwrap();
}
