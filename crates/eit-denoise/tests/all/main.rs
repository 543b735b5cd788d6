//! All tests in one program, to link fast. Those of a file: `cargo test -p eit-denoise --test all FILE::`.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests")]

/// Checks that a result is an error of this kind.
macro_rules! refused {
    ($result:expr, $($error:tt)+) => {
        let error = $result.err().unwrap();
        assert!(matches!(error, eit_denoise::DenoiseError::$($error)+), "{error}");
    };
}

/// Checks that the message of an error contains these words.
#[cfg(feature = "unet")]
#[track_caller]
fn says<T>(result: Result<T, eit_denoise::DenoiseError>, words: &str) {
    let message = result.err().unwrap().to_string();
    assert!(message.contains(words), "{message}");
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
