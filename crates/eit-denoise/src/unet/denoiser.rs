//! Images through a trained net, frame by frame, in memory that is reserved once.

use super::net::{Net, Run};
use super::{UnetShape, Weights};
use crate::{DenoiseError, ImageStack};
use ndarray::{Array2, ArrayView2, ArrayViewMut2, Axis};
use pulp::Arch;
use std::ops::Range;

/// A U-net ready for the images of one skin.
///
/// `D(x) = s N(x / s, mask)` with the net `N` and `s` the largest magnitude inside the mask over the
/// frames that the net sees, so that scaling the images scales the result; images of zero give
/// zero. Frames before the first count as zero, an untouched skin. Images are `f64` in any unit,
/// the arithmetic is `f32`: the same bits for a stack and for its frames one by one, on every
/// machine whose compiler fuses multiply and add alike.
///
/// Nothing is allocated after [`Denoiser::new`].
///
/// The net alone would not give zero for zero: it has biases. `s N(x / s)` does, as its limit for
/// small images, so the net does not run where all it would see is zero.
#[derive(Debug, Clone)]
pub struct Denoiser {
    net: Net,
    mask: Array2<bool>,
    /// Last raw images inside the mask, oldest first, `[history][masked pixel]`.
    history: Vec<f64>,
    /// Places of masked pixels in a plane.
    places: Vec<usize>,
    /// Masked pixels as runs of an image in memory.
    runs: Vec<Range<usize>>,
    /// The history is zero.
    silent: bool,
    pushed: usize,
    arch: Arch,
}

/// What an image took.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum NetStatus {
    /// The net ran.
    Computed,
    /// This image and those before it that the net sees are zero, and so is the result: the net did
    /// not run.
    Zero,
}

impl Denoiser {
    /// Prepares a net for a skin with this mask [row, column]. Which skin it was trained on is the
    /// caller's question: [`Weights::check_skin`].
    ///
    /// # Errors
    /// [`DenoiseError::EmptyMask`]; those of [`Weights::validate`].
    pub fn new(weights: &Weights, mask: ArrayView2<'_, bool>) -> Result<Self, DenoiseError> {
        weights.validate()?;
        let (rows, columns) = mask.dim();
        if !mask.iter().any(|&inside| inside) {
            return Err(DenoiseError::EmptyMask { rows, columns });
        }
        let net = Net::new(weights, [rows, columns]);
        let plane = net.levels[0].plane;
        let masked = || mask.indexed_iter().filter(|(_, inside)| **inside).map(|(place, _)| place);
        let places: Vec<usize> = masked().map(|(r, c)| plane.row(r) + c).collect();
        let history = vec![0.0; weights.shape.history * places.len()];
        let (mask, runs) = (mask.to_owned(), runs(mask));
        let (silent, pushed, arch) = (true, 0, Arch::new());
        let mut denoiser = Self { net, mask, history, places, runs, silent, pushed, arch };
        // the last input never changes
        let channel = weights.shape.history * plane.len();
        for &place in &denoiser.places {
            denoiser.net.levels[0].input[channel + place] = 1.0;
        }
        Ok(denoiser)
    }

    /// Size of the net.
    pub fn shape(&self) -> UnetShape {
        self.net.shape
    }

    /// Forgets the frames so far: a new sequence begins.
    pub fn reset(&mut self) {
        self.history.fill(0.0);
        self.silent = true;
        self.pushed = 0;
    }

