//! The same net in burn's tensors, and its derivative by burn. Nothing here is shared with our
//! kernels but the shape, the order of the parameters and the examples.

use super::choice::Engine;
use super::steps::Steps;
use crate::train::examples::{Examples, Turned};
use crate::{DenoiseError, UnetShape};
use burn_tensor::activation::relu;
use burn_tensor::module::{conv2d, interpolate, max_pool2d};
use burn_tensor::ops::{ConvOptions, InterpolateMode, InterpolateOptions, MaxPoolOptions};
use burn_tensor::{Device, Tensor, TensorData};

/// Examples that go through the net at once where no derivative is wanted: memory stays that of a
/// usual step.
const AT_ONCE: usize = 16;

/// The device of an engine.
///
/// # Errors
/// [`DenoiseError::NoEngine`], [`DenoiseError::NoDevice`].
pub(super) fn device(engine: Engine) -> Result<Device, DenoiseError> {
    // a device that is not there would be a panic at its first tensor
    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    let present = |kind: burn_tensor::DeviceType, device: Device| match Device::enumerate(kind)[..]
    {
        [] => Err(DenoiseError::NoDevice { engine: engine.name() }),
        [..] => Ok(device),
    };
    match engine {
        Engine::Burn => Ok(Device::flex()),
        #[cfg(feature = "cuda")]
        Engine::Cuda => present(burn_tensor::DeviceType::Cuda, Device::cuda(0)),
        #[cfg(feature = "wgpu")]
        Engine::Wgpu => present(burn_tensor::DeviceType::Wgpu, Device::wgpu(Default::default())),
        _ => Err(DenoiseError::NoEngine { engine: engine.name() }),
    }
}

/// A net on a device.
#[derive(Debug)]
pub(super) struct Autodiff {
    engine: Engine,
    shape: UnetShape,
    size: [usize; 2],
    device: Device,
    net: Net,
    gradient: Vec<f32>,
}

/// Weights [output, input, row, column] and biases of the convolutions in the order in which they
/// run.
#[derive(Debug, Clone, Default)]
struct Net(Vec<(Tensor<4>, Tensor<1>)>);

/// A batch on the device.
struct Batch {
    /// Frames and mask [example, channel, row, column].
    inputs: Tensor<4>,
    /// [example, 1, row, column]
    wanted: Tensor<4>,
    /// [1, 1, row, column]
    mask: Tensor<4>,
    /// Pixels inside the mask.
    pixels: f32,
    /// What the error of each example is multiplied by.
    weights: Tensor<1>,
}

impl Net {
    /// As many parameters as the shape has.
    fn new(shape: UnetShape, parameters: &[f32], device: &Device) -> Self {
        let mut rest = parameters;
        let mut layers = Vec::new();
        for c in shape.convolutions() {
            let (weights, others) = rest.split_at(c.weights());
            let (biases, others) = others.split_at(c.outputs);
            rest = others;
            let weights = TensorData::new(weights.to_vec(), [c.outputs, c.inputs, c.side, c.side]);
            let biases = TensorData::new(biases.to_vec(), [c.outputs]);
            let weights = Tensor::from_data(weights, device);
            layers.push((weights, Tensor::from_data(biases, device)));
        }
        Self(layers)
    }

    /// Notes down what is done with it.
    fn tracked(&self) -> Self {
        let tracked = |(weights, biases): &(Tensor<4>, Tensor<1>)| {
            let (weights, biases) = (weights.clone().autodiff(), biases.clone().autodiff());
            (weights.require_grad(), biases.require_grad())
        };
        Self(self.0.iter().map(tracked).collect())
    }

    /// Convolution `k`, equal padding.
    fn convolve(&self, k: usize, x: Tensor<4>) -> Tensor<4> {
        let (weights, biases) = &self.0[k];
        let reach = weights.dims()[2] / 2;
        let options = ConvOptions::new([1, 1], [reach, reach], [1, 1], 1);
        conv2d(x, weights.clone(), Some(biases.clone()), options)
    }

    /// [example, channel, row, column] to [example, 1, row, column].
    fn forward(&self, inputs: Tensor<4>) -> Tensor<4> {
        // pairs of convolutions, down and up, and the head
        let depth = self.0.len() / 4;
        let pair = |level: usize, x: Tensor<4>| {
            let x = relu(self.convolve(2 * level, x));
            relu(self.convolve(2 * level + 1, x))
        };
        let mut now = inputs;
        let mut skips = Vec::new();
        for level in 0..depth {
            now = pair(level, now);
            skips.push(now.clone());
            now = max_pool2d(now, MaxPoolOptions::new([2, 2]));
        }
        now = pair(depth, now);
        for (level, skip) in (depth + 1..).zip(skips.into_iter().rev()) {
            let options = InterpolateOptions::new(InterpolateMode::Nearest);
            let doubled = interpolate(now, options.with_scale_factor([2.0, 2.0]));
            now = pair(level, Tensor::cat(vec![skip, doubled], 1));
        }
        self.convolve(self.0.len() - 1, now)
    }

