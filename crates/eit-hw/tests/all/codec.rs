//! Codecs: known bytes of the protocols, any splitting into pieces, garbage, and the encoder in C.
//! One file, because all codecs go through the same tests.

use std::process::Command;

use crate::common::parse;
use crate::common::wire::{board_frame, eits1_events, eits1_frame, sciospec_events, text_events};
use eit_hw::codec::{eits1, sciospec, text};
use eit_hw::{HwError, Quadruple, Quality};
use proptest::prelude::*;
use text::{Fault, Framing, Number, TextFormat};

fn presets() -> Vec<TextFormat> {
    vec![
        TextFormat::open_eit(8).unwrap(),
        TextFormat::cn0565(),
        TextFormat::black_sensor(),
        TextFormat::eit_microcontroller(),
        TextFormat::serial_16(),
        TextFormat::csv(3),
    ]
}

fn sciospec_frame() -> sciospec::DataFrame {
    let mut potentials_v = [[0.0; 2]; 16];
    for (k, potential) in potentials_v.iter_mut().enumerate() {
        *potential = [0.125 * k as f32, 0.0];
    }
    potentials_v[0] = [1.0, -0.5];
    potentials_v[1] = [-1.0, 0.0];
    sciospec::DataFrame {
        group: 1,
        drive: Some([1, 2]),
        frequency_row: Some(1),
        time_ms: Some(1234),
        potentials_v,
    }
}

#[test]
fn eits1_worked_example() {
    // the example in docs/EITS-1.md
    let wire = [
        0x03, 0x01, 0x10, 0x01, 0x02, 0x07, 0x01, 0x01, 0x04, 0x40, 0x42, 0x0F, 0x01, 0x01, 0x01,
        0x01, 0x01, 0x01, 0x02, 0x02, 0x01, 0x01, 0x03, 0xC0, 0x3F, 0x01, 0x07, 0x80, 0xBE, 0x14,
        0xF5, 0x93, 0x1D, 0x00,
    ];
    let payload: Vec<u8> = [1.5_f32, -0.25].iter().flat_map(|v| v.to_le_bytes()).collect();
    let message = eits1::Message {
        kind: eits1::Kind::Frame,
        sequence: 7,
        device_time_us: 1_000_000,
        flags: 0,
        count: 2,
        payload: &payload,
    };
    let mut encoded = Vec::new();
    eits1::encode(&message, &mut encoded).unwrap();
    assert_eq!(encoded, wire);
    let mut decoded = 0;
    eits1::Decoder::new().push(&wire, &mut |event| {
        assert_eq!(event, eits1::Event::Message(message));
        decoded += 1;
    });
    assert_eq!(decoded, 1);
}

#[test]
fn eits1_bodies_round_trip_and_refuse() {
    let information = eits1::Information {
        electrodes: 16,
        max_measurements: 208,
        max_frame_rate_hz: 50.0,
        full_scale: f32::INFINITY,
        unit: eit_hw::Unit::Volt,
        complex: true,
        name: "skin".into(),
        serial: "0042-\u{b5}".into(),
    };
    let bytes = information.to_bytes();
    assert_eq!(eits1::Information::from_bytes(&bytes), Some(information.clone()));
    for end in 0..bytes.len() {
        assert_eq!(eits1::Information::from_bytes(&bytes[..end]), None);
    }
    let long = eits1::Information { name: "\u{b5}".repeat(200), ..information };
    assert_eq!(eits1::Information::from_bytes(&long.to_bytes()).unwrap().name.len(), 254);

    let quadruples: [Quadruple; 2] = [[0, 1, 2, 3], [1, 2, 3, 255]];
    let configuration = eits1::Configuration::new(&quadruples, 25.0, 1e-4, 5e3).unwrap();
    let bytes = configuration.to_bytes();
    assert_eq!(eits1::Configuration::from_bytes(&bytes), Some(configuration));
    for end in 0..bytes.len() {
        assert_eq!(eits1::Configuration::from_bytes(&bytes[..end]), None);
    }
    let refused = eits1::Configuration::new(&[[0, 1, 2, 256]], 25.0, 1e-4, 0.0).unwrap_err();
    assert_eq!(refused.to_string(), "electrode (from 0) is 256; expected at most 255 for EITS-1");
    assert!(eits1::Configuration::new(&[], 25.0, 1e-4, 0.0).is_err());
}