    /// The next frame of a sequence: writes what the net makes of `image`, both [row, column], NaN
    /// outside the mask. Outside, `image` is not looked at. A frame that is refused leaves the
    /// sequence as it was. An image of zeros after such images alone costs one look at it.
    ///
    /// # Errors
    /// [`DenoiseError::ShapeMismatch`]; [`DenoiseError::NonFinitePixel`], frames counted since the
    /// last reset; [`DenoiseError::ConstantImage`] where one value other than zero fills the skin.
    pub fn push_into(
        &mut self,
        image: ArrayView2<'_, f64>,
        mut out: ArrayViewMut2<'_, f64>,
    ) -> Result<NetStatus, DenoiseError> {
        for found in [image.dim(), out.dim()] {
            if found != self.mask.dim() {
                let (images, mask) = ([found.0, found.1], [self.mask.nrows(), self.mask.ncols()]);
                return Err(DenoiseError::ShapeMismatch { images, mask });
            }
        }
        if self.silent && self.is_zero(image) {
            self.pushed += 1;
            self.write_zero(out);
            return Ok(NetStatus::Zero);
        }
        self.check(image)?;
        let pixels = self.places.len();
        self.history.copy_within(pixels.., 0);
        let mut next = self.history.len() - pixels;
        // plain loops: an iterator of zipped and filtered views took a fifth of a frame's time
        for row in 0..image.nrows() {
            for column in 0..image.ncols() {
                if self.mask[[row, column]] {
                    self.history[next] = image[[row, column]];
                    next += 1;
                }
            }
        }
        self.pushed += 1;
        let scale = self.history.iter().fold(0.0_f64, |most, v| v.abs().max(most));
        self.silent = scale == 0.0;
        if self.silent {
            self.net.image.fill(0.0);
        } else {
            let Self { net, history, places, .. } = self;
            let input = &mut net.levels[0];
            let channels = input.input.chunks_exact_mut(input.plane.len());
            for (channel, frame) in channels.zip(history.chunks_exact(pixels)) {
                for (place, value) in places.iter().zip(frame) {
                    channel[*place] = (value / scale) as f32;
                }
            }
            self.arch.dispatch(Run(net));
        }
        let plane = self.net.levels[0].plane;
        for ((row, mut out), mask) in out.outer_iter_mut().enumerate().zip(self.mask.outer_iter()) {
            let values = &self.net.image[plane.row(row)..];
            for ((out, value), inside) in out.iter_mut().zip(values).zip(mask) {
                *out = if *inside { scale * f64::from(*value) } else { f64::NAN };
            }
        }
        Ok(if self.silent { NetStatus::Zero } else { NetStatus::Computed })
    }

    /// Whether all masked pixels are zero. Left at the first run that is not; a run without a branch
    /// for each pixel.
    fn is_zero(&self, image: ArrayView2<'_, f64>) -> bool {
        match image.as_slice() {
            // all bits but the sign
            Some(values) => self.runs.iter().all(|run| {
                values[run.clone()].iter().fold(0, |bits, v| bits | v.to_bits()) << 1 == 0
            }),
            None => image.iter().zip(&self.mask).all(|(value, inside)| !inside || *value == 0.0),
        }
    }

    /// Zero inside the mask, NaN outside.
    fn write_zero(&self, mut out: ArrayViewMut2<'_, f64>) {
        if let Some(values) = out.as_slice_mut() {
            values.fill(f64::NAN);
            self.runs.iter().for_each(|run| values[run.clone()].fill(0.0));
            return;
        }
        for (out, inside) in out.iter_mut().zip(&self.mask) {
            *out = if *inside { 0.0 } else { f64::NAN };
        }
    }

    fn check(&self, image: ArrayView2<'_, f64>) -> Result<(), DenoiseError> {
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for ((row, column), &value) in image.indexed_iter() {
            if self.mask[[row, column]] {
                if !value.is_finite() {
                    let frame = self.pushed;
                    return Err(DenoiseError::NonFinitePixel { frame, row, column, value });
                }
                (least, most) = (least.min(value), most.max(value));
            }
        }
        if least == most && most != 0.0 && self.places.len() > 1 {
            return Err(DenoiseError::ConstantImage { value: most }.in_frame(self.pushed));
        }
        Ok(())
    }

    /// A whole sequence from its start: the same bits as frame by frame.
    ///
    /// # Errors
    /// Those of [`Denoiser::push_into`]; [`DenoiseError::MaskMismatch`] for the images of another
    /// skin.
    pub fn denoise(&mut self, raw: &ImageStack) -> Result<ImageStack, DenoiseError> {
        if raw.mask() != self.mask {
            let differing = match raw.mask().dim() == self.mask.dim() {
                true => raw.mask().iter().zip(&self.mask).filter(|(a, b)| a != b).count(),
                false => self.mask.len(),
            };
            return Err(DenoiseError::MaskMismatch { differing, pixels: self.mask.len() });
        }
        self.reset();
        let mut values = raw.values().to_owned();
        for (image, out) in raw.iter().zip(values.axis_iter_mut(Axis(0))) {
            self.push_into(image, out)?;
        }
        ImageStack::new(values, self.mask.clone())
    }
}

/// Runs of masked pixels, row by row.
fn runs(mask: ArrayView2<'_, bool>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (place, _) in mask.iter().enumerate().filter(|(_, inside)| **inside) {
        match runs.last_mut() {
            Some(run) if run.end == place => run.end += 1,
            _ => runs.push(place..place + 1),
        }
    }
    runs
}
