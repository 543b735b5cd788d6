#![doc = include_str!("../README.md")]
#![allow(missing_docs)]

pub mod demo;
mod error;
pub mod html;
pub mod output;
pub mod reconstruct;
pub mod report;
pub mod settings;
pub mod simulate;
pub mod watched;

pub use error::ReportError;

use serde_json::Value;

/// What a report found.
#[derive(Debug, Clone)]
pub struct Answer {
    /// For people.
    pub text: String,
    /// For programs: one object.
    pub json: Value,
}
