//! Convolutions of a net, the planes between them, and one pass through them.

use super::kernel::{Packed, Plane, double, halve};
use super::{UnetShape, Weights};
use pulp::{Simd, WithSimd};

/// Convolutions and the planes between them.
#[derive(Debug, Clone)]
pub(super) struct Net {
    pub(super) shape: UnetShape,
    convolutions: Vec<Packed>,
    /// Weights of the last convolution, [output, channel].
    head: Vec<f32>,
    head_biases: Vec<f32>,
    pub(super) levels: Vec<Level>,
    /// Planes of the result, one for each place in a block of folded pixels.
    pub(super) image: Vec<f32>,
}

/// Memory of one level.
#[derive(Debug, Clone)]
pub(super) struct Level {
    pub(super) plane: Plane,
    pub(super) input: Vec<f32>,
    /// Between the two convolutions of the level.
    middle: Vec<f32>,
    /// The level's own channels, then those from below.
    joined: Vec<f32>,
    /// Result of the level.
    output: Vec<f32>,
}

impl Net {
    /// Packs valid weights and allocates all planes.
    pub(super) fn new(weights: &Weights, size: [usize; 2]) -> Self {
        let shape = weights.shape;
        let [rows, columns] = shape.first_level(size);
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
        let (mut head, mut head_biases) = (Vec::new(), Vec::new());
        let mut rest = weights.parameters.as_slice();
        for convolution in shape.convolutions() {
            let (own, others) = rest.split_at(convolution.weights());
            let (biases, others) = others.split_at(convolution.outputs);
            rest = others;
            match convolution.side {
                1 => (head, head_biases) = (own.to_vec(), biases.to_vec()),
                _ => convolutions.push(Packed::new(own, biases, convolution.inputs)),
            }
        }
        let levels = (0..=shape.depth).map(level).collect();
        let image = planes(0, shape.outputs());
        Self { shape, convolutions, head, head_biases, levels, image }
    }
}

/// One pass through the net.
pub(super) struct Run<'a>(pub(super) &'a mut Net);

impl WithSimd for Run<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Net { shape, convolutions, head, head_biases, levels, image } = self.0;
        let mut next = convolutions.chunks_exact(2);
        for level in 0..=shape.depth {
            let Some([first, second]) = next.next() else { return };
            let (above, below) = levels.split_at_mut(level + 1);
            let here = &mut above[level];
            first.run(simd, here.plane, &here.input, &mut here.middle);
            if let Some(below) = below.first_mut() {
                second.run(simd, here.plane, &here.middle, &mut here.joined);
                halve(here.plane, &here.joined, below.plane, &mut below.input);
            } else {
                second.run(simd, here.plane, &here.middle, &mut here.output);
            }
        }
        for level in (0..shape.depth).rev() {
            let Some([first, second]) = next.next() else { return };
            let (above, below) = levels.split_at_mut(level + 1);
            let (here, below) = (&mut above[level], &below[0]);
            let own = shape.channels(level) * here.plane.len();
            double(below.plane, &below.output, here.plane, &mut here.joined[own..]);
            first.run(simd, here.plane, &here.joined, &mut here.middle);
            second.run(simd, here.plane, &here.middle, &mut here.output);
        }
        let top = &levels[0];
        let outputs = image.chunks_exact_mut(top.plane.len());
        let heads = head.chunks_exact(shape.channels(0)).zip(head_biases);
        for (output, (head, bias)) in outputs.zip(heads) {
            output.fill(*bias);
            for (weight, plane) in head.iter().zip(top.output.chunks_exact(top.plane.len())) {
                for (sum, value) in output.iter_mut().zip(plane) {
                    *sum = weight.mul_add(*value, *sum);
                }
            }
        }
    }
}
