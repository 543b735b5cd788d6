//! What the benches and the comparison with peers share: problems, stopwatch, machine limits.
//!
//! Not published. `cargo bench -p benches` times every stage; `benches/compare.py` times forward
//! problem and Jacobian against the peers and writes the tables of `docs/PERFORMANCE.md`; `lean`,
//! `growth` and `equal_frame` write theirs themselves.

pub mod document;
pub mod faer_cholesky;
pub mod limits;
pub mod problem;
pub mod stopwatch;

/// Results of bench code; errors of any crate, since nothing here acts on them.
pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The project's README: its Rust code is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct ReadmeExamples;
