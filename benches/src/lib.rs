//! What only this project's developers run: timings, comparisons with other software, and figures of
//! touches, images and nets on simulated skins. Not published.
//!
//! `cargo bench -p benches` times every stage. The programs write the tables of `docs/PERFORMANCE.md`
//! (`benches/compare.py`, `compare_images.py`, `compare_unet.py`, `adopt`, `plan_check`, `touches`,
//! `lean`, `growth`, `equal_frame`), or print those of `docs/validation` (`touches`, `quality`,
//! `denoise`).

pub mod document;
pub mod faer_cholesky;
pub mod limits;
pub mod problem;
pub mod recording;
pub mod stopwatch;
pub mod table;
pub mod touches;

/// Result of bench code, with errors of any crate, because nothing here handles them.
pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The project's README, whose Rust code is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct ReadmeExamples;

/// The guide to a skin of one's own, likewise.
#[cfg(doctest)]
#[doc = include_str!("../../docs/BUILD_A_SKIN.md")]
pub struct GuideExamples;