#[test]
fn eits1_refuses_to_encode_what_cannot_be_read() {
    let message = eits1::Message {
        kind: eits1::Kind::Frame,
        sequence: 0,
        device_time_us: 0,
        flags: eits1::flags::COMPLEX,
        count: 1,
        payload: &[0; 4],
    };
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
    let folder = tempfile::tempdir().unwrap();
    let (source, program) = (folder.path().join("t.c"), folder.path().join("t"));
    let code = r#"
#include "eits1.h"
#include <stdio.h>
int main(void) {
    static uint8_t wire[EITS1_WIRE_BYTES(1024u * 4u + 1024u)];
    static float values[1024];
    static uint8_t quality[1024];
    unsigned count, i;
    size_t n;
    for (count = 0; count <= 1024; count += count < 300 ? 1 : 181) {
        for (i = 0; i < count; i++) {
            values[i] = i % 5 ? (float)i * 0.37f - 20.0f : 0.0f;
            quality[i] = (uint8_t)(i % 64);
        }
        n = eits1_frame(wire, sizeof wire, count, 5000000000ull + count, EITS1_CALIBRATED, values,
                        (uint16_t)count, count % 2 ? quality : NULL);
        if (n == 0) return 1;
        /* one byte of room less is too little */
        if (eits1_frame(wire, n - 1, count, 5000000000ull + count, EITS1_CALIBRATED, values,
                        (uint16_t)count, count % 2 ? quality : NULL) != 0) return 2;
        eits1_frame(wire, sizeof wire, count, 5000000000ull + count, EITS1_CALIBRATED, values,
                    (uint16_t)count, count % 2 ? quality : NULL);
        if (fwrite(wire, 1, n, stdout) != n) return 3;
    }
    if (eits1_frame(wire, sizeof wire, 0, 0, EITS1_COMPLEX, values, 3, NULL) != 0) return 4;
    if (eits1_frame(wire, 0, 0, 0, 0, values, 3, NULL) != 0) return 5;
    n = eits1_message(wire, sizeof wire, EITS1_TEXT, 9, (const uint8_t *)"hello", 5);
    return fwrite(wire, 1, n, stdout) == n ? 0 : 6;
}
"#;
    std::fs::write(&source, code).unwrap();
    let header = concat!(env!("CARGO_MANIFEST_DIR"), "/c");
    let compiler = Command::new("cc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic", "-O1"])
        .args(["-I", header, "-o"])
        .arg(&program)
        .arg(&source)
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
        let values: Vec<f32> = message.values().collect();
        let wanted: Vec<f32> =
            (0..count).map(|i| if i % 5 != 0 { i as f32 * 0.37 - 20.0 } else { 0.0 }).collect();
        // one more rounding where the compiler does not fuse
        assert!(
            values.len() == count && values.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-4)
        );
        let bits: Vec<u16> = message.qualities().map(Quality::bits).collect();
        let flagged = count % 2 == 1;
        let wanted: Vec<u16> =
            (0..count).map(|i| if flagged { (i % 64) as u16 } else { 0 }).collect();
        assert_eq!(bits, wanted);
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
    let hex = "B4 89 01 01 02 00 01 00 00 04 D2 3F800000 BF000000 BF800000 00000000 3E800000 \
        00000000 3EC00000 00000000 3F000000 00000000 3F200000 00000000 3F400000 00000000 3F600000 \
        00000000 3F800000 00000000 3F900000 00000000 3FA00000 00000000 3FB00000 00000000 3FC00000 \
        00000000 3FD00000 00000000 3FE00000 00000000 3FF00000 00000000 B4";
    let digits: String = hex.split_whitespace().collect();
    let wanted: Vec<u8> = (0..digits.len() / 2)
        .map(|i| u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).unwrap())
        .collect();
    assert_eq!(wire, wanted);
    let event = format!("{:?}", sciospec::Event::Data(sciospec_frame()));
    assert_eq!(sciospec_events(&[&wire]), [event]);

    let mut command = Vec::new();
    sciospec::encode(sciospec::TAG_SET_SETUP, &[0x05, 0x3A, 0x83, 0x12, 0x6F], &mut command);
    assert_eq!(command, [0xB0, 0x05, 0x05, 0x3A, 0x83, 0x12, 0x6F, 0xB0]);
    let info = [0xD1, 0x0A, 1, 0, 0x19, 1, 0x1F, 0x0A, 7, 1, 0, 0x58, 0xD1, 0x18, 1, 0x83, 0x18];
    let events = sciospec_events(&[&info]);
    assert!(
        events[0].starts_with("Other { tag: 209") && events[1] == "System(Executed)",
        "{events:?}"
    );
}

