//! Denoises images with a trained net, frame by frame, in memory allocated once.
//!
//! Over 300 lines because the checks of a frame, its inputs and its output share one set of planes.

use super::kernel::Plane;
use super::net::{Net, Run};
use super::{UnetShape, Weights};
use crate::{DenoiseError, ImageStack};
use ndarray::{Array2, ArrayView2, ArrayView3, ArrayViewMut2, Axis};
use pulp::Arch;
use std::ops::Range;

/// A U-net ready for the images of one skin.
///
/// `D(x, c) = s N(x / s, c, mask)` with the net `N`, the conditions `c`, and `s` the largest
/// magnitude inside the mask over the first images of all frames that the net sees. A net of several images
/// corrects the first: `D(x, c) = x_1 + s N(x / s, c, mask)`. Other images are clamped
/// to `-2 s` and `2 s`: where noise ruins one of them, the first still has its scale. Scaling the images
/// scales the result. If
/// the first image of a frame is zero, its other images count as zero too. If all inputs of the net are zero,
/// the result is zero as well and the net does not run: because of its biases it would not return zero.
/// Frames before the first count as zero, an untouched skin.
/// Images are `f64` in any unit, the arithmetic is `f32`: the same bits for a stack and for its
/// frames one by one, on every machine whose compiler fuses multiply and add alike.
///
/// Does not allocate after [`Denoiser::new`].
///
/// ```
/// use eit_denoise::{Denoiser, NetStatus, Weights};
/// use ndarray::Array2;
///
/// let weights = Weights::paper_disc()?;
/// let mask = Array2::from_elem((weights.pixels[0], weights.pixels[1]), true);
/// let mut denoiser = Denoiser::new(&weights, mask.view())?;
/// let raw = Array2::from_shape_fn(mask.dim(), |(r, c)| if r.abs_diff(c) < 3 { 1e-6 } else { 0.0 });
/// let mut clean = Array2::zeros(mask.dim());
/// let status: NetStatus = denoiser.push_into(raw.view(), clean.view_mut())?;
/// println!("{status:?}, {:?}", clean.dim());
/// # Ok::<(), eit_denoise::DenoiseError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Denoiser {
    net: Net,
    mask: Array2<bool>,
    /// Masked pixels of the last frames, oldest first, `[history][image][masked pixel]`.
    history: Vec<f64>,
    /// Offsets of masked pixels in the planes of one input.
    places: Vec<usize>,
    /// Masked pixels as contiguous runs of an image in memory.
    runs: Vec<Range<usize>>,
    /// The history is zero.
    silent: bool,
    pushed: usize,
    arch: Arch,
}

/// Inputs of a net for one frame.
#[derive(Debug, Clone, Copy)]
pub struct NetFrame<'a> {
    /// Images [row, column], [`UnetShape::images`] of them, starting with the one to be denoised.
    pub images: &'a [ArrayView2<'a, f64>],
    /// Conditions, [`UnetShape::conditions`] of them.
    pub conditions: &'a [f64],
}

/// Largest magnitude of images other than the first, relative to the scale.
pub(crate) const CLAMP: f32 = 2.0;

/// How the image of a frame was computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum NetStatus {
    /// The net computed the image.
    Computed,
    /// The net did not run: the first images of this frame and of its history are zero, and so is the
    /// result.
    Zero,
}

