//! Codecs: known bytes of the protocols, any splitting into pieces, garbage, and the encoder in C.

use std::process::Command;

use crate::common::wire::{eits1_events, eits1_frame, sciospec_events};
use crate::common::{instruments, parse, place};
use eit_hw::codec::{eits1, sciospec, text};
use eit_hw::{HwError, Quadruple};
use text::{Framing, Number, TextFormat};

fn sciospec_frame() -> sciospec::DataFrame {
    let mut potentials_v = std::array::from_fn(|k| [0.125 * k as f32, 0.0]);
    potentials_v[..2].copy_from_slice(&[[1.0, -0.5], [-1.0, 0.0]]);
    let (drive, frequency_row, time_ms) = (Some([1, 2]), Some(1), Some(1234));
    sciospec::DataFrame { group: 1, drive, frequency_row, time_ms, potentials_v }
}

#[test]
fn eits1_worked_example() {
    // the example in docs/EITS-1.md
    let wire = [
        0x03, 0x01, 0x10, 0x01, 0x02, 0x07, 0x01, 0x01, 0x04, 0x40, 0x42, 0x0F, 0x01, 0x01, 0x01,
        0x01, 0x01, 0x01, 0x02, 0x02, 0x01, 0x01, 0x03, 0xC0, 0x3F, 0x01, 0x07, 0x80, 0xBE, 0x14,
        0xF5, 0x93, 0x1D, 0x00,
    ];
    assert_eq!(eits1_frame(7, 1_000_000, &[1.5, -0.25]), wire);
    let mut decoded = Vec::new();
    eits1::Decoder::new().push(&wire, &mut |event| {
        let eits1::Event::Message(message) = event else { panic!("{event:?}") };
        decoded.push((message.kind, message.sequence, message.device_time_us, message.flags));
        assert_eq!(message.values().collect::<Vec<_>>(), [1.5, -0.25]);
    });
    assert_eq!(decoded, [(eits1::Kind::Frame, 7, 1_000_000, 0)]);
}

#[test]
fn eits1_bodies_round_trip_and_refuse() {
    let full_scale = f32::INFINITY;
    let information =
        eits1::Information { full_scale, ..instruments::information("0042-\u{b5}", true) };
    let bytes = information.to_bytes();
    assert_eq!(eits1::Information::from_bytes(&bytes), Some(information.clone()));
    let of_start = |end: usize| eits1::Information::from_bytes(&bytes[..end]);
    assert!((0..bytes.len()).all(|end| of_start(end).is_none()));
    let long = eits1::Information { name: "\u{b5}".repeat(200), ..information };
    assert_eq!(eits1::Information::from_bytes(&long.to_bytes()).unwrap().name.len(), 254);

    let quadruples: [Quadruple; 2] = [[0, 1, 2, 3], [1, 2, 3, 255]];
    let configuration = eits1::Configuration::new(&quadruples, 25.0, 1e-4, 5e3).unwrap();
    let bytes = configuration.to_bytes();
    assert_eq!(eits1::Configuration::from_bytes(&bytes), Some(configuration));
    let of_start = |end: usize| eits1::Configuration::from_bytes(&bytes[..end]);
    assert!((0..bytes.len()).all(|end| of_start(end).is_none()));
    let refused = eits1::Configuration::new(&[[0, 1, 2, 256]], 25.0, 1e-4, 0.0).unwrap_err();
    assert_eq!(refused.to_string(), "electrode (from 0) is 256; expected at most 255 for EITS-1");
    assert!(eits1::Configuration::new(&[], 25.0, 1e-4, 0.0).is_err());
}

#[test]
fn eits1_refuses_to_encode_what_cannot_be_read() {
    let (kind, flags, payload) = (eits1::Kind::Frame, eits1::flags::COMPLEX, &[0; 4]);
    let message = eits1::Message { kind, sequence: 0, device_time_us: 0, flags, count: 1, payload };
    let mut wire = Vec::new();
    let odd = eits1::encode(&message, &mut wire);
    assert!(matches!(odd, Err(HwError::Setting { .. })) && wire.is_empty());
    let text = vec![b'x'; eits1::MAX_MESSAGE_BYTES];
    let long = eits1::Message { kind: eits1::Kind::Text, count: 16_384, payload: &text, ..message };
    assert!(eits1::encode(&long, &mut wire).is_err() && wire.is_empty());
    let fits = &text[..eits1::MAX_MESSAGE_BYTES - 24];
    let fits = eits1::Message { count: 16_360, payload: fits, flags: 0, ..long };
    eits1::encode(&fits, &mut wire).unwrap();
    assert_eq!(eits1_events(&[&wire]).len(), 1);
}

