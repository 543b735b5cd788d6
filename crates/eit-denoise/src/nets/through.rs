//! Images through any net, scaled and filled up as [`crate::Denoiser`] does.

use super::ImageNet;
use crate::{DenoiseError, ImageStack};
use burn::tensor::{Device, Tensor, TensorData};
use ndarray::Axis;

/// Images that go through a net at once: memory stays that of a usual step.
const AT_ONCE: usize = 16;

/// A whole sequence through a net of burn: `D(x) = s N(x / s, mask)`, `s` the largest magnitude inside
/// the mask over the frames that the net sees, as [`crate::Denoiser::denoise`]; frames before the
/// first count as zero, and zero gives zero. For a [`super::Unet`] the images are those of the
/// denoiser to the rounding of `f32`; that one is faster and allocates nothing.
///
/// # Errors
/// [`DenoiseError::OutOfRange`] for a history or multiple of none, [`DenoiseError::NetShape`],
/// [`DenoiseError::Burn`].
pub fn images_through<N: ImageNet>(net: &N, raw: &ImageStack) -> Result<ImageStack, DenoiseError> {
    let net = net.valid();
    let device = device_of(&net)?;
    let mask = raw.mask();
    let (count, rows, columns) = raw.values().dim();
    let [history, multiple] = checked(&net)?;
    let size = [rows, columns].map(|n| n.next_multiple_of(multiple));
    let mut values = raw.values().to_owned();
    for first in (0..count).step_by(AT_ONCE) {
        let (mut inputs, mut scales) = (Vec::new(), Vec::new());
        for last in first..count.min(first + AT_ONCE) {
            scales.push(append_inputs(raw, last, history, size, &mut inputs));
        }
        let data = TensorData::new(inputs, [scales.len(), history + 1, size[0], size[1]]);
        let made = net.forward(Tensor::from_data(data, &device));
        same_shape(&made, [scales.len(), 1, size[0], size[1]])?;
        let made = read(made.flatten(0, 3))?;
        let images = made.chunks_exact(size[0] * size[1]);
        for ((frame, scale), image) in (first..).zip(scales).zip(images) {
            let mut out = values.index_axis_mut(Axis(0), frame);
            for ((row, column), _) in mask.indexed_iter().filter(|(_, inside)| **inside) {
                // zero stays zero, whatever the net's biases make of it
                let value = f64::from(image[row * size[1] + column]);
                out[[row, column]] = if scale > 0.0 { scale * value } else { 0.0 };
            }
        }
    }
    ImageStack::new(values, mask.to_owned())
}

/// Appends what a net sees at one frame, frames and mask, and gives the scale of the frames.
fn append_inputs(
    raw: &ImageStack,
    last: usize,
    history: usize,
    size: [usize; 2],
    inputs: &mut Vec<f32>,
) -> f64 {
    let (mask, columns) = (raw.mask(), raw.mask().ncols());
    let seen = (last + 1).saturating_sub(history)..last + 1;
    let frames: Vec<Vec<f64>> = seen
        .map(|frame| {
            let image = raw.values().index_axis_move(Axis(0), frame);
            let pixels = image.iter().zip(mask);
            pixels.map(|(value, inside)| if *inside { *value } else { 0.0 }).collect()
        })
        .collect();
    let scale = frames.iter().flatten().fold(0.0_f64, |most, value| most.max(value.abs()));
    let divisor = if scale > 0.0 { scale } else { 1.0 };
    // frames before the first
    let before = (history - frames.len()) * size[0] * size[1];
    inputs.extend(std::iter::repeat_n(0.0, before));
    for frame in &frames {
        let image: Vec<f32> = frame.iter().map(|value| (value / divisor) as f32).collect();
        padded(&image, columns, size, inputs);
    }
    let inside: Vec<f32> = mask.iter().map(|inside| f32::from(u8::from(*inside))).collect();
    padded(&inside, columns, size, inputs);
    scale
}

/// History and multiple of a net, from 1.
fn checked<N: ImageNet>(net: &N) -> Result<[usize; 2], DenoiseError> {
    let both = [("history", net.history()), ("multiple", net.multiple())];
    match both.into_iter().find(|(_, value)| *value == 0) {
        Some((quantity, _)) => {
            Err(DenoiseError::OutOfRange { quantity, value: 0.0, must: "at least 1" })
        }
        None => Ok(both.map(|(_, value)| value)),
    }
}

/// Where a net is.
pub(crate) fn device_of<N: ImageNet>(net: &N) -> Result<Device, DenoiseError> {
    checked(net)?;
    let nothing = || DenoiseError::Burn { what: "the net has no parameter".to_owned() };
    net.devices().into_iter().next().ok_or_else(nothing)
}

/// Appends an image with the zeros behind its rows and columns that make it one of `size`.
pub(crate) fn padded(image: &[f32], columns: usize, size: [usize; 2], out: &mut Vec<f32>) {
    let rows = image.len() / columns;
    for row in image.chunks_exact(columns) {
        out.extend_from_slice(row);
        out.extend(std::iter::repeat_n(0.0, size[1] - columns));
    }
    out.extend(std::iter::repeat_n(0.0, (size[0] - rows) * size[1]));
}

/// Refuses what a net of another shape made.
pub(crate) fn same_shape(made: &Tensor<4>, wanted: [usize; 4]) -> Result<(), DenoiseError> {
    let found = made.dims();
    if found == wanted { Ok(()) } else { Err(DenoiseError::NetShape { found, wanted }) }
}

/// Values of a tensor.
pub(crate) fn read(values: Tensor<1>) -> Result<Vec<f32>, DenoiseError> {
    let data = values.try_into_data().map_err(|e| DenoiseError::burn(&e))?;
    data.try_into_vec::<f32>().map_err(|e| DenoiseError::burn(&e))
}
