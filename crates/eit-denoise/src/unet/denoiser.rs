//! Images through a trained net, frame by frame, in memory that is reserved once.

use super::kernel::{Packed, Plane, double, halve};
use super::{UnetShape, Weights};
use crate::{DenoiseError, ImageStack};
use ndarray::{Array2, ArrayView2, ArrayViewMut2, Axis};
use pulp::{Arch, Simd, WithSimd};

/// A U-net ready for the images of one skin.
///
/// `D(x) = s N(x / s, mask)` with the net `N` and `s` the largest magnitude inside the mask over the
/// frames that the net sees, so that scaling the images scales the result; images of zero give
/// zero. Frames before the first count as zero, an untouched skin. Images are `f64` in any unit,
/// the arithmetic is `f32`: the same bits for a stack and for its frames one by one, on every
/// machine whose compiler fuses multiply and add alike.
///
/// Nothing is allocated after [`Denoiser::new`].
#[derive(Debug, Clone)]
pub struct Denoiser {
    net: Net,
    mask: Array2<bool>,
    /// Last raw images inside the mask, oldest first, `[history][masked pixel]`.
    history: Vec<f64>,
    /// Places of masked pixels in a plane.
    places: Vec<usize>,
    pushed: usize,
    arch: Arch,
}

/// Convolutions and the planes between them.
#[derive(Debug, Clone)]
struct Net {
    shape: UnetShape,
    convolutions: Vec<Packed>,
    head: Vec<f32>,
    head_bias: f32,
    levels: Vec<Level>,
    image: Vec<f32>,
}

/// Memory of one level.
#[derive(Debug, Clone)]
struct Level {
    plane: Plane,
    input: Vec<f32>,
    /// Between two convolutions.
    middle: Vec<f32>,
    /// The level's own channels, then those from below.
    joined: Vec<f32>,
    /// What goes up.
    output: Vec<f32>,
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
        let mut denoiser =
            Self { net, mask: mask.to_owned(), history, places, pushed: 0, arch: Arch::new() };
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
        self.pushed = 0;
    }

    /// The next frame of a sequence: writes what the net makes of `image`, both [row, column], NaN
    /// outside the mask. Outside, `image` is not looked at. A frame that is refused leaves the
    /// sequence as it was.
    ///
    /// # Errors
    /// [`DenoiseError::ShapeMismatch`]; [`DenoiseError::NonFinitePixel`], frames counted since the
    /// last reset; [`DenoiseError::ConstantImage`] where one value other than zero fills the skin.
    pub fn push_into(
        &mut self,
        image: ArrayView2<'_, f64>,
        mut out: ArrayViewMut2<'_, f64>,
    ) -> Result<(), DenoiseError> {
        for found in [image.dim(), out.dim()] {
            if found != self.mask.dim() {
                let (images, mask) = ([found.0, found.1], [self.mask.nrows(), self.mask.ncols()]);
                return Err(DenoiseError::ShapeMismatch { images, mask });
            }
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
        self.net.image.fill(0.0);
        if scale > 0.0 {
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
        Ok(())
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

impl Net {
    /// Packs valid weights and reserves all planes.
    fn new(weights: &Weights, size: [usize; 2]) -> Self {
        let shape = weights.shape;
        let [rows, columns] = shape.padded(size);
        let plane = |level: usize| Plane { rows: rows >> level, columns: columns >> level };
        let planes = |level: usize, channels: usize| vec![0.0; channels * plane(level).len()];
        let level = |level: usize| {
            let channels = shape.channels(level);
            let below = if level < shape.depth { shape.channels(level + 1) } else { 0 };
            let inputs = level.checked_sub(1).map_or(shape.inputs(), |above| shape.channels(above));
            Level {
                plane: plane(level),
                input: planes(level, inputs),
                middle: planes(level, channels),
                joined: planes(level, channels + below),
                output: planes(level, channels),
            }
        };
        let mut convolutions = Vec::new();
        let (mut head, mut head_bias) = (Vec::new(), 0.0);
        let mut rest = weights.parameters.as_slice();
        for convolution in shape.convolutions() {
            let (own, others) = rest.split_at(convolution.weights());
            let (biases, others) = others.split_at(convolution.outputs);
            rest = others;
            match convolution.side {
                1 => (head, head_bias) = (own.to_vec(), biases.iter().sum()),
                _ => convolutions.push(Packed::new(own, biases, convolution.inputs)),
            }
        }
        let levels = (0..=shape.depth).map(level).collect();
        Self { shape, convolutions, head, head_bias, levels, image: planes(0, 1) }
    }
}

/// One image through the net.
struct Run<'a>(&'a mut Net);

impl WithSimd for Run<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Net { shape, convolutions, head, head_bias, levels, image } = self.0;
        let mut next = convolutions.chunks_exact(2);
        for level in 0..=shape.depth {
            let Some([first, second]) = next.next() else { return };
            let (above, below) = levels.split_at_mut(level + 1);
            let here = &mut above[level];
            first.run::<true>(here.plane, &here.input, &mut here.middle);
            if let Some(below) = below.first_mut() {
                second.run::<true>(here.plane, &here.middle, &mut here.joined);
                halve(here.plane, &here.joined, below.plane, &mut below.input);
            } else {
                second.run::<true>(here.plane, &here.middle, &mut here.output);
            }
        }
        for level in (0..shape.depth).rev() {
            let Some([first, second]) = next.next() else { return };
            let (above, below) = levels.split_at_mut(level + 1);
            let (here, below) = (&mut above[level], &below[0]);
            let own = shape.channels(level) * here.plane.len();
            double(below.plane, &below.output, here.plane, &mut here.joined[own..]);
            first.run::<true>(here.plane, &here.joined, &mut here.middle);
            second.run::<true>(here.plane, &here.middle, &mut here.output);
        }
        let top = &levels[0];
        image.fill(*head_bias);
        for (weight, plane) in head.iter().zip(top.output.chunks_exact(top.plane.len())) {
            for (sum, value) in image.iter_mut().zip(plane) {
                *sum = weight.mul_add(*value, *sum);
            }
        }
    }
}
