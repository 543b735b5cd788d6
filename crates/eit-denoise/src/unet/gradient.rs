//! The derivative of the squared error by all weights, by reverse accumulation through the net.
//!
//! Each layer of the net has its own planes here, so that what it let through is still there on the
//! way back. Written out by hand: the net has four operations, and their derivatives are shorter
//! than the interface to a framework; a Taylor test (`tests/train.rs`) holds them to the net that
//! runs on frames.

use super::UnetShape;
use super::kernel::{
    Packed, Plane, add_halve_derivative, add_weight_gradient, double, double_derivative, halve,
    mask_derivative,
};
use super::shape::Convolution;
use pulp::{Arch, Simd, WithSimd};

/// One example, normalised as in [`super::Denoiser`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Example<'a> {
    /// Frames oldest first, divided by their scale, `[history][pixel]`, zero outside the mask.
    pub frames: &'a [f32],
    /// What should come out, `[pixel]`, divided by the same scale, zero outside the mask.
    pub wanted: &'a [f32],
    /// Pixels that count, `[pixel]`.
    pub mask: &'a [bool],
    /// Rows and columns.
    pub size: [usize; 2],
    /// What the squared error is multiplied by.
    pub weight: f32,
}

/// Weights packed for both directions: one for all threads.
#[derive(Debug, Clone)]
pub(crate) struct PackedNet {
    shape: UnetShape,
    convolutions: Vec<Convolution>,
    forward: Vec<Packed>,
    backward: Vec<Packed>,
    head: Vec<f32>,
    head_bias: f32,
}

impl PackedNet {
    /// Packs as many parameters as the shape has.
    pub fn new(shape: UnetShape, parameters: &[f32]) -> Self {
        let convolutions = shape.convolutions();
        let (mut forward, mut backward) = (Vec::new(), Vec::new());
        let (mut head, mut head_bias) = (Vec::new(), 0.0);
        let mut rest = parameters;
        for c in &convolutions {
            let (weights, others) = rest.split_at(c.weights());
            let (biases, others) = others.split_at(c.outputs);
            rest = others;
            if c.side == 1 {
                (head, head_bias) = (weights.to_vec(), biases.iter().sum());
            } else {
                forward.push(Packed::new(weights, biases, c.inputs));
                backward.push(Packed::adjoint(weights, c.inputs, c.outputs));
            }
        }
        Self { shape, convolutions, forward, backward, head, head_bias }
    }
}

/// Values and derivatives of one layer.
#[derive(Debug, Clone)]
struct Layer {
    plane: Plane,
    input: Vec<f32>,
    output: Vec<f32>,
    d_input: Vec<f32>,
    d_output: Vec<f32>,
}

/// Memory of one example.
#[derive(Debug, Clone)]
pub(crate) struct Tape {
    layers: Vec<Layer>,
    d_image: Vec<f32>,
    arch: Arch,
}

impl Tape {
    /// For images of this size.
    pub fn new(shape: UnetShape, size: [usize; 2]) -> Self {
        let [rows, columns] = shape.padded(size);
        let levels = (0..=shape.depth).chain((0..shape.depth).rev()).flat_map(|l| [l, l]);
        let layer = |(level, c): (usize, &Convolution)| {
            let plane = Plane { rows: rows >> level, columns: columns >> level };
            let planes = |channels: usize| vec![0.0; channels * plane.len()];
            Layer {
                plane,
                input: planes(c.inputs),
                output: planes(c.outputs),
                d_input: planes(c.inputs),
                d_output: planes(c.outputs),
            }
        };
        let layers: Vec<Layer> = levels.zip(&shape.convolutions()).map(layer).collect();
        let image = vec![0.0; layers[0].plane.len()];
        Self { layers, d_image: image, arch: Arch::new() }
    }

    /// Weighted mean squared error of an example over its masked pixels; adds its derivative by the
    /// parameters times `weight` to `gradient`, where there is one.
    pub fn run(
        &mut self,
        net: &PackedNet,
        example: &Example<'_>,
        gradient: Option<(f32, &mut [f32])>,
    ) -> f64 {
        let arch = self.arch;
        arch.dispatch(Step { tape: self, net, example, gradient })
    }
}

struct Step<'a> {
    tape: &'a mut Tape,
    net: &'a PackedNet,
    example: &'a Example<'a>,
    gradient: Option<(f32, &'a mut [f32])>,
}

impl WithSimd for Step<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { tape, net, example, gradient } = self;
        tape.take(example);
        tape.forward(net);
        let weight = gradient.as_ref().map_or(0.0, |(weight, _)| *weight);
        let error = tape.compare(net, example, weight);
        if let Some((_, gradient)) = gradient {
            tape.backward(net, gradient);
        }
        error
    }
}

impl Tape {
    #[inline(always)]
    fn take(&mut self, example: &Example<'_>) {
        let [_, columns] = example.size;
        let first = &mut self.layers[0];
        let pixels = example.mask.len();
        let channels = example.frames.len() / pixels;
        for (k, channel) in first.input.chunks_exact_mut(first.plane.len()).enumerate() {
            for row in 0..example.size[0] {
                let out = &mut channel[first.plane.row(row)..][..columns];
                let from = row * columns;
                if k < channels {
                    out.copy_from_slice(&example.frames[k * pixels + from..][..columns]);
                } else {
                    for (out, inside) in out.iter_mut().zip(&example.mask[from..]) {
                        *out = f32::from(u8::from(*inside));
                    }
                }
            }
        }
    }

