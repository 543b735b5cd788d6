//! The data of a sequence, compressed: measurements to coefficients in the space that the Jacobian
//! can see.
//!
//! With `W^1/2 J = U S V'` (singular values `S` above the rounding floor only), a frame is
//!
//! ```text
//! |W^1/2 (J x - dv)|^2 = |S V' x - U' W^1/2 dv|^2 + rest^2
//! ```
//!
//! exactly: reciprocal measurements fall into one coefficient with the weight of both, duplicate
//! and zero rows cost nothing, and the iteration sees `rank` numbers a frame instead of all
//! measurements. A frame with masked channels keeps the basis `V`: its Gram matrix
//! `S U_t' U_t S = Q diag(s^2) Q'` of the rows left is `rank x rank`, and one set of masked
//! channels is expanded once, however many frames share it.

mod compression;
mod mode;
mod target;

pub(crate) use compression::Compression;
pub(crate) use mode::{Mode, ModeScratch};
pub(crate) use target::Target;

use crate::check::check_length;
use crate::{DifferenceFrames, InverseError};

/// Modes and targets of a whole sequence.
pub(crate) struct SequenceData {
    pub(crate) modes: Vec<Mode>,
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
        let rank = compression.rank();
        let mut modes = vec![Mode::full(compression)];
        let (mut mode_of, mut targets) = (Vec::new(), Vec::new());
        let mut scratch = None;
        let (mut coefficients, mut whitened) = (vec![0.0; rank], vec![0.0; frames.values.ncols()]);
        for frame in 0..frames.values.nrows() {
            let masked = |i: usize| compression.root_weights[i] > 0.0 && !frames.is_good(frame, i);
            let known = modes
                .iter()
                .position(|m| m.masked.iter().enumerate().all(|(i, &b)| b == masked(i)));
            let index = match known {
                Some(index) => index,
                None => {
                    let scratch = scratch.get_or_insert_with(|| ModeScratch::new(compression));
                    let mut mode = Mode::full(compression);
                    mode.set(compression, masked, scratch)?;
                    modes.push(mode);
                    modes.len() - 1
                }
            };
            let mut target = Target::zero(rank);
            let dv = |i: usize| frames.values[(frame, i)];
            target.set(compression, &modes[index], dv, &mut coefficients, &mut whitened);
            mode_of.push(index);
            targets.push(target);
        }
        Ok(Self { modes, mode_of, targets })
    }
}