impl Denoiser {
    /// Prepares a net for a skin with this mask [row, column]. The caller checks which skin it was
    /// trained for ([`Weights::check_skin`]).
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
        let (plane, shape) = (net.levels[0].plane, weights.shape);
        let masked = || mask.indexed_iter().filter(|(_, inside)| **inside).map(|(place, _)| place);
        let places: Vec<usize> = masked().map(|(r, c)| place(plane, shape.fold, r, c)).collect();
        let history = vec![0.0; shape.history * shape.images * places.len()];
        let (mask, runs) = (mask.to_owned(), runs(mask));
        let (silent, pushed, arch) = (true, 0, Arch::new());
        let mut denoiser = Self { net, mask, history, places, runs, silent, pushed, arch };
        // the mask, which never changes, is the last input
        denoiser.fill_input(shape.planes() - 1, 1.0);
        Ok(denoiser)
    }

    /// Size of the net.
    pub fn shape(&self) -> UnetShape {
        self.net.shape
    }

    /// Clears the history, for a new sequence.
    pub fn reset(&mut self) {
        self.history.fill(0.0);
        self.silent = true;
        self.pushed = 0;
    }

    /// As [`Denoiser::push_frame_into`], for a net with one image per frame and no conditions.
    ///
    /// # Errors
    /// Those of [`Denoiser::push_frame_into`].
    pub fn push_into(
        &mut self,
        image: ArrayView2<'_, f64>,
        out: ArrayViewMut2<'_, f64>,
    ) -> Result<NetStatus, DenoiseError> {
        self.push_frame_into(NetFrame { images: &[image], conditions: &[] }, out)
    }

    /// Takes the next frame of a sequence and writes the denoised image; images and `out` are
    /// [row, column], `out` is NaN outside the mask. Pixels outside the mask are not read. A rejected
    /// frame leaves the sequence as it was.
    ///
    /// # Errors
    /// [`DenoiseError::WrongLength`] for another number of images or conditions;
    /// [`DenoiseError::ShapeMismatch`]; [`DenoiseError::NonFinitePixel`], frames counted since the
    /// last reset; [`DenoiseError::OutOfRange`] for a condition that is not finite;
    /// [`DenoiseError::ConstantImage`] where one value other than zero fills the first image.
    pub fn push_frame_into(
        &mut self,
        frame: NetFrame<'_>,
        out: ArrayViewMut2<'_, f64>,
    ) -> Result<NetStatus, DenoiseError> {
        self.check_frame(&frame)?;
        let mut sizes = frame.images.iter().map(|image| image.dim()).chain([out.dim()]);
        sizes.try_for_each(|found| DenoiseError::check_size(found, self.mask.dim()))?;
        let is_zero = self.is_zero(frame.images[0]);
        if self.silent && is_zero {
            self.pushed += 1;
            self.write_zero(out);
            return Ok(NetStatus::Zero);
        }
        frame.images.iter().try_for_each(|image| self.check_finite(*image))?;
        self.check_constant(frame.images[0])?;
        self.take(frame.images, is_zero);
        self.pushed += 1;
        let UnetShape { images, history, .. } = self.net.shape;
        let firsts = self.history.chunks_exact(self.places.len()).step_by(images).flatten();
        let scale = firsts.fold(0.0_f64, |most, v| v.abs().max(most));
        self.silent = scale == 0.0;
        if self.silent {
            self.write_zero(out);
            return Ok(NetStatus::Zero);
        }
        self.fill_images(scale);
        for (k, condition) in frame.conditions.iter().enumerate() {
            self.fill_input(history * images + k, *condition as f32);
        }
        self.arch.dispatch(Run(&mut self.net));
        self.write_image(scale, out);
        Ok(NetStatus::Computed)
    }

    /// Fills the inputs of all images of the history, divided by their scale.
    fn fill_images(&mut self, scale: f64) {
        let Self { net, history, places, .. } = self;
        let UnetShape { images, fold, .. } = net.shape;
        let level = &mut net.levels[0];
        let planes = level.input.chunks_exact_mut(fold * fold * level.plane.len());
        for (k, (planes, image)) in planes.zip(history.chunks_exact(places.len())).enumerate() {
            let most = if k % images == 0 { 1.0 } else { CLAMP };
            for (place, value) in places.iter().zip(image) {
                planes[*place] = ((value / scale) as f32).clamp(-most, most);
            }
        }
    }

    /// Writes what the net has computed, times the scale; a net of several images corrects the first of the last frame.
    fn write_image(&self, scale: f64, mut out: ArrayViewMut2<'_, f64>) {
        let UnetShape { images, history, fold, .. } = self.net.shape;
        let (plane, image) = (self.net.levels[0].plane, &self.net.image);
        if images == 1 && fold == 1 {
            for ((row, mut out), mask) in out.outer_iter_mut().enumerate().zip(self.mask.rows()) {
                let values = &image[plane.row(row)..];
                for ((out, value), inside) in out.iter_mut().zip(values).zip(mask) {
                    *out = if *inside { scale * f64::from(*value) } else { f64::NAN };
                }
            }
            return;
        }
        out.fill(f64::NAN);
        let masked = out.iter_mut().zip(&self.mask).filter(|(_, inside)| **inside);
        let masked = masked.map(|(out, _)| out).zip(&self.places);
        if images == 1 {
            masked.for_each(|(out, place)| *out = scale * f64::from(image[*place]));
            return;
        }
        let first = &self.history[(history - 1) * images * self.places.len()..];
        for ((out, place), first) in masked.zip(first) {
            *out = scale.mul_add(f64::from(image[*place]), *first);
        }
    }

    /// Fills an input with one value inside the mask.
    fn fill_input(&mut self, input: usize, value: f32) {
        let level = &mut self.net.levels[0];
        let fold = self.net.shape.fold;
        let first = input * fold * fold * level.plane.len();
        for place in &self.places {
            level.input[first + place] = value;
        }
    }

    /// Appends the images of a frame to the history; zeros where the first of them is zero.
    fn take(&mut self, images: &[ArrayView2<'_, f64>], is_zero: bool) {
        let Self { history, mask, places, .. } = self;
        let of_frame = images.len() * places.len();
        history.copy_within(of_frame.., 0);
        let mut next = history.len() - of_frame;
        if is_zero {
            return history[next..].fill(0.0);
        }
        for image in images {
            // plain loops: an iterator of zipped and filtered views took a fifth of a frame's time
            for row in 0..image.nrows() {
                for column in 0..image.ncols() {
                    if mask[[row, column]] {
                        history[next] = image[[row, column]];
                        next += 1;
                    }
                }
            }
        }
    }

    /// Rejects another number of images or conditions, and conditions that are not finite.
    fn check_frame(&self, frame: &NetFrame<'_>) -> Result<(), DenoiseError> {
        let UnetShape { images, conditions, .. } = self.net.shape;
        DenoiseError::check_length("images per frame", frame.images.len(), images)?;
        DenoiseError::check_length("conditions per frame", frame.conditions.len(), conditions)?;
        frame.conditions.iter().try_for_each(|&value| {
            DenoiseError::check_range(value.is_finite(), "a condition", value, "finite")
        })
    }

    /// Whether all masked pixels are zero. Stops after the first run that is not; within a run it
    /// does not branch.
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

    fn check_finite(&self, image: ArrayView2<'_, f64>) -> Result<(), DenoiseError> {
        let bad = image.indexed_iter().find(|(at, value)| self.mask[*at] && !value.is_finite());
        match bad {
            Some(((row, column), &value)) => {
                let frame = self.pushed;
                Err(DenoiseError::NonFinitePixel { frame, row, column, value })
            }
            None => Ok(()),
        }
    }

    fn check_constant(&self, image: ArrayView2<'_, f64>) -> Result<(), DenoiseError> {
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for (value, _) in image.iter().zip(&self.mask).filter(|(_, inside)| **inside) {
            (least, most) = (least.min(*value), most.max(*value));
        }
        if least == most && most != 0.0 && self.places.len() > 1 {
            return Err(DenoiseError::ConstantImage { value: most }.in_frame(self.pushed));
        }
        Ok(())
    }

    /// Denoises a whole sequence from its start with a net that takes one image per frame; the same
    /// bits as frame by frame.
    ///
    /// # Errors
    /// Those of [`Denoiser::denoise_with`].
    pub fn denoise(&mut self, raw: &ImageStack) -> Result<ImageStack, DenoiseError> {
        self.denoise_with(raw, &[], None)
    }

    /// Denoises a whole sequence from its start: `raw` images, the `others` that the net takes in
    /// addition, each [frame, row, column], and `conditions` [frame, condition], `None` for none. A raw image with the
    /// same non-zero value everywhere, which total variation may produce from noise, is returned unchanged
    /// and does not reach the net.
    ///
    /// # Errors
    /// Those of [`Denoiser::push_frame_into`]; [`DenoiseError::MaskMismatch`] for the images of
    /// another skin; [`DenoiseError::WrongLength`] for inputs of other lengths.
    pub fn denoise_with(
        &mut self,
        raw: &ImageStack,
        others: &[ArrayView3<'_, f64>],
        conditions: Option<ArrayView2<'_, f64>>,
    ) -> Result<ImageStack, DenoiseError> {
        DenoiseError::check_mask(raw.mask(), self.mask.view())?;
        let wanted = raw.frames();
        let lengths = others.iter().map(|images| ("other images", images.dim().0));
        let mut lengths = lengths.chain(conditions.map(|c| ("frames of conditions", c.nrows())));
        lengths.try_for_each(|(what, found)| DenoiseError::check_length(what, found, wanted))?;
        self.reset();
        let mut values = raw.values().to_owned();
        let mut images = Vec::with_capacity(1 + others.len());
        for (frame, out) in values.outer_iter_mut().enumerate() {
            images.clear();
            images.push(raw.frame(frame)?);
            images.extend(others.iter().map(|o| o.index_axis_move(Axis(0), frame)));
            let of_frame = conditions.map_or(Vec::new(), |all| all.row(frame).to_vec());
            match self.push_frame_into(NetFrame { images: &images, conditions: &of_frame }, out) {
                // `out` still has the raw image
                Err(DenoiseError::InFrame { error, .. })
                    if matches!(*error, DenoiseError::ConstantImage { .. }) =>
                {
                    self.pushed += 1;
                }
                made => {
                    made?;
                }
            }
        }
        ImageStack::new(values, self.mask.clone())
    }
}

/// Offset of a pixel in the planes of one input: each place in a block has a plane.
fn place(plane: Plane, fold: usize, row: usize, column: usize) -> usize {
    let block = (row % fold) * fold + column % fold;
    block * plane.len() + plane.row(row / fold) + column / fold
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
