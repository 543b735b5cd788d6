//! EITS-1: no input panics, and the events do not depend on how the bytes are split.
#![no_main]

use eit_hw::codec::eits1::{Configuration, Decoder, Event, Information};
use libfuzzer_sys::fuzz_target;

fn events(pieces: &[&[u8]]) -> Vec<String> {
    let (mut decoder, mut events) = (Decoder::new(), Vec::new());
    for piece in pieces {
        decoder.push(piece, &mut |event| {
            if let Event::Message(message) = &event {
                assert!(message.values().count() <= usize::from(message.count));
                assert_eq!(message.qualities().count(), message.measurements());
                // whatever decodes encodes to the same bytes
                if let Some(found) = Configuration::from_bytes(message.payload) {
                    assert_eq!(found.to_bytes(), message.payload);
                }
                if let Some(found) = Information::from_bytes(message.payload) {
                    assert_eq!(found.to_bytes(), message.payload);
                }
            }
            events.push(format!("{event:?}"));
        });
    }
    events
}

fuzz_target!(|data: &[u8]| {
    let whole = events(&[data]);
    let cut = data.first().map_or(0, |&byte| usize::from(byte) * data.len() / 256);
    assert_eq!(events(&[&data[..cut], &data[cut..]]), whole);
    assert_eq!(events(&data.chunks(1).collect::<Vec<_>>()), whole);
});
