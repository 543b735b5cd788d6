//! Places learnt from presses of real skins: learnt from the first presses in time, tested on the rest.
//!
//! Every number printed here stands in `docs/VALIDATION.md`. The data is read in place.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

#[path = "learn/hydrogel.rs"]
mod hydrogel;