/// The encoder for firmware compiles as C99 without warnings and produces the same bytes.
#[test]
fn the_c_header_encodes_what_the_decoder_reads() {
    let (_folder, program) = place("frames");
    let compiler = Command::new("cc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic", "-O1"])
        .args(["-I", "c", "tests/files/eits1_frames.c", "-o"])
        .arg(&program)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output();
    let Ok(compiled) = compiler else {
        println!("skipped: no C compiler `cc`");
        return;
    };
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let output = Command::new(&program).output().unwrap();
    assert!(output.status.success(), "{:?}", output.status);

    let (mut count, mut seen, mut wanted_wire) = (0_usize, 0, Vec::new());
    eits1::Decoder::new().push(&output.stdout, &mut |event| {
        let eits1::Event::Message(message) = event else { panic!("{event:?}") };
        eits1::encode(&message, &mut wanted_wire).unwrap();
        seen += 1;
        if message.kind == eits1::Kind::Text {
            assert_eq!((message.sequence, message.payload), (9, &b"hello"[..]));
            return;
        }
        assert_eq!(message.sequence as usize, count);
        assert_eq!(message.device_time_us, 5_000_000_000 + count as u64);
        let flagged = count % 2 == 1;
        assert_eq!((message.values().count(), message.qualities().count()), (count, count));
        for (i, (value, quality)) in message.values().zip(message.qualities()).enumerate() {
            let wanted = if i % 5 != 0 { i as f32 * 0.37 - 20.0 } else { 0.0 };
            // one more rounding where the compiler does not fuse
            assert!((value - wanted).abs() < 1e-4, "{value} {wanted}");
            assert_eq!(usize::from(quality.bits()), if flagged { i % 64 } else { 0 });
        }
        count += if count < 300 { 1 } else { 181 };
    });
    // frames of 0 to 300, 481, 662, 843 and 1024 values, and the text
    assert_eq!(seen, 306);
    assert_eq!(wanted_wire, output.stdout);
}

#[test]
fn sciospec_worked_bytes() {
    let mut wire = Vec::new();
    sciospec::encode_data(&sciospec_frame(), &mut wire);
    let head = [0xB4, 0x89, 1, 1, 2, 0, 1, 0, 0, 0x04, 0xD2];
    // big-endian floats: 1, -0.5, -1, 0, then 0.25 and so on by 0.125
    let parts = [0x3F80_0000, 0xBF00_0000, 0xBF80_0000, 0, 0x3E80_0000, 0, 0x3EC0_0000, 0];
    let halves = [0x3F00, 0x3F20, 0x3F40, 0x3F60, 0x3F80, 0x3F90, 0x3FA0, 0x3FB0];
    let more = halves.into_iter().chain([0x3FC0, 0x3FD0, 0x3FE0, 0x3FF0]);
    let parts = parts.into_iter().chain(more.flat_map(|half| [half << 16, 0]));
    let parts: Vec<u8> = parts.flat_map(u32::to_be_bytes).collect();
    assert_eq!(wire, [&head[..], &parts, &[0xB4]].concat());
    let event = format!("{:?}", sciospec::Event::Data(sciospec_frame()));
    assert_eq!(sciospec_events(&[&wire]), [event]);

    let mut command = Vec::new();
    sciospec::encode(sciospec::TAG_SET_SETUP, &[0x05, 0x3A, 0x83, 0x12, 0x6F], &mut command);
    assert_eq!(command, [0xB0, 0x05, 0x05, 0x3A, 0x83, 0x12, 0x6F, 0xB0]);
    let info = [0xD1, 0x0A, 1, 0, 0x19, 1, 0x1F, 0x0A, 7, 1, 0, 0x58, 0xD1, 0x18, 1, 0x83, 0x18];
    let events = sciospec_events(&[&info]);
    assert!(events[0].starts_with("Other { tag: 209"), "{events:?}");
    assert_eq!(events[1], "System(Executed)");
}

#[test]
fn sciospec_refuses_data_that_makes_no_sense() {
    let good = sciospec_frame();
    let [mut nan, mut huge] = [good; 2];
    nan.potentials_v[3][1] = f32::NAN;
    huge.potentials_v[3][1] = 21.0;
    for bad in [
        nan,
        huge,
        sciospec::DataFrame { group: 9, ..good },
        sciospec::DataFrame { group: 0, ..good },
        sciospec::DataFrame { drive: Some([3, 3]), ..good },
        sciospec::DataFrame { drive: Some([3, 129]), ..good },
    ] {
        let mut wire = Vec::new();
        sciospec::encode_data(&bad, &mut wire);
        let events = sciospec_events(&[&wire]);
        assert!(!events.iter().any(|event| event.starts_with("Data")), "{events:?}");
    }
}

#[test]
fn numbers_as_boards_write_them() {
    // the firmware's own example: no padding, an odd number of digits
    assert_eq!(Number::HexInteger.parse(b"ffb4"), Some(65_460.0));
    assert_eq!(Number::HexInteger.parse(b"ffffd8f1"), Some(-9999.0));
    assert_eq!(Number::HexInteger.parse(b"abc"), Some(2748.0));
    assert_eq!(Number::HexInteger.parse(b"0.5120"), Some(0.512));
    assert_eq!(Number::HexInteger.parse(b"+abc"), None);
    assert_eq!(Number::HexFloat.parse(b"3f800000"), Some(1.0));
    assert_eq!(Number::HexFloat.parse(b"7fc00000"), None);
    for bad in ["nan", "inf", "1e999", "", "1,2", "0x10", "--1"] {
        assert_eq!(Number::Decimal.parse(bad.as_bytes()), None, "{bad}");
    }
}

