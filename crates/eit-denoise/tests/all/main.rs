//! Tests of the crate, in one program, which links faster than one for each file. Those of one file:
//! `cargo test --release -p eit-denoise --test all FILE::`.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests: a panic is a failed test"
)]

/// Checks that a result is an error of this kind.
macro_rules! refused {
    ($result:expr, $($error:tt)+) => {
        let error = $result.err().unwrap();
        assert!(matches!(error, eit_denoise::DenoiseError::$($error)+), "{error}");
    };
}

#[cfg(feature = "unet")]
mod common;

mod burn_net;
mod data_consistency;
mod examples;
mod image_stack;
mod learning_base;
#[cfg(feature = "unet")]
mod rules;
#[cfg(all(feature = "serde", feature = "base"))]
mod serde;
mod train;
mod unet;
