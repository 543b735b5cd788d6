//! Tests of the crate, in one program: linking one is faster than linking 15. Those of one file:
//! `cargo test --release -p eit-skin --test all FILE::`.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests")]

mod common;
#[path = "common/voltages.rs"]
mod voltages;

#[cfg(feature = "denoise")]
mod denoised;
mod faults;
mod health;
mod hemisphere;
#[cfg(feature = "learn")]
mod learn;
#[cfg(feature = "learn")]
mod learned_touches;
mod live_images;
mod noise_figure;
mod one_score;
mod other_skins;
#[cfg(feature = "mint")]
mod serde;
mod shared;
mod simulated;
mod stream_faults;
mod touches;
mod trouble;
mod undecided;
mod weave;
