//! Tests of the crate, in one program: linking one is faster than linking 11. Those of one file:
//! `cargo test --release -p eit-mesh --test all FILE::`.

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
mod shared;
mod surface_files;
mod vtu;
