//! The fault matrix: what can go wrong between an instrument and its host. Tests are named after the rows and require
//! no panic, no endless wait, no wrong frame reported as good, correct counters, and frames again after a bounded loss.
//!
//! `bytes.rs`: 1 reads split anywhere; 2 a byte dropped, inserted, flipped or doubled at each offset of a frame; 3 truncated at
//! the end of the stream; 4 tags in the payload, a whole fake frame in it, start in the middle; 14 text: value missing, comma too
//! many, not ASCII, too long, line ends, wrong count; 15 every bit of a message flipped, a million bytes of garbage.
//!
//! `session.rs`: 5 leftover bytes on opening: an old stream, half a frame, boot text; 6 acknowledgement lost, late, negative, data
//! before it, hold-up, reset in the stream; 8 unplugged before, in and after a frame, during a command, new path or instrument;
//! 9 slow consumer, consumer gone; 10 no data, bytes arrive one by one, a command with a pause in it.
//!
//! `values.rs`: 7 channel groups and excitations missing, doubled, reordered, too many, changed row; 11 NaN, infinity, subnormal,
//! out of range, rail, zero, stuck; 12 an electrode off: open input, its rows and columns, reciprocity; 13 clocks that wrap;
//! 16 what no checksum reveals.

mod bytes;
mod session;
mod values;
