//! Compressed data of a sequence: coefficients in the row space of the Jacobian instead of
//! measurements.
//!
//! With `W^1/2 J = U S V'` (only singular values `S` above the rounding floor), the data term of a
//! frame is
//!
//! ```text
//! |W^1/2 (J x - dv)|^2 = |S V' x - U' W^1/2 dv|^2 + rest^2
//! ```
//!
//! exactly. Reciprocal measurements merge into one coefficient with the weight of both, duplicate and
//! zero rows cost nothing, and the iteration handles `rank` numbers per frame instead of all
//! measurements. A frame with masked channels keeps the basis `V`; the remaining rows of `U S` are
//! factored (see `seen`), once per set of masked channels, however many frames share it.

mod compression;
pub(crate) mod seen;

pub(crate) use compression::Compression;
pub(crate) use seen::{Seen, Target};

use crate::check::check_length;
use crate::{DifferenceFrames, InverseError};

/// Compressed data terms of a whole sequence.
pub(crate) struct SequenceData {
    /// One data operator per set of good channels; the first is that of frames with all channels.
    pub(crate) modes: Vec<Seen>,
    /// Index into `modes`, `[frame]`.
    pub(crate) mode_of: Vec<usize>,
    /// `[frame]`.
    pub(crate) targets: Vec<Target>,
}

impl SequenceData {
    pub(crate) fn new(
        compression: &Compression,
        frames: &DifferenceFrames<'_>,
    ) -> Result<Self, InverseError> {
        check_length("columns of differences", frames.values.ncols(), compression.measurements)?;
        let mut modes = vec![Seen::new(compression)];
        let (mut mode_of, mut targets) = (Vec::new(), Vec::new());
        let mut whitened = vec![0.0; frames.values.ncols()];
        for frame in 0..frames.values.nrows() {
            let good = |i: usize| frames.is_good(frame, i);
            let known = modes.iter().position(|mode| mode.fits(compression, good));
            let index = known.unwrap_or_else(|| {
                let mut mode = modes[0].clone();
                mode.set(compression, good);
                modes.push(mode);
                modes.len() - 1
            });
            for (i, value) in whitened.iter_mut().enumerate() {
                let weight = compression.root_weights[i];
                // masked values may be NaN
                *value =
                    if modes[index].good[i] { weight * frames.values[(frame, i)] } else { 0.0 };
            }
            let mut target = Target::zero(compression);
            modes[index].take(compression, &whitened, 1.0, &mut target);
            mode_of.push(index);
            targets.push(target);
        }
        Ok(Self { modes, mode_of, targets })
    }
}
