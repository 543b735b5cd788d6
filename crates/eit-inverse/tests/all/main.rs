//! Tests of the crate, in one program, which links faster than one for each file. Those of one file:
//! `cargo test --release -p eit-inverse --test all FILE::`.
#![allow(missing_docs, clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests")]

/// Checks that a result is an error of this kind.
macro_rules! refused {
    ($result:expr, $($error:tt)+) => {
        let error = $result.err().unwrap();
        assert!(matches!(error, eit_inverse::InverseError::$($error)+), "{error}");
    };
}

mod common;
#[cfg(feature = "st-tv")]
#[path = "common/problem.rs"]
mod problem;

mod calibration;
mod data;
mod difference;
mod examples;
mod figures_of_merit;
#[cfg(feature = "st-tv")]
mod gradient;
mod hyperparameter;
mod masked;
mod noise_estimate;
mod nuisance;
mod prior;
mod sequence;
#[cfg(all(feature = "serde", feature = "st-tv"))]
mod serde;
#[cfg(feature = "st-tv")]
mod st_tv_batch;
#[cfg(feature = "st-tv")]
mod st_tv_causal;
#[cfg(feature = "st-tv")]
mod st_tv_certificate;
#[cfg(feature = "st-tv")]
mod st_tv_stability;
mod touch_detector;
mod touch_detector_input;
#[cfg(feature = "learn")]
mod touch_learnt;
mod touch_tracker;
mod unevenness;