    /// Weighted mean squared error of each example over its masked pixels.
    fn errors(&self, batch: &Batch) -> Tensor<1> {
        let off = self.forward(batch.inputs.clone()) - batch.wanted.clone();
        let squares = off.clone() * off * batch.mask.clone();
        let means = squares.sum_dims_squeeze::<1, _>(&[1, 2, 3]).div_scalar(batch.pixels);
        means * batch.weights.clone()
    }
}

impl Autodiff {
    /// For a valid shape.
    pub fn new(engine: Engine, shape: UnetShape, size: [usize; 2]) -> Result<Self, DenoiseError> {
        let device = device(engine)?;
        Ok(Self { engine, shape, size, device, net: Net::default(), gradient: Vec::new() })
    }

    /// Examples with the zeros around them that halving needs.
    fn batch(&self, examples: &Examples, batch: &[usize]) -> Batch {
        let [rows, columns] = self.shape.padded(self.size);
        let mut inputs = Vec::new();
        let mut wanted = Vec::new();
        let pad = |plane: &[f32], out: &mut Vec<f32>| {
            for row in plane.chunks_exact(self.size[1]) {
                out.extend_from_slice(row);
                out.extend(std::iter::repeat_n(0.0, columns - self.size[1]));
            }
            out.extend(std::iter::repeat_n(0.0, (rows - self.size[0]) * columns));
        };
        let mut turned = Turned::default();
        let inside = examples.get(batch[0], &mut turned).mask;
        let inside: Vec<f32> = inside.iter().map(|m| f32::from(u8::from(*m))).collect();
        let mut weights = Vec::new();
        for &k in batch {
            let example = examples.get(k, &mut turned);
            weights.push(example.weight);
            for plane in example.frames.chunks_exact(inside.len()).chain([inside.as_slice()]) {
                pad(plane, &mut inputs);
            }
            pad(example.wanted, &mut wanted);
        }
        let mut mask = Vec::new();
        pad(&inside, &mut mask);
        let on_device = |values: Vec<f32>, count: usize, channels: usize| {
            let data = TensorData::new(values, [count, channels, rows, columns]);
            Tensor::from_data(data, &self.device)
        };
        Batch {
            inputs: on_device(inputs, batch.len(), self.shape.inputs()),
            wanted: on_device(wanted, batch.len(), 1),
            mask: on_device(mask, 1, 1),
            pixels: inside.iter().sum::<f32>().max(1.0),
            weights: Tensor::from_data(TensorData::new(weights, [batch.len()]), &self.device),
        }
    }

    fn read(&self, values: Tensor<1>) -> Result<Vec<f32>, DenoiseError> {
        let engine = self.engine.name();
        let failed = |what: String| DenoiseError::EngineFailed { engine, what };
        let data = values.try_into_data().map_err(|e| failed(e.to_string()))?;
        data.try_into_vec::<f32>().map_err(|e| failed(e.to_string()))
    }
}

impl Steps for Autodiff {
    fn load(&mut self, parameters: &[f32]) -> Result<(), DenoiseError> {
        self.net = Net::new(self.shape, parameters, &self.device);
        Ok(())
    }

    fn step(
        &mut self,
        examples: &Examples,
        batch: &[usize],
    ) -> Result<(f64, &[f32]), DenoiseError> {
        let net = self.net.tracked();
        let errors = net.errors(&self.batch(examples, batch));
        let mut gradients = errors.clone().mean().backward();
        // errors and derivatives in one list: a graphics processor is asked once
        let mut list = vec![errors.inner()];
        for (weights, biases) in &net.0 {
            let (weights, biases) =
                (weights.grad_remove(&mut gradients), biases.grad_remove(&mut gradients));
            list.extend(weights.map(|d| d.flatten(0, 3)));
            list.extend(biases);
        }
        let mut values = self.read(Tensor::cat(list, 0))?;
        self.gradient = values.split_off(batch.len());
        let (found, wanted) = (self.gradient.len(), self.shape.parameters());
        if found != wanted {
            let what = format!("it gave {found} derivatives for {wanted} weights");
            return Err(DenoiseError::EngineFailed { engine: self.engine.name(), what });
        }
        Ok((values.iter().map(|e| f64::from(*e)).sum(), &self.gradient))
    }

    fn error(&mut self, examples: &Examples, batch: &[usize]) -> Result<f64, DenoiseError> {
        let mut sum = 0.0;
        for part in batch.chunks(AT_ONCE) {
            let errors = self.read(self.net.errors(&self.batch(examples, part)))?;
            sum += errors.iter().map(|e| f64::from(*e)).sum::<f64>();
        }
        Ok(sum)
    }
}
