//! Positions learnt from presses on real skins: learnt from the first presses in time, tested on the rest.
//!
//! Every number printed here is listed in `docs/validation/learning.md`. The data are read in place.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

#[path = "learn/hydrogel.rs"]
mod hydrogel;
