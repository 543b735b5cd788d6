//! The U-net as a burn module, with the same layers in the same order and the same names in files as
//! the allocation-free [`crate::Denoiser`].

use super::ImageNet;
use crate::unet::Convolution;
use crate::{DenoiseError, UnetShape};
use burn::module::{Module, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Initializer, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::module::{interpolate, max_pool2d};
use burn::tensor::ops::{InterpolateMode, InterpolateOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData};
use eit_core::Random;

/// Initial biases.
const FIRST_BIAS: f32 = 0.05;

/// Normal weights of He, Zhang, Ren and Sun (ICCV 2015), minus the mean over each channel. Inputs
/// of a channel come from ReLUs and have a positive mean: a channel with a negative mean weight
/// would be zero on nearly the whole skin, where its gradient is zero, and with few channels soon
/// all of them would be. Small positive biases serve the same purpose.
fn first_weights(c: Convolution, random: &mut Random) -> Vec<f32> {
    let of_channel = c.inputs * c.side * c.side;
    let std = (2.0 / of_channel as f64).sqrt();
    let mut weights = Vec::with_capacity(c.weights());
    for _ in 0..c.outputs {
        let channel: Vec<f64> = (0..of_channel).map(|_| random.normal()).collect();
        let mean = channel.iter().sum::<f64>() / of_channel as f64;
        weights.extend(channel.iter().map(|w| (std * (w - mean)) as f32));
    }
    weights
}

/// A convolution that keeps the size of its inputs.
fn convolution(c: Convolution, weights: Vec<f32>, biases: Vec<f32>, device: &Device) -> Conv2d {
    let reach = c.side / 2;
    let layer = Conv2dConfig::new([c.inputs, c.outputs], [c.side; 2])
        .with_padding(PaddingConfig2d::Explicit(reach, reach, reach, reach))
        .with_initializer(Initializer::Zeros)
        .init(device);
    let weights = TensorData::new(weights, [c.outputs, c.inputs, c.side, c.side]);
    let biases = TensorData::new(biases, [c.outputs]);
    Conv2d {
        weight: Param::from_data(weights, device),
        bias: Some(Param::from_data(biases, device)),
        ..layer
    }
}

/// The U-net of [`UnetShape`] as a burn module, made by [`Unet::new`] or [`Unet::from_bytes`].
#[derive(Module, Debug)]
pub struct Unet {
    /// Pairs of convolutions on the way down, the largest images first.
    down: Vec<[Conv2d; 2]>,
    bottom: [Conv2d; 2],
    /// Pairs of convolutions on the way up, by level as in `down`: the last one runs first.
    up: Vec<[Conv2d; 2]>,
    head: Conv2d,
    #[module(skip)]
    shape: UnetShape,
}

impl Unet {
    /// Initialises an untrained net. The same seed gives the same bits on any device.
    ///
    /// # Errors
    /// Those of [`UnetShape::validate`].
    pub fn new(shape: UnetShape, seed: u64, device: &Device) -> Result<Self, DenoiseError> {
        shape.validate()?;
        let mut random = Random::new(seed);
        let mut made = shape.convolutions().into_iter().map(|c| match c.side {
            // a net that corrects an image starts with no correction
            1 if shape.images > 1 => {
                convolution(c, vec![0.0; c.weights()], vec![0.0; c.outputs], device)
            }
            _ => {
                let weights = first_weights(c, &mut random);
                convolution(c, weights, vec![FIRST_BIAS; c.outputs], device)
            }
        });
        Self::of_convolutions(shape, &mut made)
    }

    /// A net of zeros, for loading.
    pub(super) fn zeros(shape: UnetShape, device: &Device) -> Result<Self, DenoiseError> {
        shape.validate()?;
        let zeros =
            |c: Convolution| convolution(c, vec![0.0; c.weights()], vec![0.0; c.outputs], device);
        Self::of_convolutions(shape, &mut shape.convolutions().into_iter().map(zeros))
    }

    /// Builds the net from its convolutions in the order in which they run.
    fn of_convolutions(
        shape: UnetShape,
        list: &mut dyn Iterator<Item = Conv2d>,
    ) -> Result<Self, DenoiseError> {
        let (wanted, mut found) = (shape.convolutions().len(), 0);
        let mut next = || {
            found += 1;
            let missing =
                DenoiseError::WrongLength { what: "convolutions", found: found - 1, wanted };
            list.next().ok_or(missing)
        };
        let mut pair = || Ok::<_, DenoiseError>([next()?, next()?]);
        let down = (0..shape.depth).map(|_| pair()).collect::<Result<_, _>>()?;
        let bottom = pair()?;
        let mut up: Vec<_> = (0..shape.depth).map(|_| pair()).collect::<Result<_, _>>()?;
        up.reverse();
        Ok(Self { down, bottom, up, head: next()?, shape })
    }

    /// Returns its size.
    pub fn shape(&self) -> UnetShape {
        self.shape
    }
}

/// Two convolutions, each followed by a ReLU.
fn through([first, second]: &[Conv2d; 2], x: Tensor<4>) -> Tensor<4> {
    relu(second.forward(relu(first.forward(x))))
}

/// Blocks of `fold` x `fold` pixels as channels: channel `(k fold + y) fold + x` holds pixel `[y, x]` of
/// each block of channel `k`.
fn folded(x: Tensor<4>, fold: usize) -> Tensor<4> {
    if fold == 1 {
        return x;
    }
    let [examples, channels, rows, columns] = x.dims();
    let [rows, columns] = [rows / fold, columns / fold];
    x.reshape([examples, channels, rows, fold, columns, fold])
        .permute([0, 1, 3, 5, 2, 4])
        .reshape([examples, channels * fold * fold, rows, columns])
}

/// The inverse of [`folded`].
fn unfolded(x: Tensor<4>, fold: usize) -> Tensor<4> {
    if fold == 1 {
        return x;
    }
    let [examples, channels, rows, columns] = x.dims();
    let channels = channels / (fold * fold);
    x.reshape([examples, channels, fold, fold, rows, columns])
        .permute([0, 1, 4, 2, 5, 3])
        .reshape([examples, channels, rows * fold, columns * fold])
}

impl ImageNet for Unet {
    fn forward(&self, inputs: Tensor<4>) -> Tensor<4> {
        let UnetShape { history, images, .. } = self.shape;
        // a net of several images corrects the first of the last frame
        let first = (images > 1).then(|| inputs.clone().narrow(1, (history - 1) * images, 1));
        let mut now = folded(inputs, self.shape.fold);
        let mut skips = Vec::with_capacity(self.down.len());
        for pair in &self.down {
            now = through(pair, now);
            skips.push(now.clone());
            now = max_pool2d(now, MaxPoolOptions::new([2, 2]).with_stride([2, 2]));
        }
        now = through(&self.bottom, now);
        for (pair, skip) in self.up.iter().zip(skips).rev() {
            let twice = InterpolateOptions::new(InterpolateMode::Nearest);
            let doubled = interpolate(now, twice.with_scale_factor([2.0, 2.0]));
            now = through(pair, Tensor::cat(vec![skip, doubled], 1));
        }
        let made = unfolded(self.head.forward(now), self.shape.fold);
        match first {
            Some(first) => made + first,
            None => made,
        }
    }

    fn images(&self) -> usize {
        self.shape.images
    }

    fn conditions(&self) -> usize {
        self.shape.conditions
    }

    fn history(&self) -> usize {
        self.shape.history
    }

    fn multiple(&self) -> usize {
        self.shape.multiple()
    }

    fn name(&self) -> String {
        let UnetShape { history, width, depth, images, conditions, fold } = self.shape;
        format!(
            "U-net, history {history}, width {width}, depth {depth}, images {images}, conditions \
             {conditions}, fold {fold}"
        )
    }
}
