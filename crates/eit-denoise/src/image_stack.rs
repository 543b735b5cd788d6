//! Images on one raster with one mask: inputs and results of denoisers.

use crate::DenoiseError;
use ndarray::iter::AxisIter;
use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis, Ix2};

/// Images [frame, row, column] of one skin, row 0 at the top (largest y), with the mask of pixels
/// that lie on the skin.
///
/// Every stack is valid: images and mask agree in size, the mask is not empty, pixels inside it are
/// finite, and pixels outside are NaN. A stack may have no frames. The caller chooses the unit of the
/// values (siemens for a change of conductivity).
///
/// Because of the NaN values, a stack is not equal to itself; compare pixels inside the mask.
///
/// ```
/// use eit_denoise::ImageStack;
/// use ndarray::{Array2, Array3};
///
/// // three images of 4 x 4 pixels, the corner pixel off the skin
/// let mut mask = Array2::from_elem((4, 4), true);
/// mask[[0, 0]] = false;
/// let stack = ImageStack::new(Array3::zeros((3, 4, 4)), mask)?;
/// assert_eq!((stack.frames(), stack.rows(), stack.columns()), (3, 4, 4));
/// assert!(stack.frame(0)?[[0, 0]].is_nan());
/// # Ok::<(), eit_denoise::DenoiseError>(())
/// ```
#[derive(Debug, Clone)]
pub struct ImageStack {
    values: Array3<f64>,
    mask: Array2<bool>,
}

impl ImageStack {
    /// Builds a stack from images [frame, row, column] and their mask [row, column]. Pixels outside the
    /// mask become NaN.
    ///
    /// # Errors
    /// [`DenoiseError::ShapeMismatch`], [`DenoiseError::EmptyMask`],
    /// [`DenoiseError::NonFinitePixel`] (the first in order of frame, row, column).
    pub fn new(mut values: Array3<f64>, mask: Array2<bool>) -> Result<Self, DenoiseError> {
        let (_, rows, columns) = values.dim();
        DenoiseError::check_size((rows, columns), mask.dim())?;
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

    /// Number of rows of each image.
    pub fn rows(&self) -> usize {
        self.mask.nrows()
    }

    /// Number of columns of each image.
    pub fn columns(&self) -> usize {
        self.mask.ncols()
    }

    /// Returns all values [frame, row, column], NaN outside the mask.
    pub fn values(&self) -> ArrayView3<'_, f64> {
        self.values.view()
    }

    /// Returns the mask [row, column]: true on the skin.
    pub fn mask(&self) -> ArrayView2<'_, bool> {
        self.mask.view()
    }

    /// Returns the image [row, column] of a frame, counted from 0.
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

    /// Iterates over the images [row, column] in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = ArrayView2<'_, f64>> {
        self.values.outer_iter()
    }

    /// Returns the largest magnitude inside the mask over all frames; 0 for a stack without frames. Divide by
    /// it to compare recordings.
    pub fn max_abs(&self) -> f64 {
        // `max` ignores NaN outside the mask
        self.values.iter().fold(0.0, |largest, value| value.abs().max(largest))
    }

    /// Returns the values [frame, row, column] and the mask [row, column].
    pub fn into_parts(self) -> (Array3<f64>, Array2<bool>) {
        (self.values, self.mask)
    }
}

/// Images [row, column] in order.
///
/// ```
/// use eit_denoise::ImageStack;
/// use ndarray::{Array2, Array3};
///
/// let stack = ImageStack::new(Array3::zeros((3, 4, 4)), Array2::from_elem((4, 4), true))?;
/// for image in &stack {
///     assert_eq!(image.dim(), (4, 4));
/// }
/// # Ok::<(), eit_denoise::DenoiseError>(())
/// ```
impl<'a> IntoIterator for &'a ImageStack {
    type Item = ArrayView2<'a, f64>;
    type IntoIter = AxisIter<'a, f64, Ix2>;

    fn into_iter(self) -> Self::IntoIter {
        self.values.outer_iter()
    }
}
