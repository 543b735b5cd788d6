//! Tests of the crate, in one program: linking one is faster than linking 11. Those of one file:
//! `cargo test --release -p eit-mesh --test all FILE::`.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "tests"
)]

/// Checks that a result is an error of this pattern.
macro_rules! assert_error {
    ($result:expr, $($pattern:tt)+) => {{
        let error = $result.map(|_| ()).unwrap_err();
        assert!(matches!(error, $($pattern)+), "{error}");
    }};
}

mod surfaces;

mod electrode;
mod examples;
mod generate;
mod gmsh;
mod patches;
mod placed;
mod raster;
#[cfg(feature = "serde")]
mod serde;
mod surface_files;
mod vtu;
