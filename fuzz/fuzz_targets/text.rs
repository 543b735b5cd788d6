//! Text boards, every framing: no input panics, the events do not depend on how the bytes are
//! split, and a frame has the right number of finite values.
#![no_main]

use eit_hw::codec::text::{Decoder, Event, Framing, Number, TextFormat};
use libfuzzer_sys::fuzz_target;

fn format(choice: u8) -> TextFormat {
    let small = |framing, lines_per_frame, values_per_line| TextFormat {
        framing,
        lines_per_frame,
        values_per_line,
        ..TextFormat::default()
    };
    let format = match choice % 4 {
        0 => small(Framing::Lines, 1, 2),
        1 => small(Framing::StartLine("s".into()), 2, 2),
        2 => small(Framing::Prefix("V".into()), 1, 2),
        _ => small(Framing::EndLine("D".into()), 2, 2),
    };
    let number = match choice / 4 % 3 {
        0 => Number::Decimal,
        1 => Number::HexInteger,
        _ => Number::HexFloat,
    };
    TextFormat { number, complex: choice & 128 != 0, ..format }
}

fn events(format: &TextFormat, pieces: &[&[u8]]) -> Vec<String> {
    let mut decoder = Decoder::new(format.clone()).expect("a valid format");
    let mut events = Vec::new();
    for piece in pieces {
        decoder.push(piece, &mut |event| {
            if let Event::Frame { values, imaginary, quality } = &event {
                assert_eq!(values.len(), format.measurements());
                assert_eq!(quality.len(), values.len());
                assert!(values.iter().chain(imaginary.iter()).all(|value| value.is_finite()));
            }
            events.push(format!("{event:?}"));
        });
    }
    events
}

fuzz_target!(|data: &[u8]| {
    let Some((&first, data)) = data.split_first() else { return };
    let format = format(first);
    let whole = events(&format, &[data]);
    let cut = usize::from(first) * data.len() / 256;
    assert_eq!(events(&format, &[&data[..cut], &data[cut..]]), whole);
});
