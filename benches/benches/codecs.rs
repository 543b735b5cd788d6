//! Decoding of live streams, in bytes per second on one core: 208 measurements per frame, in pieces
//! of 4 KiB as a port delivers them.
#![allow(clippy::expect_used, reason = "a stage that fails must end the bench, not be timed")]

use criterion::{Criterion, Throughput};
use eit_hw::codec::{eits1, sciospec, text};
use std::hint::black_box;
use std::time::Duration;

/// Bytes per read.
const PIECE: usize = 4096;
/// Frames per stream.
const FRAMES: u32 = 100;

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args();
    let wire = eits1_stream();
    let mut decoder = eits1::Decoder::new();
    bench(&mut criterion, "eits1, complex", &wire, |piece, frames| {
        decoder.push(piece, &mut |event| {
            *frames += u32::from(matches!(event, eits1::Event::Message(_)));
        });
    });
    let wire = sciospec_stream();
    let mut decoder = sciospec::Decoder::new(sciospec::Output::default());
    bench(&mut criterion, "sciospec, 16 electrodes", &wire, |piece, frames| {
        decoder.push(piece, &mut |event| {
            *frames += u32::from(matches!(event, sciospec::Event::Data(_)));
        });
    });
    let mut formats = vec![
        ("text, decimals", text::TextFormat::csv(208)),
        ("text, black_sensor", text::TextFormat::black_sensor()),
        ("text, CN0565", text::TextFormat::cn0565()),
    ];
    for (name, format) in formats.drain(..) {
        let wire = text_stream(&format);
        let mut decoder = text::Decoder::new(format).expect("a format that can be");
        bench(&mut criterion, name, &wire, |piece, frames| {
            decoder.push(piece, &mut |event| {
                *frames += u32::from(matches!(event, text::Event::Frame { .. }));
            });
        });
    }
    criterion.final_summary();
}

fn bench(
    criterion: &mut Criterion,
    name: &str,
    wire: &[u8],
    mut decode: impl FnMut(&[u8], &mut u32),
) {
    let mut group = criterion.benchmark_group("decode");
    group.throughput(Throughput::Bytes(wire.len() as u64));
    group.bench_function(name, |b| {
        b.iter(|| {
            let mut frames = 0;
            wire.chunks(PIECE).for_each(|piece| decode(black_box(piece), &mut frames));
            assert!(frames + 1 >= FRAMES, "{frames}");
        });
    });
    group.finish();
}

fn value(frame: u32, index: usize) -> f64 {
    (f64::from(frame) + index as f64 * 0.618).sin()
}

fn eits1_stream() -> Vec<u8> {
    let mut wire = Vec::new();
    for sequence in 0..FRAMES {
        let payload: Vec<u8> =
            (0..416).flat_map(|i| (value(sequence, i) as f32).to_le_bytes()).collect();
        let message = eits1::Message {
            kind: eits1::Kind::Frame,
            sequence,
            device_time_us: 1000 * u64::from(sequence),
            flags: eits1::flags::COMPLEX,
            count: 416,
            payload: &payload,
        };
        eits1::encode(&message, &mut wire).expect("a message that fits");
    }
    wire
}

fn sciospec_stream() -> Vec<u8> {
    let mut wire = Vec::new();
    for frame in 0..FRAMES {
        for drive in 1..17 {
            let part = |index| value(frame, index + usize::from(drive)) as f32;
            let data = sciospec::DataFrame {
                group: 1,
                drive: Some([drive, drive % 16 + 1]),
                frequency_row: Some(1),
                time_ms: Some(frame),
                potentials_v: std::array::from_fn(|k| [part(2 * k), part(2 * k + 1)]),
            };
            sciospec::encode_data(&data, &mut wire);
        }
    }
    wire
}

fn text_stream(format: &text::TextFormat) -> Vec<u8> {
    let mut wire = Vec::new();
    let count = format.lines_per_frame * format.values_per_line;
    for frame in 0..FRAMES {
        let numbers: Vec<String> = (0..count)
            .map(|i| match format.number {
                text::Number::Decimal if format.lines_per_frame == 1 => {
                    format!("{:.6e}", value(frame, i))
                }
                _ => format.number.write((1e4 * value(frame, i)).round()),
            })
            .collect();
        if let text::Framing::StartLine(mark) = &format.framing {
            wire.extend(format!("{mark}\n").bytes());
        }
        for line in numbers.chunks(format.values_per_line) {
            if let text::Framing::Prefix(mark) = &format.framing {
                wire.extend(format!("{mark} ").bytes());
            }
            wire.extend(format!("{}\r\n", line.join(",")).bytes());
        }
    }
    wire
}
