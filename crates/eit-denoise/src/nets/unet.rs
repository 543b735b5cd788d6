//! The U-net as a module of burn: the same layers, in the same order and with the same names in
//! files, as the one that runs on frames ([`crate::Denoiser`]).

use super::ImageNet;
use crate::unet::Convolution;
use crate::{DenoiseError, UnetShape};
use burn::config::Config;
use burn::module::{Module, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Initializer, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::module::{interpolate, max_pool2d};
use burn::tensor::ops::{InterpolateMode, InterpolateOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData};
use rand_distr::{Distribution as _, StandardNormal};
use rand_pcg::Pcg64;

/// Biases before the first step.
const FIRST_BIAS: f32 = 0.05;

/// Size of a [`Unet`] and the seed of its first weights; [`UnetShape`] says what the sizes are.
#[derive(Config, Debug)]
pub struct UnetConfig {
    /// Last frames that it sees, the present one included: 1 to 16.
    pub history: usize,
    /// Channels of the first level: 1 to 128.
    pub width: usize,
    /// Times that pixels are halved: 1 to 6.
    pub depth: usize,
    /// Where the first weights come from.
    #[config(default = 1)]
    pub seed: u64,
}

impl From<UnetShape> for UnetConfig {
    fn from(UnetShape { history, width, depth }: UnetShape) -> Self {
        Self::new(history, width, depth)
    }
}

impl UnetConfig {
    /// The size without the seed.
    pub fn shape(&self) -> UnetShape {
        UnetShape { history: self.history, width: self.width, depth: self.depth }
    }

    /// A net that has learnt nothing yet. The same seed gives the same bits on any device.
    ///
    /// # Errors
    /// Those of [`UnetShape::validate`].
    pub fn init(&self, device: &Device) -> Result<Unet, DenoiseError> {
        let shape = self.shape();
        shape.validate()?;
        let mut random = Pcg64::new(u128::from(self.seed), 0);
        let mut made = shape.convolutions().into_iter().map(|c| {
            let weights = first_weights(c, &mut random);
            convolution(c, weights, vec![FIRST_BIAS; c.outputs], device)
        });
        Unet::of_convolutions(shape, &mut made)
    }

    /// A net of zeros, to be loaded.
    pub(super) fn zeros(&self, device: &Device) -> Result<Unet, DenoiseError> {
        let shape = self.shape();
        shape.validate()?;
        let mut made = shape
            .convolutions()
            .into_iter()
            .map(|c| convolution(c, vec![0.0; c.weights()], vec![0.0; c.outputs], device));
        Unet::of_convolutions(shape, &mut made)
    }
}

/// He's normal weights (He, Zhang, Ren and Sun, ICCV 2015), the weights of each channel less their
/// mean. Inputs of a channel are positive parts, so that most of what it sees is their mean: a channel
/// that happens to weigh it negatively would be zero on nearly the whole skin, and with few channels
/// soon all of them, from where no derivative leads back. Small positive biases serve the same end.
fn first_weights(c: Convolution, random: &mut Pcg64) -> Vec<f32> {
    let of_channel = c.inputs * c.side * c.side;
    let std = (2.0 / of_channel as f64).sqrt();
    let mut weights = Vec::with_capacity(c.weights());
    for _ in 0..c.outputs {
        let channel: Vec<f64> =
            (0..of_channel).map(|_| StandardNormal.sample(&mut *random)).collect();
        let mean = channel.iter().sum::<f64>() / of_channel as f64;
        weights.extend(channel.iter().map(|w| (std * (w - mean)) as f32));
    }
    weights
}

/// A convolution with equal padding.
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

/// The U-net of [`UnetShape`] as a module of burn; made by [`UnetConfig::init`], or from weights
/// ([`Unet::from_bytes`]).
#[derive(Module, Debug)]
pub struct Unet {
    /// Pairs of the levels on the way down, the largest images first.
    down: Vec<[Conv2d; 2]>,
    bottom: [Conv2d; 2],
    /// Pairs of the levels on the way up, by level as in `down`: the last one runs first.
    up: Vec<[Conv2d; 2]>,
    head: Conv2d,
    #[module(skip)]
    shape: UnetShape,
}

impl Unet {
    /// From all convolutions in the order in which they run.
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

    /// Its size.
    pub fn shape(&self) -> UnetShape {
        self.shape
    }
}

/// Two convolutions, each followed by the positive part.
fn through([first, second]: &[Conv2d; 2], x: Tensor<4>) -> Tensor<4> {
    relu(second.forward(relu(first.forward(x))))
}

impl ImageNet for Unet {
    fn forward(&self, inputs: Tensor<4>) -> Tensor<4> {
        let mut now = inputs;
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
        self.head.forward(now)
    }

    fn history(&self) -> usize {
        self.shape.history
    }

    fn multiple(&self) -> usize {
        1 << self.shape.depth
    }

    fn name(&self) -> String {
        let UnetShape { history, width, depth } = self.shape;
        format!("U-net, history {history}, width {width}, depth {depth}")
    }
}
