//! Training pairs in memory, normalised as the net normalises at run time.

use crate::DenoiseError;
use crate::learning_base::Shard;
use crate::raster_symmetry::RasterSymmetry;
use crate::unet::CLAMP;
use ndarray::{Array2, Array3, Axis};

/// Fraction of a sequence's mean reference error that is added to each frame's reference error before
/// dividing by it, so that frames that are already almost right do not dominate the sum.
const FLOOR: f64 = 0.05;
/// Frames whose reference error is below this fraction of their sequence's mean are left out.
const LEAST: f64 = 1e-3;
/// Frames whose reference error is below this fraction of the mean over all sequences are left out:
/// 0.3 % of the usual amplitude is drift.
const LEAST_OF_ALL: f64 = 1e-5;

/// Normalised pairs of one skin, each weighted by how wrong its raw image is.
#[derive(Debug, Clone)]
pub struct Examples {
    history: usize,
    /// Images per frame.
    images: usize,
    /// Conditions per frame.
    conditions: usize,
    mask: Array2<bool>,
    /// `[example][history][image][pixel]`
    frames: Vec<f32>,
    /// `[example][condition]`
    states: Vec<f32>,
    /// `[example][pixel]`
    wanted: Vec<f32>,
    /// Factor on the squared error of each example.
    weights: Vec<f32>,
    /// Ways to turn and mirror an example; never empty, the first is the identity.
    turns: Vec<RasterSymmetry>,
}

/// One example, normalised as in [`crate::Denoiser`].
#[cfg(feature = "train")]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Example<'a> {
    /// Frames oldest first, divided by their scale, `[history][image][pixel]`, zero outside the mask.
    pub frames: &'a [f32],
    /// Conditions of the last frame.
    pub conditions: &'a [f32],
    /// The wanted image, `[pixel]`, divided by the same scale, zero outside the mask.
    pub wanted: &'a [f32],
    /// Factor on the squared error.
    pub weight: f32,
}

/// Memory for a transformed example.
#[cfg(feature = "train")]
#[derive(Debug, Clone, Default)]
pub(crate) struct Turned {
    frames: Vec<f32>,
    wanted: Vec<f32>,
}

/// Scale and reference error of an example, in the images' own unit.
struct Known {
    scale: f64,
    error: f64,
    shard: usize,
}

impl Examples {
    /// Examples from shards of one skin, for a net that sees `history` frames. Every frame becomes an
    /// example, with the frames before it in its shard (zero before the first), all divided by the
    /// largest magnitude among their first images; other images are clamped to twice that. Frames whose first
    /// images are all zero are left out.
    ///
    /// The mean squared error `e` of an example counts as `e / (r + 0.05 R)`. Its reference error `r` is
    /// the mean squared error of its raw image or of an empty one, whichever is smaller, and `R` the
    /// mean of `r` over the sequence. For a net that corrects another image than the raw one, `r` is at least the mean
    /// squared error of that image. A faint touch thus counts nearly as much as a strong one, also
    /// where a whole sequence is faint. Frames with `r` below a thousandth of `R`, in which nothing
    /// touches, are left out.
    ///
    /// # Errors
    /// [`DenoiseError::NothingToLearn`] without a frame, [`DenoiseError::MaskMismatch`] and
    /// [`DenoiseError::WrongLength`] between shards, [`DenoiseError::OutOfRange`] for a history of 0.
    pub fn new(shards: &[Shard], history: usize) -> Result<Self, DenoiseError> {
        let nothing = || DenoiseError::NothingToLearn { what: "the learning base".to_owned() };
        let first = shards.first().ok_or_else(nothing)?;
        DenoiseError::check_range(history > 0, "history", 0.0, "at least 1")?;
        let [images, conditions] = first.inputs()?;
        let (mask, turns) = (first.mask.clone(), vec![RasterSymmetry::default()]);
        let (frames, states) = (Vec::new(), Vec::new());
        let (wanted, weights) = (Vec::new(), Vec::new());
        let mut made =
            Self { history, images, conditions, mask, frames, states, wanted, weights, turns };
        let mut known = Vec::new();
        for (index, shard) in shards.iter().enumerate() {
            made.take(index, shard, &mut known)?;
        }
        if made.is_empty() {
            return Err(nothing());
        }
        made.weigh(&known, shards.len());
        Ok(made)
    }

    /// The same pairs with data augmentation: in each epoch every pair is rotated or mirrored by a
    /// randomly drawn symmetry of these. The skin with its electrodes and the measurements must
    /// have these symmetries; only the mask is checked.
    ///
    /// # Errors [`DenoiseError::MaskMismatch`] where a turn takes the mask to another.
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

    /// Sets the weights from the reference errors; drops frames whose weight would be negligible.
    fn weigh(&mut self, known: &[Known], shards: usize) {
        let pixels = self.mask.len();
        let seen = (&mut self.frames, self.history * self.images * pixels);
        let mut parts = [seen, (&mut self.wanted, pixels), (&mut self.states, self.conditions)];
        let (mut sums, mut counts) = (vec![0.0; shards], vec![0.0; shards]);
        for Known { error, shard, .. } in known {
            sums[*shard] += error;
            counts[*shard] += 1.0;
        }
        let least = LEAST_OF_ALL * sums.iter().sum::<f64>() / known.len() as f64;
        let mut kept = 0;
        for (k, Known { scale, error, shard }) in known.iter().enumerate() {
            let mean = sums[*shard] / counts[*shard];
            if *error < (LEAST * mean).max(least) {
                continue;
            }
            // raw images that are all right leave nothing to weigh by
            let reference =
                ((error + FLOOR * mean) / (scale * scale)).max(f64::from(f32::MIN_POSITIVE));
            self.weights.push((1.0 / reference) as f32);
            for (part, size) in &mut parts {
                part.copy_within(k * *size..(k + 1) * *size, kept * *size);
            }
            kept += 1;
        }
        parts.into_iter().for_each(|(part, size)| part.truncate(kept * size));
    }

