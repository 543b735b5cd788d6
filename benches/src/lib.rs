//! Problems, stopwatch and machine limits shared by the benches and the comparison with peers.
//!
//! Not published. `cargo bench -p benches` times every stage; `benches/compare.py` compares the
//! times of forward problem and Jacobian with the peers' and writes the tables of
//! `docs/PERFORMANCE.md`; `lean`, `growth` and `equal_frame` write their own tables.

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
