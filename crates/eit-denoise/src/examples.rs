//! Pairs in memory, normalised as the running net normalises.

use crate::DenoiseError;
use crate::learning_base::Shard;
use crate::raster_symmetry::RasterSymmetry;
use ndarray::{Array2, Axis};

/// Part of the mean error of the raw images that is added to each one's own before dividing by it,
/// so that frames which are nearly right already do not rule the sum. A touch of a seventh of the
/// usual strength still counts half.
const FLOOR: f64 = 0.02;
/// Examples whose raw error is below this part of the mean are passed over: they would count for
/// less than a twentieth.
const LEAST: f64 = 1e-3;

/// Normalised pairs of one skin, each weighted by how wrong its raw image is.
#[derive(Debug, Clone)]
pub struct Examples {
    history: usize,
    mask: Array2<bool>,
    /// `[example][history][pixel]`
    frames: Vec<f32>,
    /// `[example][pixel]`
    wanted: Vec<f32>,
    /// What the squared error of each example is multiplied by.
    weights: Vec<f32>,
    /// Ways to turn and mirror an example; never empty, the first leaves it.
    turns: Vec<RasterSymmetry>,
}

/// One example, normalised as in [`crate::Denoiser`].
#[cfg(feature = "train")]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Example<'a> {
    /// Frames oldest first, divided by their scale, `[history][pixel]`, zero outside the mask.
    pub frames: &'a [f32],
    /// What should come out, `[pixel]`, divided by the same scale, zero outside the mask.
    pub wanted: &'a [f32],
    /// What the squared error is multiplied by.
    pub weight: f32,
}

/// Memory for an example that was turned.
#[cfg(feature = "train")]
#[derive(Debug, Clone, Default)]
pub(crate) struct Turned {
    frames: Vec<f32>,
    wanted: Vec<f32>,
}

impl Examples {
    /// Of shards of one skin, for a net that sees `history` frames. Every frame becomes an example,
    /// with the frames before it in its shard (zero before the first), all divided by the largest
    /// raw value among them. Frames of which the net sees nothing but zero are passed over.
    ///
    /// The mean squared error `e` of an example counts as `e / (r + 0.02 R)` with `r` that of its raw
    /// image and `R` the mean of all `r`, in the images' own unit: what is learnt is the part of the
    /// raw image's error that is left, a faint touch counting nearly as much as a strong one. Frames
    /// with `r` below a thousandth of `R`, in which nothing touches, are passed over.
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
        let turns = vec![RasterSymmetry::default()];
        let (frames, wanted, weights) = (Vec::new(), Vec::new(), Vec::new());
        let mut made = Self { history, mask, frames, wanted, weights, turns };
        let mut scales = Vec::new();
        for shard in shards {
            made.take(shard, &mut scales)?;
        }
        if made.is_empty() {
            return Err(nothing());
        }
        made.weigh(&scales);
        Ok(made)
    }

    /// The same pairs with data augmentation: each epoch sees every one turned or mirrored in one of
    /// these ways, drawn anew. The skin with its electrodes and the measurements must have these symmetries;
    /// that the mask has them is checked.
    ///
    /// # Errors
    /// [`DenoiseError::MaskMismatch`] where a turn takes the mask to another.
    pub fn augmented(mut self, turns: &[RasterSymmetry]) -> Result<Self, DenoiseError> {
        for turn in turns {
            let differing = turn.differing(self.mask.view());
            if differing > 0 {
                return Err(DenoiseError::MaskMismatch { differing, pixels: self.mask.len() });
            }
        }
        if !turns.is_empty() {
            self.turns = turns.to_vec();
        }
        Ok(self)
    }

    /// Weights by the errors of the raw images, whose scales are given; drops what would not count.
    fn weigh(&mut self, scales: &[f64]) {
        let (seen, pixels) = (self.history * self.mask.len(), self.mask.len());
        let inside = self.mask.iter().filter(|inside| **inside).count().max(1) as f64;
        let error = |frames: &[f32], wanted: &[f32]| {
            let off = frames[seen - pixels..].iter().zip(wanted).map(|(r, w)| f64::from(r - w));
            off.map(|d| d * d).sum::<f64>() / inside
        };
        let pairs = self.frames.chunks_exact(seen).zip(self.wanted.chunks_exact(pixels));
        let errors: Vec<f64> = pairs.map(|(frames, wanted)| error(frames, wanted)).collect();
        let own_unit = errors.iter().zip(scales).map(|(e, scale)| e * scale * scale);
        let mean = own_unit.sum::<f64>() / errors.len() as f64;
        let mut kept = 0;
        for (k, (error, scale)) in errors.iter().zip(scales).enumerate() {
            // the mean in the unit of this example
            let mean = mean / (scale * scale);
            if *error < LEAST * mean {
                continue;
            }
            // raw images that are all right leave nothing to weigh by
            let floor = (FLOOR * mean).max(f64::from(f32::MIN_POSITIVE));
            self.weights.push((1.0 / (error + floor)) as f32);
            self.frames.copy_within(k * seen..(k + 1) * seen, kept * seen);
            self.wanted.copy_within(k * pixels..(k + 1) * pixels, kept * pixels);
            kept += 1;
        }
        self.frames.truncate(kept * seen);
        self.wanted.truncate(kept * pixels);
    }

    fn take(&mut self, shard: &Shard, scales: &mut Vec<f64>) -> Result<(), DenoiseError> {
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
            scales.push(f64::from(scale));
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

    /// Pixels that count.
    #[cfg(feature = "train")]
    pub(crate) fn mask(&self) -> &Array2<bool> {
        &self.mask
    }

    /// Number of ways to turn an example.
    #[cfg(feature = "train")]
    pub(crate) fn turns(&self) -> usize {
        self.turns.len()
    }

    /// Example `k` of `len() * turns()`: first all as they are, then all turned the second way, and
    /// so on.
    #[cfg(feature = "train")]
    pub(crate) fn get<'a>(&'a self, k: usize, memory: &'a mut Turned) -> Example<'a> {
        let (pixels, turn) = (self.mask.len(), self.turns[k / self.len()]);
        let k = k % self.len();
        let frames = &self.frames[k * self.history * pixels..][..self.history * pixels];
        let wanted = &self.wanted[k * pixels..][..pixels];
        let plain = Example { frames, wanted, weight: self.weights[k] };
        if turn == RasterSymmetry::default() {
            return plain;
        }
        memory.frames.clear();
        memory.wanted.clear();
        for frame in frames.chunks_exact(pixels) {
            turn.append(frame, self.size(), &mut memory.frames);
        }
        turn.append(wanted, self.size(), &mut memory.wanted);
        Example { frames: &memory.frames, wanted: &memory.wanted, ..plain }
    }
}
