//! The paper's threshold rule for wanted images where no truth is known.

use crate::{DenoiseError, ImageStack};
use ndarray::{Array2, ArrayView2, ArrayViewMut2, Axis};

/// Makes a wanted image from a raw one, as Duan, Taurand and Soleimani (Sci. Rep. 9:8831, 2019) do.
/// Artefacts of electrode movement lie on the rim and are small. The rule removes the ring along the rim,
/// then values below a fraction of the maximum, then blobs too small for a finger.
///
/// Only increases of conductivity are kept, which pressure causes on the paper's fabric; negate the
/// images if touches lower the conductivity. The result is not the truth: a finger on the rim is
/// lost, and so is the weaker of two fingers if it stays below that fraction.
///
/// ```
/// use eit_denoise::ThresholdRule;
/// use ndarray::Array2;
///
/// let mask = Array2::from_elem((32, 32), true);
/// let mut threshold = ThresholdRule::default().on(mask.view())?;
/// let mut image = Array2::zeros((32, 32));
/// image.slice_mut(ndarray::s![10..15, 16..21]).fill(2.0);
/// image[[20, 20]] = 0.1; // weak: removed
/// let mut kept = Array2::zeros((32, 32));
/// threshold.apply_into(image.view(), kept.view_mut())?;
/// assert_eq!(kept.sum(), 50.0);
/// # Ok::<(), eit_denoise::DenoiseError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct ThresholdRule {
    /// Width of the removed ring in steps to one of eight neighbours. The paper suppresses the boundary and states no
    /// width; 4 of 64 pixels is assumed.
    pub ring_pixels: usize,
    /// Values above this fraction of the largest remaining value are kept; from 0 to below 1. The paper: 0.55.
    pub share: f64,
    /// Blobs (eight neighbours) of fewer pixels are removed. The paper: 15.
    pub least_pixels: usize,
}

impl Default for ThresholdRule {
    fn default() -> Self {
        Self { ring_pixels: 4, share: 0.55, least_pixels: 15 }
    }
}

impl ThresholdRule {
    /// Prepares the rule for a skin with this mask [row, column].
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`] for the share, [`DenoiseError::EmptyMask`] where the ring
    /// leaves no pixel.
    pub fn on(&self, mask: ArrayView2<'_, bool>) -> Result<Threshold, DenoiseError> {
        let is_share = (0.0..1.0).contains(&self.share);
        DenoiseError::check_range(is_share, "share", self.share, "at least 0 and below 1")?;
        let (rows, columns) = mask.dim();
        let mut inner = mask.to_owned();
        for _ in 0..self.ring_pixels {
            let before = inner.clone();
            inner = Array2::from_shape_fn((rows, columns), |(row, column)| {
                let around = neighbours([row, column], [rows, columns]);
                // pixels beyond the raster are outside
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

/// Returns the neighbours, at most eight, of the pixel [row, column] of a raster [rows, columns].
fn neighbours(
    [row, column]: [usize; 2],
    [rows, columns]: [usize; 2],
) -> impl Iterator<Item = [usize; 2]> {
    let around = |at: usize, most: usize| at.saturating_sub(1)..(at + 2).min(most);
    around(row, rows)
        .flat_map(move |r| around(column, columns).map(move |c| [r, c]))
        .filter(move |pixel| *pixel != [row, column])
}

/// A [`ThresholdRule`] prepared for a skin, with its working memory.
#[derive(Debug, Clone)]
pub struct Threshold {
    rule: ThresholdRule,
    inner: Array2<bool>,
    blob: Vec<[usize; 2]>,
    seen: Array2<bool>,
}

impl Threshold {
    /// Writes the wanted image of a raw one, both [row, column]: kept values, and zero elsewhere, also
    /// outside the mask. An image without a positive value inside the mask gives zeros.
    ///
    /// # Errors
    /// [`DenoiseError::ShapeMismatch`]; [`DenoiseError::ConstantImage`] if all inner pixels have the same
    /// value other than zero: then `out` is zero.
    pub fn apply_into(
        &mut self,
        image: ArrayView2<'_, f64>,
        mut out: ArrayViewMut2<'_, f64>,
    ) -> Result<(), DenoiseError> {
        let size = [self.inner.nrows(), self.inner.ncols()];
        DenoiseError::check_size(image.dim(), self.inner.dim())?;
        DenoiseError::check_size(out.dim(), self.inner.dim())?;
        out.fill(0.0);
        let inside = || image.iter().zip(&self.inner).filter(|(_, inner)| **inner).map(|(v, _)| *v);
        let most = inside().fold(f64::NEG_INFINITY, f64::max);
        let least = inside().fold(f64::INFINITY, f64::min);
        if most == least && most != 0.0 {
            return Err(DenoiseError::ConstantImage { value: most });
        }
        let level = self.rule.share * most;
        // never keeps values that are not positive
        let inner = &self.inner;
        let is_kept = |pixel: [usize; 2]| inner[pixel] && image[pixel] > level.max(0.0);
        self.seen.fill(false);
        for (row, column) in ndarray::indices(self.inner.dim()) {
            let start = [row, column];
            if self.seen[start] || !is_kept(start) {
                continue;
            }
            // pixels are appended while the list is walked
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

    /// Returns the wanted images of a stack; that of an image of one value, which no touch gives, is zero.
    ///
    /// # Errors
    /// Those of [`Threshold::apply_into`] but [`DenoiseError::ConstantImage`], within [`DenoiseError::InFrame`].
    pub fn apply(&mut self, raw: &ImageStack) -> Result<ImageStack, DenoiseError> {
        let mut values = raw.values().to_owned();
        for (frame, (image, out)) in raw.iter().zip(values.axis_iter_mut(Axis(0))).enumerate() {
            match self.apply_into(image, out) {
                Err(DenoiseError::ConstantImage { .. }) => {}
                applied => applied.map_err(|e| e.in_frame(frame))?,
            }
        }
        ImageStack::new(values, raw.mask().to_owned())
    }
}
