//! Tests of the crate, in one program: linking one is faster than linking 17. Those of one file:
//! `cargo test --release -p eit-hw --test all FILE::`.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests: a panic is a failed test"
)]

mod common;

mod allocations;
mod arrays;
mod bad_input;
mod capture;
mod codec;
mod damage;
mod examples;
mod faults;
mod foreign;
mod health;
mod live;
mod memory;
mod parts;
mod properties;
mod real_data;
mod selection;
#[cfg(feature = "serde")]
mod serde;
mod shared;