#[test]
fn sciospec_refuses_data_that_makes_no_sense() {
    let good = sciospec_frame();
    let mut nan = good;
    nan.potentials_v[3][1] = f32::NAN;
    let mut huge = good;
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
fn text_presets_read_what_boards_send() {
    for format in presets() {
        let mut bytes = b"OpenEIT\nmode 3\n".to_vec();
        if matches!(format.framing, Framing::EndLine(_)) {
            bytes.extend(b"Done\n");
        }
        (0..3).for_each(|frame| bytes.extend(board_frame(&format, frame, 7)));
        let mut decoder = text::Decoder::new(format.clone()).unwrap();
        let mut frames = 0;
        decoder.push(&bytes, &mut |event| match event {
            text::Event::Frame { values, imaginary, quality } => {
                let step = if format.complex { 2 } else { 1 };
                for (index, value) in values.iter().enumerate() {
                    assert_eq!(*value, (7 * step * index + frames) as f64, "{format:?}");
                }
                assert_eq!(imaginary.len(), if format.complex { values.len() } else { 0 });
                assert_eq!((values.len(), quality.len()), (format.measurements(), values.len()));
                frames += 1;
            }
            text::Event::Line(line) => assert!(line == "OpenEIT" || line == "mode 3", "{line}"),
            // the first line of an unmarked stream may be incomplete
            text::Event::Skipped(
                Fault::TruncatedStart | Fault::NotANumber { .. } | Fault::Values { .. },
            ) => {
                assert_eq!(format.framing, Framing::Lines);
            }
            text::Event::Skipped(fault) => panic!("{fault:?}"),
        });
        assert_eq!(frames, 3, "{format:?}");
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

#[test]
fn text_flags_and_faults() {
    let format = TextFormat::open_eit(8).unwrap();
    let mut values = vec!["     1.0000"; 32];
    values[1] = "       0.0000";
    values[2] = "134217727.9375";
    let line = |values: &[&str]| format!("magnitudes: {},\r\n", values.join(","));
    let mut decoder = text::Decoder::new(format.clone()).unwrap();
    decoder.reset(true);
    let mut seen = Vec::new();
    let mut bytes = line(&values);
    bytes += &line(&values[..31]);
    bytes += "magnitudes: FAILED Impedance Measurement\r\n";
    bytes += &line(&values).replace("     1.0000,     1.0000", "     1.0000     1.0000x");
    decoder.push(bytes.as_bytes(), &mut |event| match event {
        text::Event::Frame { quality, .. } => {
            assert_eq!(quality[..3], [Quality::GOOD, Quality::OPEN, Quality::SATURATED]);
            seen.push(None);
        }
        text::Event::Skipped(fault) => seen.push(Some(fault)),
        text::Event::Line(line) => assert!(line.contains("FAILED"), "{line}"),
    });
    assert_eq!(seen.len(), 3, "{seen:?}");
    assert_eq!(seen[0], None);
    assert_eq!(seen[1], Some(Fault::Values { found: 31, wanted: 32 }));
    assert!(matches!(seen[2], Some(Fault::NotANumber { .. })));

    let long = vec![b'1'; 3 * text::MAX_LINE_BYTES];
    let events = text_events(&TextFormat::csv(1), &[b"0\n", &long, b"\n5\n"]);
    assert_eq!(events.len(), 3, "{events:?}");
    assert_eq!(events[1], "Skipped(TooLong)");
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

/// Bytes that resemble each protocol: complete frames, truncated frames, garbage.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let eits1 = (any::<u32>(), prop::collection::vec(any::<f32>(), 0..20))
        .prop_map(|(sequence, values)| eits1_frame(sequence, 7, &values));
    let mut data = Vec::new();
    sciospec::encode_data(&sciospec_frame(), &mut data);
    data.extend([0x18, 1, 0x83, 0x18]);
    let boards: Vec<Vec<u8>> = presets().iter().map(|format| board_frame(format, 0, 7)).collect();
    let piece = prop_oneof![
        eits1,
        Just(data),
        prop::sample::select(boards),
        prop::collection::vec(any::<u8>(), 0..50),
    ];
    let cut =
        (piece, any::<prop::sample::Index>(), any::<bool>()).prop_map(|(mut piece, at, cut)| {
            if cut && !piece.is_empty() {
                piece.truncate(at.index(piece.len()));
            }
            piece
        });
    prop::collection::vec(cut, 0..8).prop_map(|pieces| pieces.concat())
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    /// No decoder panics, and the events do not depend on how the bytes are split.
    #[test]
    fn events_do_not_depend_on_the_pieces(bytes in stream(), sizes in prop::collection::vec(1_usize..40, 1..60)) {
        let mut pieces: Vec<&[u8]> = Vec::new();
        let (mut rest, mut sizes) = (&bytes[..], sizes.iter().cycle());
        while !rest.is_empty() {
            let (piece, after) = rest.split_at(rest.len().min(*sizes.next().unwrap()));
            pieces.push(piece);
            rest = after;
        }
        prop_assert_eq!(eits1_events(&[&bytes]), eits1_events(&pieces));
        prop_assert_eq!(sciospec_events(&[&bytes]), sciospec_events(&pieces));
        for format in presets() {
            prop_assert_eq!(text_events(&format, &[&bytes]), text_events(&format, &pieces));
        }
    }
}

/// The bytes of a real serial line give a reader of files and a driver the same frames.
#[test]
fn a_recorded_serial_line_gives_the_frames_of_its_log() {
    let Some(folder) = fixtures::shared_data("umitooko_serial16") else { return };
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.extension().is_none_or(|ending| ending != "txt") {
            continue;
        }
        let bytes = std::fs::read(&path).unwrap();
        let Ok(log) = parse(eit_hw::Format::SerialLog, &bytes, &Default::default()) else {
            continue;
        };
        let mut known: Vec<Vec<f64>> =
            log.real.rows().into_iter().map(|row| row.to_vec()).collect();
        let (mut same, mut frames, mut skipped) = (0, 0, 0);
        let mut decoder = text::Decoder::new(TextFormat::serial_16()).unwrap();
        decoder.push(&bytes, &mut |event| match event {
            text::Event::Frame { values, .. } => {
                frames += 1;
                if let Some(at) = known.iter().position(|known| known == values) {
                    known.swap_remove(at);
                    same += 1;
                }
            }
            text::Event::Skipped(_) => skipped += 1,
            text::Event::Line(_) => {}
        });
        println!(
            "{name}: log {}, decoder {frames}, same {same}, skipped {skipped}",
            log.frame_count()
        );
        // the reader also accepts the reference and frames on one line, which have no `s`
        assert!(same == frames || frames - same <= skipped + log.skipped.frames, "{name}");
        files += 1;
    }
    assert!(files > 0);
}