    /// Takes every frame of a shard, `index` among all, that has anything to scale by.
    fn take(
        &mut self,
        index: usize,
        shard: &Shard,
        known: &mut Vec<Known>,
    ) -> Result<(), DenoiseError> {
        let pixels = self.mask.len();
        if shard.mask != self.mask {
            return Err(DenoiseError::MaskMismatch { differing: pixels, pixels });
        }
        let [images, conditions] = shard.inputs()?;
        DenoiseError::check_length("images per frame", images, self.images)?;
        DenoiseError::check_length("conditions per frame", conditions, self.conditions)?;
        let inside = self.mask.iter().filter(|inside| **inside).count().max(1) as f64;
        for (frame, wanted) in shard.wanted.outer_iter().enumerate() {
            let Some(scale) = self.take_seen(shard, frame) else { continue };
            self.wanted.extend(wanted.iter().map(|v| v / scale));
            if let Some(all) = &shard.beside.conditions {
                self.states.extend(all.row(frame));
            }
            let error = squared_error(shard, frame, images) / inside;
            known.push(Known { scale: f64::from(scale), error, shard: index });
        }
        Ok(())
    }

    /// Appends a frame and those before it, divided by their scale, which is returned; `None` without a scale, and then
    /// appends nothing.
    fn take_seen(&mut self, shard: &Shard, frame: usize) -> Option<f32> {
        let (start, pixels) = (self.frames.len(), self.mask.len());
        // frames before the first
        let before = self.history.saturating_sub(frame + 1);
        self.frames.extend(std::iter::repeat_n(0.0, before * self.images * pixels));
        for frame in (frame + 1).saturating_sub(self.history)..=frame {
            let mut images = shard.images().map(|images| images.index_axis(Axis(0), frame));
            let Some(first) = images.next() else { continue };
            let is_zero = first.iter().all(|v| *v == 0.0);
            self.frames.extend(&first);
            for other in images {
                self.frames.extend(other.iter().map(|v| if is_zero { 0.0 } else { *v }));
            }
        }
        let seen = &mut self.frames[start..];
        let firsts = seen.chunks_exact(pixels).step_by(self.images).flatten();
        let scale = firsts.fold(0.0_f32, |most, v| most.max(v.abs()));
        // dividing by a subnormal number amplifies its rounding
        if scale < f32::MIN_POSITIVE {
            self.frames.truncate(start);
            return None;
        }
        for (k, image) in seen.chunks_exact_mut(pixels).enumerate() {
            let most = if k % self.images == 0 { 1.0 } else { CLAMP };
            image.iter_mut().for_each(|v| *v = (*v / scale).clamp(-most, most));
        }
        Some(scale)
    }

    /// Number of examples.
    pub fn len(&self) -> usize {
        self.wanted.len() / self.mask.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.wanted.is_empty()
    }

    /// Frames per example.
    #[cfg(feature = "train")]
    pub(crate) fn history(&self) -> usize {
        self.history
    }

    /// Images per frame.
    #[cfg(feature = "train")]
    pub(crate) fn images(&self) -> usize {
        self.images
    }

    /// Conditions per frame.
    #[cfg(feature = "train")]
    pub(crate) fn conditions(&self) -> usize {
        self.conditions
    }

    /// Rows and columns.
    #[cfg(feature = "train")]
    pub(crate) fn size(&self) -> [usize; 2] {
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
        let seen = self.history * self.images * pixels;
        let frames = &self.frames[k * seen..][..seen];
        let conditions = &self.states[k * self.conditions..][..self.conditions];
        let wanted = &self.wanted[k * pixels..][..pixels];
        let plain = Example { frames, conditions, wanted, weight: self.weights[k] };
        if turn == RasterSymmetry::default() {
            return plain;
        }
        memory.frames.clear();
        memory.wanted.clear();
        for image in frames.chunks_exact(pixels) {
            turn.append(image, self.size(), &mut memory.frames);
        }
        turn.append(wanted, self.size(), &mut memory.wanted);
        Example { frames: &memory.frames, wanted: &memory.wanted, ..plain }
    }
}

/// Sum of the squared errors by which a frame of so many `images` is judged ([`Examples::new`]).
fn squared_error(shard: &Shard, frame: usize, images: usize) -> f64 {
    let wanted = shard.wanted.index_axis(Axis(0), frame);
    let square = |d: f32| f64::from(d) * f64::from(d);
    let of = |all: &Array3<f32>| {
        let image = all.index_axis(Axis(0), frame);
        image.iter().zip(&wanted).map(|(v, w)| square(v - w)).sum::<f64>()
    };
    let of_raw = of(&shard.raw);
    let of_empty = wanted.iter().map(|w| square(*w)).sum::<f64>();
    // a frame without a touch is as right as its raw image
    let error = if of_empty > 0.0 { of_raw.min(of_empty) } else { of_raw };
    // the image that a net corrects may be far off, where touches were overlooked or invented: such a
    // frame must not outweigh hundreds of others
    match shard.images().next() {
        Some(first) if images > 1 => error.max(of(first)),
        _ => error,
    }
}
