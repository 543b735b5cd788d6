//! Convolutions of a net, the planes between them, and one image through them.

use super::kernel::{Packed, Plane, double, halve};
use super::{UnetShape, Weights};
use pulp::{Simd, WithSimd};

/// Convolutions and the planes between them.
#[derive(Debug, Clone)]
pub(super) struct Net {
    pub(super) shape: UnetShape,
    convolutions: Vec<Packed>,
    head: Vec<f32>,
    head_bias: f32,
    pub(super) levels: Vec<Level>,
    pub(super) image: Vec<f32>,
}

/// Memory of one level.
#[derive(Debug, Clone)]
pub(super) struct Level {
    pub(super) plane: Plane,
    pub(super) input: Vec<f32>,
    /// Between two convolutions.
    middle: Vec<f32>,
    /// The level's own channels, then those from below.
    joined: Vec<f32>,
    /// What goes up.
    output: Vec<f32>,
}

impl Net {
    /// Packs valid weights and reserves all planes.
    pub(super) fn new(weights: &Weights, size: [usize; 2]) -> Self {
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
pub(super) struct Run<'a>(pub(super) &'a mut Net);

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
            first.run(here.plane, &here.input, &mut here.middle);
            if let Some(below) = below.first_mut() {
                second.run(here.plane, &here.middle, &mut here.joined);
                halve(here.plane, &here.joined, below.plane, &mut below.input);
            } else {
                second.run(here.plane, &here.middle, &mut here.output);
            }
        }
        for level in (0..shape.depth).rev() {
            let Some([first, second]) = next.next() else { return };
            let (above, below) = levels.split_at_mut(level + 1);
            let (here, below) = (&mut above[level], &below[0]);
            let own = shape.channels(level) * here.plane.len();
            double(below.plane, &below.output, here.plane, &mut here.joined[own..]);
            first.run(here.plane, &here.joined, &mut here.middle);
            second.run(here.plane, &here.middle, &mut here.output);
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
