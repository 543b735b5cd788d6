//! Removes electrode movement frame by frame.

use crate::error::SkinError;
use crate::scene::DifferenceKind;
use eit_inverse::NuisanceParameters;

/// Removes electrode movement from a frame.
#[derive(Debug, Clone)]
pub(crate) struct Whitening {
    side: NuisanceParameters,
    kind: DifferenceKind,
    used: Vec<usize>,
    /// `[measurement]`; zero where not used.
    differences: Vec<f64>,
    /// `[used measurement]`.
    white: Vec<f64>,
}

impl Whitening {
    /// Creates the operator for frames in which these measurements are used.
    pub(crate) fn new(side: NuisanceParameters, kind: DifferenceKind, used: &[bool]) -> Self {
        let differences = vec![0.0; used.len()];
        let used: Vec<usize> = (0..used.len()).filter(|&i| used[i]).collect();
        Self { side, kind, white: vec![0.0; used.len()], used, differences }
    }

    /// Returns a frame's white differences without movement, `[used measurement]`.
    pub(crate) fn of(&mut self, values: &[f64], reference: &[f64]) -> Result<&[f64], SkinError> {
        for &i in &self.used {
            self.differences[i] = self.kind.difference(values[i], reference[i]);
        }
        self.side.whiten(&mut self.differences)?;
        self.white.iter_mut().zip(&self.used).for_each(|(white, &i)| *white = self.differences[i]);
        Ok(&self.white)
    }
}
