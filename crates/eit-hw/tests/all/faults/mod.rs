//! The fault matrix: what can go wrong between an instrument and its host. Tests are named after the rows and require
//! no panic, no endless wait, no wrong frame reported as good, correct counters, and frames again after a bounded loss.
//!
//! | row | faults | file |
//! |---|---|---|
//! | 1 | reads split anywhere | `bytes.rs` |
//! | 2 | a byte dropped, inserted, flipped or doubled at each offset of a frame | `bytes.rs` |
//! | 3 | wrong length, wrong end tag, truncated at the end of the stream | `bytes.rs` |
//! | 4 | tags in the payload, a whole fake frame in it, start in the middle | `bytes.rs` |
//! | 5 | leftover bytes on opening: an old stream, half a frame, boot text | `session.rs` |
//! | 6 | acknowledgement lost, late, negative; data before it; hold-up; reset in the stream | `session.rs` |
//! | 7 | channel groups and excitations missing, doubled, reordered, too many; changed row | `values.rs` |
//! | 8 | unplugged before, in and after a frame, during a command; new path or instrument | `session.rs` |
//! | 9 | slow consumer, consumer gone | `session.rs` |
//! | 10 | no data; bytes arrive one by one; a command with a pause in it | `session.rs` |
//! | 11 | NaN, infinity, subnormal, out of range, rail, zero, stuck, codes of OpenEIT | `values.rs` |
//! | 12 | an electrode off: open input, its rows and columns, reciprocity | `values.rs` |
//! | 13 | sequence and clock that wrap, a clock that goes back | `values.rs` |
//! | 14 | text: value missing, comma too many, not ASCII, too long, line ends, wrong count | `bytes.rs` |
//! | 15 | every bit of a message flipped; a million bytes of garbage | `bytes.rs` |
//! | 16 | what no checksum reveals | `values.rs` |

mod bytes;
mod session;
mod values;
