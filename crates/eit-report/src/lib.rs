#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

pub mod comparison;
pub mod convert;
pub mod curve;
pub mod demo;
pub mod denoised;
mod error;
mod html;
pub mod learnt;
pub mod output;
pub mod reconstruct;
pub mod report;
pub mod settings;
pub mod simulated;
pub mod solve;
pub mod watched;

pub use error::ReportError;

use serde_json::Value;

/// The result of a command.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Text for the terminal.
    pub text: String,
    /// A JSON object for programs.
    pub json: Value,
}

/// Returns the text of an answer followed by its warning, if there is one.
pub fn with_warning(text: String, warning: Option<&String>) -> String {
    match warning {
        Some(warning) => format!("{text}\nwarning: {warning}"),
        None => text,
    }
}
