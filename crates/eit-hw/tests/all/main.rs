//! All tests in one program, to link fast. Those of a file: `cargo test -p eit-hw --test all FILE::`.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests")]

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
