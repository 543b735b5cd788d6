//! Tests of the crate, in one program; those of one file: `cargo test --release -p eit-publish --test all FILE::`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

mod common;

#[cfg(feature = "zenoh")]
mod body;
#[cfg(feature = "foxglove")]
mod foxglove_sink;
mod publisher;
#[cfg(feature = "zenoh")]
mod ros;
#[cfg(feature = "web")]
mod web;
#[cfg(feature = "zenoh")]
mod zenoh_sink;
