//! All tests in one program, to link fast. Those of a file: `cargo test -p eit-mesh --test all FILE::`.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests")]

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
