//! Rows 1 to 4, 14 and 15: how codecs handle damaged bytes.

use eit_hw::Quality;
use eit_hw::codec::{eits1, sciospec, text};
use proptest::prelude::*;
use proptest::sample::Index;
use text::{Fault, Framing, Number, TextFormat};

use crate::common::wire::{
    board_frame, eits1_events, eits1_frame, sciospec_events, sciospec_frame, text_events,
};

/// A codec under test: converts bytes in pieces to events as text.
type Decode = Box<dyn Fn(&[&[u8]]) -> Vec<String>>;

/// Returns the codecs, every framing of text among them, a stream of four frames for each, and the name of a frame's event.
fn streams() -> Vec<(String, Decode, Vec<Vec<u8>>, &'static str)> {
    let small = |framing, lines_per_frame, values_per_line| TextFormat {
        framing,
        lines_per_frame,
        values_per_line,
        ..TextFormat::default()
    };
    let (number, hex) = (Number::HexInteger, small(Framing::Prefix("!V".into()), 1, 4));
    let formats = [
        small(Framing::Lines, 1, 3),
        small(Framing::StartLine("s".into()), 3, 2),
        small(Framing::Prefix("magnitudes".into()), 1, 4),
        small(Framing::EndLine("Done".into()), 4, 1),
        TextFormat { number, complex: true, ..hex },
    ];
    let eits1 = (0..4).map(|i| eits1_frame(i, 7, &[0.5, i as f32, 0.0])).collect();
    let sciospec = (1..5).map(|i| sciospec_frame(1, [i, i + 1], 1, 5)).collect();
    let mut streams: Vec<(String, Decode, Vec<Vec<u8>>, _)> = vec![
        ("eits1".into(), Box::new(eits1_events), eits1, "Message"),
        ("sciospec".into(), Box::new(sciospec_events), sciospec, "Data"),
    ];
    for format in formats {
        // the first of plain lines may be incomplete: it is skipped. No two frames have a value in common
        let frames: Vec<_> = (0..5).map(|frame| board_frame(&format, 100 * frame, 1)).collect();
        let name = format!("{:?}", format.framing);
        streams.push((name, Box::new(move |p| text_events(&format, p)), frames, "Frame"));
    }
    streams
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    /// Whole and cut frames of all codecs, and garbage.
    #[test]
    fn row_01_events_do_not_depend_on_the_pieces(
        parts in prop::collection::vec((any::<Index>(), 0.0..2.0), 0..8),
        garbage in prop::collection::vec(any::<u8>(), 0..50),
        sizes in prop::collection::vec(1_usize..40, 1..60),
    ) {
        let streams = streams();
        let frames = streams.iter().flat_map(|(_, _, frames, _)| frames);
        let all: Vec<&Vec<u8>> = frames.chain([&garbage]).collect();
        let cut = |(which, share): &(Index, f64)| {
            let piece = which.get(&all);
            &piece[..piece.len().min((share * piece.len() as f64) as usize)]
        };
        let bytes = parts.iter().map(cut).collect::<Vec<_>>().concat();
        let (mut pieces, mut rest) = (Vec::new(), &bytes[..]);
        let mut sizes = sizes.iter().cycle();
        while !rest.is_empty() {
            let (piece, after) = rest.split_at(rest.len().min(*sizes.next().unwrap()));
            pieces.push(piece);
            rest = after;
        }
        for (name, decode, ..) in &streams {
            prop_assert_eq!(decode(&[&bytes]), decode(&pieces), "{}", name);
        }
    }
}

