//! Sciospec, both sides: no input panics, the events do not depend on how the bytes are split, and
//! no implausible data are reported.
#![no_main]

use eit_hw::codec::sciospec::{Decoder, Event, Output};
use eit_hw::driver::{Driver, Decoded, Sciospec, SciospecSettings};
use libfuzzer_sys::fuzz_target;

fn events(mut decoder: Decoder, pieces: &[&[u8]]) -> Vec<String> {
    let mut events = Vec::new();
    for piece in pieces {
        decoder.push(piece, &mut |event| {
            if let Event::Data(data) = &event {
                assert!((1..=8).contains(&data.group));
                assert!(data.potentials_v.as_flattened().iter().all(|v| v.abs() <= 20.0));
            }
            events.push(format!("{event:?}"));
        });
    }
    events
}

fuzz_target!(|data: &[u8]| {
    let Some((&first, data)) = data.split_first() else { return };
    let output = Output { drive: first & 1 == 0, frequency_row: first & 2 == 0, time: first & 4 == 0 };
    let decoder = || match first & 8 {
        0 => Decoder::new(output),
        _ => Decoder::of_commands(),
    };
    let whole = events(decoder(), &[data]);
    let cut = usize::from(first) * data.len() / 256;
    assert_eq!(events(decoder(), &[&data[..cut], &data[cut..]]), whole);
    // frames assembled by the driver have the right number of values
    let quadruples = [[0, 1, 2, 3], [1, 2, 3, 4]];
    let settings = SciospecSettings::for_quadruples(20, &quadruples);
    let Ok(mut driver) = Sciospec::new(settings) else { return };
    driver.receive(data, &mut |decoded| {
        if let Decoded::Frame(frame) = decoded {
            assert_eq!((frame.values.len(), frame.quality.len()), (40, 40));
        }
    });
});
