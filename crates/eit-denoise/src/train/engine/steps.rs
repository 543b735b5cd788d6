//! What every engine does.

use crate::DenoiseError;
use crate::train::examples::Examples;
use std::fmt;

/// What an engine does. Lengths, sizes and indices have been checked.
pub(super) trait Steps: fmt::Debug {
    /// Takes parameters over.
    fn load(&mut self, parameters: &[f32]) -> Result<(), DenoiseError>;

    /// Sum of errors, and the derivative of their mean.
    fn step(&mut self, examples: &Examples, batch: &[usize])
    -> Result<(f64, &[f32]), DenoiseError>;

    /// Sum of errors.
    fn error(&mut self, examples: &Examples, batch: &[usize]) -> Result<f64, DenoiseError>;
}
