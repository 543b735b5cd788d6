//! All tests in one program, to link fast. Those of a file: `cargo test -p eit-fem --test all FILE::`.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests")]

mod common;

mod accurate;
#[cfg(feature = "complex")]
mod admittivity;
mod allocations;
mod anisotropy;
mod bad_input;
mod convergence;
mod curved;
mod derivatives;
mod determinism;
mod examples;
#[cfg(feature = "fabric")]
mod fabric;
#[cfg(feature = "fabric")]
mod fabric_curved;
#[cfg(feature = "fabric")]
mod fabric_linear;
#[cfg(feature = "fabric")]
mod fabric_parts;
#[cfg(feature = "fabric")]
mod fabric_paths;
#[cfg(feature = "fabric")]
mod fabric_rough;
#[cfg(feature = "fabric")]
mod fabric_step;
mod geometry;
mod jacobian;
mod mesh_choice;
mod properties;
mod protocol;
mod quadratic;
mod quadratic_rates;
#[cfg(feature = "serde")]
mod serde;
mod sparse;