/// One of four frames is damaged and may take another with it. In text, one of its values may change.
#[test]
fn row_02_one_damaged_byte_at_each_offset() {
    for (name, decode, frames, frame) in streams() {
        let good: Vec<String> =
            decode(&[&frames.concat()]).into_iter().filter(|e| e.starts_with(frame)).collect();
        let is_text = frame == "Frame";
        // damage the second frame
        let after = frames[2..].concat();
        for offset in 0..frames[1].len() {
            let (start, rest) = frames[1].split_at(offset);
            let cases = [
                ("dropped", [start, &rest[1..]].concat()),
                ("inserted", [start, &[0xB4], rest].concat()),
                ("flipped", [start, &[rest[0] ^ 0x10], &rest[1..]].concat()),
                ("doubled", [start, &rest[..1], rest].concat()),
            ];
            for (what, damaged) in cases {
                let wire = [&frames[0], &damaged, &after].map(|part| &part[..]).concat();
                let events = decode(&[&wire]);
                let reported: Vec<_> = events.iter().filter(|e| e.starts_with(frame)).collect();
                assert!(reported.len() + 2 >= good.len(), "{name}, {what} at {offset}: {events:?}");
                let wrong = reported.iter().filter(|event| !good.contains(event)).count();
                // a changed digit or float; other damage misplaces the end tag of a Sciospec frame
                let may_be = is_text || name == "sciospec" && what == "flipped";
                assert!(wrong <= usize::from(may_be), "{name}, {what} at {offset}: {reported:?}");
                assert_eq!(reported.last(), good.last().as_ref(), "{name}, {what} at {offset}");
            }
        }
    }
}

/// Wrong lengths and end tags are among the bytes of row 2.
#[test]
fn row_03_a_frame_that_is_cut_at_the_end_is_not_reported() {
    let one = sciospec_frame(1, [1, 2], 1, 5);
    for end in 0..one.len() {
        let events = sciospec_events(&[&one, &one[..end]]);
        assert_eq!(events.iter().filter(|event| event.starts_with("Data")).count(), 1, "{end}");
    }
    let one = eits1_frame(1, 5, &[0.5; 4]);
    for end in 0..one.len() {
        assert_eq!(eits1_events(&[&one, &one[..end]]).len(), 1, "{end}");
    }
}

#[test]
fn row_04_tags_and_whole_frames_in_the_payload() {
    // floats whose bytes are tags and an acknowledgement
    let tags = [[0xB4, 0x89, 0x18, 0x01], [0x18, 0x01, 0x83, 0x18], [0x00, 0x00, 0xB4, 0x18]];
    let tag = |k: usize| f32::from_be_bytes(tags[k % 3]);
    let potentials_v = std::array::from_fn(|k| [tag(k), tag(k + 1)]);
    let (drive, frequency_row, time_ms) = (Some([1, 2]), Some(1), Some(0x1801_8318));
    let frame = sciospec::DataFrame { group: 1, drive, frequency_row, time_ms, potentials_v };
    let mut one = Vec::new();
    sciospec::encode_data(&frame, &mut one);
    let wanted = format!("{:?}", sciospec::Event::Data(frame));
    assert_eq!(sciospec_events(&[&one.repeat(5)]), vec![wanted.clone(); 5]);
    // start in the middle of such a frame: only complete frames are reported
    for start in 1..one.len() {
        let events = sciospec_events(&[&one[start..], &one.repeat(4)]);
        let data: Vec<_> = events.iter().filter(|event| event.starts_with("Data")).collect();
        assert!((3..=4).contains(&data.len()), "{start}: {events:?}");
        assert!(data.iter().all(|event| **event == wanted), "{start}");
    }

    // a complete message as the text of another one
    let fake = eits1_frame(9, 5, &[1.0, 2.0]);
    let mut wire = Vec::new();
    let (kind, count, payload) = (eits1::Kind::Text, fake.len() as u16, &fake[..]);
    let message = eits1::Message { kind, sequence: 0, device_time_us: 0, flags: 0, count, payload };
    eits1::encode(&message, &mut wire).unwrap();
    for start in 0..wire.len() {
        let events = eits1_events(&[&wire[start..], &eits1_frame(3, 5, &[0.5])]);
        assert!(!events.iter().any(|event| event.contains("sequence: 9")), "{start}: {events:?}");
        assert!(events.last().unwrap().contains("sequence: 3"), "{start}");
    }
}