    /// Layer `2 l` and the next are level `l` on the way down; on the way up they follow.
    #[inline(always)]
    fn forward(&mut self, net: &PackedNet) {
        let depth = net.shape.depth;
        for (k, packed) in net.forward.iter().enumerate() {
            let (before, after) = self.layers.split_at_mut(k);
            let here = &mut after[0];
            match before.last() {
                None => {}
                // the second convolution of a level
                Some(last) if k % 2 == 1 => here.input.copy_from_slice(&last.output),
                Some(last) if k / 2 <= depth => {
                    halve(last.plane, &last.output, here.plane, &mut here.input);
                }
                Some(last) => {
                    let own = &before[twin(depth, k)].output;
                    let (left, right) = here.input.split_at_mut(own.len());
                    left.copy_from_slice(own);
                    double(last.plane, &last.output, here.plane, right);
                }
            }
            packed.run::<true>(here.plane, &here.input, &mut here.output);
        }
    }

    /// The head, the error, and the derivative of `weight` times the error by the image.
    #[inline(always)]
    fn compare(&mut self, net: &PackedNet, example: &Example<'_>, weight: f32) -> f64 {
        let [rows, columns] = example.size;
        let Some(last) = self.layers.last() else { return 0.0 };
        let len = last.plane.len();
        let count = example.mask.iter().filter(|inside| **inside).count().max(1) as f64;
        let weight_here = f64::from(example.weight);
        let step = (2.0 * f64::from(weight) * weight_here / count) as f32;
        let mut error = 0.0;
        self.d_image.fill(0.0);
        for row in 0..rows {
            for column in 0..columns {
                let (at, pixel) = (last.plane.row(row) + column, row * columns + column);
                if !example.mask[pixel] {
                    continue;
                }
                let channels = net.head.iter().zip(last.output.chunks_exact(len));
                let value =
                    channels.fold(net.head_bias, |sum, (w, plane)| w.mul_add(plane[at], sum));
                let off = value - example.wanted[pixel];
                error += f64::from(off) * f64::from(off);
                self.d_image[at] = step * off;
            }
        }
        weight_here * error / count
    }

    /// From the derivative by the image to those by the weights.
    #[inline(always)]
    fn backward(&mut self, net: &PackedNet, gradient: &mut [f32]) {
        let depth = net.shape.depth;
        let head = gradient.len() - net.head.len() - 1;
        let (mut rest, of_head) = gradient.split_at_mut(head);
        let Some(last) = self.layers.last_mut() else { return };
        let len = last.plane.len();
        let planes = last.output.chunks_exact(len).zip(last.d_output.chunks_exact_mut(len));
        for (k, (output, d_output)) in planes.enumerate() {
            let values = output.iter().zip(&self.d_image);
            of_head[k] += values.map(|(v, d)| v * d).sum::<f32>();
            for (out, d) in d_output.iter_mut().zip(&self.d_image) {
                *out = net.head[k] * d;
            }
        }
        of_head[net.head.len()] += self.d_image.iter().sum::<f32>();
        // derivatives that come from two sides are added to
        for layer in self.layers.iter_mut().take(2 * depth) {
            layer.d_output.fill(0.0);
        }
        for (k, packed) in net.backward.iter().enumerate().rev() {
            let c = &net.convolutions[k];
            let (others, own) = rest.split_at_mut(rest.len() - c.weights() - c.outputs);
            rest = others;
            let (weights, biases) = own.split_at_mut(c.weights());
            let (before, after) = self.layers.split_at_mut(k);
            let here = &mut after[0];
            mask_derivative(&here.output, &mut here.d_output);
            add_weight_gradient(here.plane, &here.input, &here.d_output, weights, biases);
            if k == 0 {
                continue;
            }
            packed.run::<false>(here.plane, &here.d_output, &mut here.d_input);
            let twin = twin(depth, k);
            if k % 2 == 0 && k / 2 > depth {
                let own = before[twin].output.len();
                for (out, d) in before[twin].d_output.iter_mut().zip(&here.d_input[..own]) {
                    *out += d;
                }
                let last = &mut before[k - 1];
                double_derivative(last.plane, here.plane, &here.d_input[own..], &mut last.d_output);
                continue;
            }
            let last = &mut before[k - 1];
            if k % 2 == 1 {
                last.d_output.copy_from_slice(&here.d_input);
            } else {
                let (from, to) = (last.plane, here.plane);
                add_halve_derivative(from, &last.output, to, &here.d_input, &mut last.d_output);
            }
        }
    }
}

/// The layer on the way down whose output joins the input of layer `k` on the way up.
#[inline(always)]
fn twin(depth: usize, k: usize) -> usize {
    // level of layer k: 2 depth - k / 2; its second convolution
    2 * (2 * depth).saturating_sub(k / 2) + 1
}
