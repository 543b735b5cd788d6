//! The paper's rule for a wanted image where no truth is known: what survives a threshold.

use crate::{DenoiseError, ImageStack};
use ndarray::{Array2, ArrayView2, ArrayViewMut2, Axis};

/// Makes a wanted image out of a raw one, as Duan, Taurand and Soleimani (Sci. Rep. 9:8831, 2019)
/// made theirs: artefacts of electrode movement lie on the rim and are small, so the ring along
/// the rim is taken out, then what is not above a share of the maximum, then what is too small for
/// a finger.
///
/// Only a rise of conductivity is kept, as pressure on the paper's fabric makes it; turn the sign
/// of images where touches lower it. It is a rule, not a truth: a finger on the rim is lost, and of
/// two fingers the weaker one where it has less than the share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThresholdRule {
    /// Pixels within this many steps (eight neighbours) of the outside are taken out. The paper
    /// states no width; 4 of 64 pixels is what its figures look like.
    pub ring_pixels: usize,
    /// Kept is what exceeds this part of the largest value left, 0 to below 1. The paper's 0.55.
    pub share: f64,
    /// Blobs (eight neighbours) of fewer pixels are dropped. The paper's 15.
    pub least_pixels: usize,
}

impl Default for ThresholdRule {
    fn default() -> Self {
        Self { ring_pixels: 4, share: 0.55, least_pixels: 15 }
    }
}

impl ThresholdRule {
    /// The rule for one skin; what depends on the mask [row, column] alone is computed here.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`] for the share, [`DenoiseError::EmptyMask`] where the ring
    /// leaves no pixel.
    pub fn on(&self, mask: ArrayView2<'_, bool>) -> Result<Threshold, DenoiseError> {
        if !(0.0..1.0).contains(&self.share) {
            let (quantity, must) = ("share", "at least 0 and below 1");
            return Err(DenoiseError::OutOfRange { quantity, value: self.share, must });
        }
        let (rows, columns) = mask.dim();
        let mut inner = mask.to_owned();
        for _ in 0..self.ring_pixels {
            let before = inner.clone();
            inner = Array2::from_shape_fn((rows, columns), |(row, column)| {
                let around = neighbours([row, column], [rows, columns]);
                // beyond the raster is outside
                before[[row, column]] && around.filter(|pixel| before[*pixel]).count() == 8
            });
        }
        if !inner.iter().any(|&inside| inside) {
            return Err(DenoiseError::EmptyMask { rows, columns });
        }
        Ok(Threshold {
            rule: *self,
            inner,
            blob: Vec::new(),
            seen: Array2::default((rows, columns)),
        })
    }
}

/// Up to eight neighbours of the pixel [row, column] of a raster [rows, columns].
fn neighbours(
    [row, column]: [usize; 2],
    [rows, columns]: [usize; 2],
) -> impl Iterator<Item = [usize; 2]> {
    let around = |at: usize, most: usize| at.saturating_sub(1)..(at + 2).min(most);
    around(row, rows)
        .flat_map(move |r| around(column, columns).map(move |c| [r, c]))
        .filter(move |pixel| *pixel != [row, column])
}

/// A [`ThresholdRule`] on a skin, with its memory.
#[derive(Debug, Clone)]
pub struct Threshold {
    rule: ThresholdRule,
    inner: Array2<bool>,
    blob: Vec<[usize; 2]>,
    seen: Array2<bool>,
}

impl Threshold {
    /// Writes the wanted image of a raw one, both [row, column]: values that are kept, zero
    /// elsewhere, also outside the mask. An image without a positive value inside gives zeros.
    ///
    /// # Errors
    /// [`DenoiseError::ShapeMismatch`]; [`DenoiseError::ConstantImage`] where one value other than
    /// zero fills the inner pixels, of which no share stands out.
    pub fn apply_into(
        &mut self,
        image: ArrayView2<'_, f64>,
        mut out: ArrayViewMut2<'_, f64>,
    ) -> Result<(), DenoiseError> {
        let size = [self.inner.nrows(), self.inner.ncols()];
        for found in [image.dim(), out.dim()] {
            if found != self.inner.dim() {
                let (images, mask) = ([found.0, found.1], size);
                return Err(DenoiseError::ShapeMismatch { images, mask });
            }
        }
        out.fill(0.0);
        let inside = || image.iter().zip(&self.inner).filter(|(_, inner)| **inner).map(|(v, _)| *v);
        let most = inside().fold(f64::NEG_INFINITY, f64::max);
        let least = inside().fold(f64::INFINITY, f64::min);
        if most == least && most != 0.0 {
            return Err(DenoiseError::ConstantImage { value: most });
        }
        let level = self.rule.share * most;
        // where nothing rises, nothing is above zero
        let inner = &self.inner;
        let is_kept = |pixel: [usize; 2]| inner[pixel] && image[pixel] > level.max(0.0);
        self.seen.fill(false);
        for (row, column) in ndarray::indices(self.inner.dim()) {
            let start = [row, column];
            if self.seen[start] || !is_kept(start) {
                continue;
            }
            // a blob grows at its end while it is walked from its start
            self.blob.clear();
            self.blob.push(start);
            self.seen[start] = true;
            let mut next = 0;
            while let Some(&pixel) = self.blob.get(next) {
                next += 1;
                for near in neighbours(pixel, size) {
                    if !self.seen[near] && is_kept(near) {
                        self.seen[near] = true;
                        self.blob.push(near);
                    }
                }
            }
            if self.blob.len() >= self.rule.least_pixels {
                for &pixel in &self.blob {
                    out[pixel] = image[pixel];
                }
            }
        }
        Ok(())
    }

    /// Wanted images of a stack.
    ///
    /// # Errors
    /// Those of [`Threshold::apply_into`], within [`DenoiseError::InFrame`].
    pub fn apply(&mut self, raw: &ImageStack) -> Result<ImageStack, DenoiseError> {
        let mut values = raw.values().to_owned();
        for (frame, (image, out)) in raw.iter().zip(values.axis_iter_mut(Axis(0))).enumerate() {
            self.apply_into(image, out).map_err(|e| e.in_frame(frame))?;
        }
        ImageStack::new(values, raw.mask().to_owned())
    }
}
