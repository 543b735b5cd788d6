//! Images on one raster with one mask: what goes into a denoiser, and what comes out.

use crate::DenoiseError;
use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis};

/// Images [frame, row, column] of one skin, row 0 at the top (largest y), with the mask of pixels
/// that lie on the skin.
///
/// Valid once built: images and mask agree in size, the mask is not empty, pixels inside it are
/// finite, and pixels outside are NaN. A stack may have no frame. The unit of the values is the
/// caller's (siemens for a change of conductivity).
///
/// Because of the NaN, a stack is not equal to itself; compare pixels inside the mask.
#[derive(Debug, Clone)]
pub struct ImageStack {
    values: Array3<f64>,
    mask: Array2<bool>,
}

impl ImageStack {
    /// Images [frame, row, column] and their mask [row, column]. Whatever stands outside the mask
    /// becomes NaN.
    ///
    /// # Errors
    /// [`DenoiseError::ShapeMismatch`], [`DenoiseError::EmptyMask`],
    /// [`DenoiseError::NonFinitePixel`] (the first in order of frame, row, column).
    pub fn new(mut values: Array3<f64>, mask: Array2<bool>) -> Result<Self, DenoiseError> {
        let (_, rows, columns) = values.dim();
        if (rows, columns) != mask.dim() {
            let (images, mask) = ([rows, columns], [mask.nrows(), mask.ncols()]);
            return Err(DenoiseError::ShapeMismatch { images, mask });
        }
        if !mask.iter().any(|&inside| inside) {
            return Err(DenoiseError::EmptyMask { rows, columns });
        }
        for ((frame, row, column), value) in values.indexed_iter_mut() {
            if !mask[[row, column]] {
                *value = f64::NAN;
            } else if !value.is_finite() {
                let value = *value;
                return Err(DenoiseError::NonFinitePixel { frame, row, column, value });
            }
        }
        Ok(Self { values, mask })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.values.dim().0
    }

    /// Rows of each image.
    pub fn rows(&self) -> usize {
        self.mask.nrows()
    }

    /// Columns of each image.
    pub fn columns(&self) -> usize {
        self.mask.ncols()
    }

    /// All values [frame, row, column], NaN outside the mask.
    pub fn values(&self) -> ArrayView3<'_, f64> {
        self.values.view()
    }

    /// Pixels on the skin [row, column].
    pub fn mask(&self) -> ArrayView2<'_, bool> {
        self.mask.view()
    }

    /// One image [row, column], counted from 0.
    ///
    /// # Errors
    /// [`DenoiseError::UnknownFrame`].
    pub fn frame(&self, frame: usize) -> Result<ArrayView2<'_, f64>, DenoiseError> {
        let frames = self.frames();
        if frame >= frames {
            return Err(DenoiseError::UnknownFrame { frame, frames });
        }
        Ok(self.values.index_axis(Axis(0), frame))
    }

    /// The images [row, column] in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = ArrayView2<'_, f64>> {
        self.values.outer_iter()
    }

    /// Largest magnitude inside the mask over all frames; 0 for a stack without frames. The scale
    /// that makes the values of one recording comparable with another's.
    pub fn max_abs(&self) -> f64 {
        // NaN outside the mask is never the larger one
        self.values.iter().fold(0.0, |largest, value| value.abs().max(largest))
    }

    /// The values [frame, row, column] and the mask [row, column].
    pub fn into_parts(self) -> (Array3<f64>, Array2<bool>) {
        (self.values, self.mask)
    }
}