/// The event for each kind of damaged line; the frame after it is always read.
#[test]
fn row_14_damaged_text() {
    let format = TextFormat::csv(3);
    let long = vec![b'1'; text::MAX_LINE_BYTES + 5];
    let values = |found| Fault::Values { found, wanted: 3 };
    let cases: Vec<(&[u8], Fault)> = vec![
        (b"1,2", values(2)),
        (b"1,2,3,4", values(4)),
        (b"1,\xC3\xA4,3", Fault::NotANumber { field: 1 }),
        (b"1,\xFF\xFE,3", Fault::NotANumber { field: 1 }),
        (&long, Fault::TooLong),
    ];
    for (line, fault) in cases {
        let wire = [b"0,0,0\n7,8,9\n".as_slice(), line, b"\n4,5,6\n"].concat();
        let events = text_events(&format, &[&wire]);
        let name = String::from_utf8_lossy(&line[..line.len().min(30)]).into_owned();
        assert!(events.contains(&format!("Skipped({fault:?})")), "{name}: {events:?}");
        assert!(events[1].contains("[7.0, 8.0, 9.0]"), "{name}: {events:?}");
        assert!(events.last().unwrap().contains("[4.0, 5.0, 6.0]"), "{name}: {events:?}");
        // nothing else is reported as a frame
        assert_eq!(events.iter().filter(|e| e.starts_with("Frame")).count(), 2, "{name}");
    }
    // any line end, also mixed; empty lines and a comma at the end are ignored
    let wire = b"0,0,0\n1,2,3\r\n4,5,6\r7,8,9,\n\r\n\n1,2,3\n";
    let events = text_events(&format, &[wire]);
    assert_eq!(events.iter().filter(|e| e.starts_with("Frame")).count(), 4, "{events:?}");
    // what boards print for a number that is not finite is a missing value, also the first of a line
    for word in ["nan", "NaN", "-nan", "inf", "-INF", "+Infinity", "ovf", "-ovf"] {
        let wire = format!("0,0,0\n1,{word},3\n{word},2,3\n");
        let events = text_events(&format, &[wire.as_bytes()]);
        assert_eq!(events.len(), 3, "{word}: {events:?}");
        assert!(events[1].contains("[1.0, NaN, 3.0]"), "{word}: {events:?}");
        assert!(events[2].contains("[NaN, 2.0, 3.0]"), "{word}: {events:?}");
    }
    // flags by value, and a banner in the middle of the stream
    let openeit = TextFormat { values_per_line: 4, ..TextFormat::open_eit(8).unwrap() };
    let wire = b"magnitudes: nan,\t0.0000,134217727.9375,1.0\nmagnitudes: FAILED Measurement\n";
    let mut decoder = text::Decoder::new(openeit).unwrap();
    decoder.reset(true);
    let mut seen = 0;
    decoder.push(wire, &mut |event| match event {
        text::Event::Frame { quality, .. } => {
            let flags = [Quality::NON_FINITE, Quality::OPEN, Quality::SATURATED, Quality::GOOD];
            assert_eq!(quality, flags);
            seen += 1;
        }
        text::Event::Line(line) => assert!(line.contains("FAILED"), "{line}"),
        text::Event::Skipped(fault) => panic!("{fault:?}"),
    });
    assert_eq!(seen, 1);
}

#[test]
fn row_15_every_flipped_bit_and_a_million_bytes_of_garbage() {
    let (one, next) = (eits1_frame(7, 5, &[1.5, -0.25, 0.0]), eits1_frame(8, 6, &[2.0]));
    for bit in 0..8 * (one.len() - 1) {
        let mut wire = one.clone();
        wire[bit / 8] ^= 1 << (bit % 8);
        let events = eits1_events(&[&wire, &next]);
        let reported: Vec<_> = events.iter().filter(|e| e.starts_with("Message")).collect();
        assert!(reported.len() == 1 && reported[0].contains("sequence: 8"), "{bit}: {events:?}");
    }
    let mut random = fixtures::Random::new(42);
    let garbage: Vec<u8> = (0..1_000_000).map(|_| random.below(256) as u8).collect();
    for (name, decode, frames, frame) in streams() {
        let events = decode(&[&garbage, b"\0\n", &frames.concat(), &frames.concat()]);
        let reported = events.iter().filter(|event| event.starts_with(frame)).count();
        // of twice four or five frames, at most the first ones are lost with the garbage
        let sent = 2 * frames.len();
        assert!(reported <= sent && reported + 3 >= sent, "{name}: {reported} of {sent}");
    }
}