/// A frame of several lines begins after an empty line or a pause, and is one once the next has come; whole lines stay frames.
#[test]
fn frames_of_several_lines_are_between_pauses() {
    let format = || text::TextFormat { values_per_line: 4, ..text::TextFormat::default() };
    let read = |pieces: &[&str]| {
        let (mut decoder, mut found) = (text::Decoder::new(format()).unwrap(), Vec::new());
        for piece in pieces {
            decoder.push(piece.as_bytes(), &mut |event| {
                found.push(match event {
                    text::Event::Frame { values, .. } => format!("{values:?}"),
                    text::Event::Skipped(text::Fault::Values { found, .. }) => format!("{found}"),
                    other => format!("{other:?}"),
                });
            });
        }
        found.join(" ")
    };
    let whole = "[1.0, 2.0, 3.0, 4.0]";
    // three make sure of their number of lines; the pieces begin in the middle of a line
    let three = "9\n\n1,2\n3,4\n\n1,2\n3,4\n\n1,2\n3,4\n\n";
    let single = "9\n\n1,2,3,4\n\n1,2,3,4\n";
    let pause = ["", "", "1,2\n3,4\n", "", ""];
    for (pieces, wanted) in [
        (&[three][..], whole.to_owned()),
        (&[&three.replace('\n', "\r\n")[..]], whole.to_owned()),
        (&["9\n\n1\n2\n3\n4\n\n1\n2\n3\n4\n\n1\n2\n3\n4\n\n"], whole.to_owned()),
        (&[three, "1,2\n3,4\n", "", ""], format!("{whole} {whole}")),
        (&[&["9\n"][..], &pause, &pause, &pause].concat(), whole.to_owned()),
        // one empty read is no pause
        (&[three, "1,2\n", "", "3,4\n\n"], format!("{whole} {whole}")),
        // an end is missing, so is a part, and another number of lines
        (&[three, "1,2\n3,4\n1,2\n\n1,2\n\n1\n2\n3,4\n\n"], format!("{whole} 2 2")),
        // nothing says which is the first; carriage returns are no empty lines
        (&["9\r\n1,2\r\n3,4\r\n1,2\r\n3,4\r\n"], "2 2 2 2".to_owned()),
        // lines that are frames: nothing else is one
        (&[single, "\n1,2\n3,4\n\n1,2\n1,2,3,4\n"], format!("{whole} {whole} 2 2 2 {whole}")),
        (&["9\n\n1,2\n1,2,3,4\n"], format!("2 {whole}")),
        // a pause within a line
        (&[three, "1,2\n3", "", "", ",4\n\n"], format!("{whole} {whole}")),
    ] {
        let found = read(pieces).replace("Skipped(TruncatedStart)", "");
        assert_eq!(found.trim(), wanted, "{pieces:?}");
    }
}

#[test]
fn text_formats_that_cannot_be_are_refused() {
    let good = TextFormat::csv(4);
    for (bad, name) in [
        (TextFormat { values_per_line: 0, ..good.clone() }, "lines_per_frame x values_per_line"),
        (TextFormat { lines_per_frame: usize::MAX, ..good.clone() }, "lines_per_frame x"),
        (TextFormat { lines_per_frame: 2, ..good.clone() }, "lines_per_frame is 2"),
        (TextFormat { values_per_line: 3, complex: true, ..good.clone() }, "values_per_line is 3"),
        (TextFormat { scale: f64::NAN, ..good.clone() }, "scale is NaN"),
        (TextFormat { saturated_from: Some(f64::NAN), ..good.clone() }, "saturated_from is NaN"),
        (TextFormat { framing: Framing::StartLine(" A".into()), ..good }, "frame mark is \" A\""),
    ] {
        let message = text::Decoder::new(bad).unwrap_err().to_string();
        assert!(message.starts_with(name), "{message}");
    }
}

#[test]
fn a_recorded_serial_line_gives_the_frames_of_its_log() {
    let Some(folder) = fixtures::shared_data("umitooko_serial16") else { return };
    for (name, first) in [("__3.txt", 1), ("efl_4_good.txt", 0)] {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        let log = parse(eit_hw::Format::SerialLog, &bytes, &Default::default()).unwrap();
        let mut found = Vec::new();
        text::Decoder::new(TextFormat::serial_16()).unwrap().push(&bytes, &mut |event| {
            if let text::Event::Frame { values, .. } = event {
                found.extend_from_slice(values);
            }
        });
        // the reader also accepts the reference, which has no `s`
        assert!(log.real.iter().skip(208 * first).eq(&found), "{name}: {}", found.len() / 208);
    }
}
