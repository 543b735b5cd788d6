//! Tests of the crate, in one program: linking one is faster than linking 9. Those of one file:
//! `cargo test --release -p eit-denoise --test all FILE::`.

#[cfg(feature = "unet")]
mod common;

mod burn_net;
mod data_consistency;
mod examples;
mod image_stack;
mod learning_base;
mod rules;
#[cfg(all(feature = "serde", feature = "base"))]
mod serde;
mod train;
mod unet;
