//! Pairs in memory, normalised as the running net normalises.

use crate::DenoiseError;
use crate::learning_base::Shard;
use crate::unet::Example;
use ndarray::{Array2, Axis};

/// Normalised pairs of one skin.
#[derive(Debug, Clone)]
pub struct Examples {
    history: usize,
    mask: Array2<bool>,
    /// `[example][history][pixel]`
    frames: Vec<f32>,
    /// `[example][pixel]`
    wanted: Vec<f32>,
}

impl Examples {
    /// Of shards of one skin, for a net that sees `history` frames. Every frame becomes an example,
    /// with the frames before it in its shard (zero before the first), all divided by the largest
    /// raw value among them. Frames of which the net sees nothing but zero are passed over.
    ///
    /// # Errors
    /// [`DenoiseError::NothingToLearn`] without a frame, [`DenoiseError::MaskMismatch`] between
    /// shards, [`DenoiseError::OutOfRange`] for a history of none.
    pub fn new(shards: &[Shard], history: usize) -> Result<Self, DenoiseError> {
        let nothing = || DenoiseError::NothingToLearn { what: "the learning base".to_owned() };
        let mask = shards.first().ok_or_else(nothing)?.mask.clone();
        if history == 0 {
            let (quantity, must) = ("history", "at least 1");
            return Err(DenoiseError::OutOfRange { quantity, value: 0.0, must });
        }
        let mut made = Self { history, mask, frames: Vec::new(), wanted: Vec::new() };
        for shard in shards {
            made.take(shard)?;
        }
        if made.is_empty() { Err(nothing()) } else { Ok(made) }
    }

    fn take(&mut self, shard: &Shard) -> Result<(), DenoiseError> {
        if shard.mask != self.mask {
            let pixels = self.mask.len();
            return Err(DenoiseError::MaskMismatch { differing: pixels, pixels });
        }
        for (frame, wanted) in shard.wanted.outer_iter().enumerate() {
            let seen = frame.saturating_sub(self.history - 1)..frame + 1;
            let raw = shard.raw.slice_axis(Axis(0), seen.into());
            let scale = raw.iter().fold(0.0_f32, |most, v| most.max(v.abs()));
            // what a subnormal divides into is noise of the rounding
            if scale < f32::MIN_POSITIVE {
                continue;
            }
            let before = (self.history - raw.dim().0) * self.mask.len();
            self.frames.extend(std::iter::repeat_n(0.0, before));
            self.frames.extend(raw.iter().map(|v| v / scale));
            self.wanted.extend(wanted.iter().map(|v| v / scale));
        }
        Ok(())
    }

    /// Number of examples.
    pub fn len(&self) -> usize {
        self.wanted.len() / self.mask.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.wanted.is_empty()
    }

    /// Frames of an example.
    pub fn history(&self) -> usize {
        self.history
    }

    /// Rows and columns.
    pub fn size(&self) -> [usize; 2] {
        [self.mask.nrows(), self.mask.ncols()]
    }

    pub(crate) fn get(&self, k: usize) -> Example<'_> {
        let pixels = self.mask.len();
        Example {
            frames: &self.frames[k * self.history * pixels..][..self.history * pixels],
            wanted: &self.wanted[k * pixels..][..pixels],
            mask: self.mask.as_slice().unwrap_or_default(),
            size: self.size(),
        }
    }
}
