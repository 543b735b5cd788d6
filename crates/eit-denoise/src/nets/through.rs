//! Runs any net on sequences, scaled and padded as in [`crate::Denoiser`].

use super::ImageNet;
use crate::unet::CLAMP;
use crate::{DenoiseError, ImageStack};
use burn::tensor::{Device, Tensor, TensorData};
use ndarray::{ArrayView2, ArrayView3, Axis};

/// Frames per pass through a net, to bound the memory.
const AT_ONCE: usize = 16;

/// Denoises a whole sequence with a burn net that takes one image per frame and no conditions:
/// `shard_through` (feature `base`) without anything beside the raw images.
///
/// # Errors
/// Those of `shard_through`.
pub fn images_through<N: ImageNet>(net: &N, raw: &ImageStack) -> Result<ImageStack, DenoiseError> {
    sequence_through(net, raw, &[], None)
}

/// Denoises a whole sequence with a burn net: `D(x, c) = s N(x / s, c, mask)`, `s` the largest
/// magnitude inside the mask over the first images of the frames that the net sees, other images clamped, as
/// in [`crate::Denoiser::denoise_with`]; frames
/// before the first count as zero, and zero gives zero. For a [`super::Unet`] the images are
/// those of the denoiser to the rounding of `f32`; that one is faster and does not allocate.
///
/// # Errors
/// [`DenoiseError::OutOfRange`] for a history or multiple of 0, [`DenoiseError::WrongLength`] for
/// another number of images or conditions, [`DenoiseError::NetShape`], [`DenoiseError::Burn`].
#[cfg(feature = "base")]
pub fn shard_through<N: ImageNet>(
    net: &N,
    shard: &crate::Shard,
) -> Result<ImageStack, DenoiseError> {
    shard.through(|raw, others, conditions| sequence_through(net, raw, others, conditions))
}

fn sequence_through<N: ImageNet>(
    net: &N,
    raw: &ImageStack,
    others: &[ArrayView3<'_, f64>],
    conditions: Option<ArrayView2<'_, f64>>,
) -> Result<ImageStack, DenoiseError> {
    let net = net.valid();
    let device = device_of(&net)?;
    let mask = raw.mask();
    let (count, rows, columns) = raw.values().dim();
    let [history, multiple] = checked(&net)?;
    let lengths = others.iter().map(|other| ("frames of other images", other.dim().0, count));
    let counts = [
        ("images per frame", 1 + others.len(), net.images()),
        ("conditions per frame", conditions.map_or(0, |all| all.ncols()), net.conditions()),
        ("frames of conditions", conditions.map_or(count, |all| all.nrows()), count),
    ];
    if let Some((what, found, wanted)) = lengths.chain(counts).find(|(_, a, b)| a != b) {
        return Err(DenoiseError::WrongLength { what, found, wanted });
    }
    let size = [rows, columns].map(|n| n.next_multiple_of(multiple));
    let frames = Frames { raw, others, conditions, history, size };
    let mut values = raw.values().to_owned();
    for first in (0..count).step_by(AT_ONCE) {
        let (mut inputs, mut scales) = (Vec::new(), Vec::new());
        for last in first..count.min(first + AT_ONCE) {
            scales.push(frames.append_inputs(last, &mut inputs));
        }
        let planes = history * net.images() + net.conditions() + 1;
        let data = TensorData::new(inputs, [scales.len(), planes, size[0], size[1]]);
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

/// A sequence, and the layout of a net's inputs.
struct Frames<'a> {
    raw: &'a ImageStack,
    others: &'a [ArrayView3<'a, f64>],
    conditions: Option<ArrayView2<'a, f64>>,
    history: usize,
    size: [usize; 2],
}

impl Frames<'_> {
    /// Appends the inputs of a net for one frame: images, conditions and mask. Returns the scale of the
    /// images.
    fn append_inputs(&self, last: usize, inputs: &mut Vec<f32>) -> f64 {
        let Self { raw, others, conditions, history, size } = self;
        let (mask, columns) = (raw.mask(), raw.mask().ncols());
        let seen = (last + 1).saturating_sub(*history)..last + 1;
        let masked = |image: ArrayView2<'_, f64>, is_zero: bool| -> Vec<f64> {
            let pixels = image.iter().zip(mask);
            pixels.map(|(value, inside)| if *inside && !is_zero { *value } else { 0.0 }).collect()
        };
        let images: Vec<Vec<f64>> = seen
            .flat_map(|frame| {
                let first = masked(raw.values().index_axis_move(Axis(0), frame), false);
                let is_zero = first.iter().all(|value| *value == 0.0);
                let others = others.iter().map(move |o| o.index_axis_move(Axis(0), frame));
                let others: Vec<_> = others.map(|image| masked(image, is_zero)).collect();
                std::iter::once(first).chain(others)
            })
            .collect();
        let firsts = images.iter().step_by(1 + others.len()).flatten();
        let scale = firsts.fold(0.0_f64, |most, value| value.abs().max(most));
        let divisor = if scale > 0.0 { scale } else { 1.0 };
        // frames before the first
        let before = (history * (1 + others.len()) - images.len()) * size[0] * size[1];
        inputs.extend(std::iter::repeat_n(0.0, before));
        for (k, image) in images.iter().enumerate() {
            let most = if k % (1 + others.len()) == 0 { 1.0 } else { CLAMP };
            let scaled = image.iter().map(|value| ((value / divisor) as f32).clamp(-most, most));
            let image: Vec<f32> = scaled.collect();
            padded(&image, columns, *size, inputs);
        }
        let inside: Vec<f32> = mask.iter().map(|inside| f32::from(u8::from(*inside))).collect();
        for condition in conditions.iter().flat_map(|all| all.row(last).to_vec()) {
            let plane: Vec<f32> = inside.iter().map(|m| m * condition as f32).collect();
            padded(&plane, columns, *size, inputs);
        }
        padded(&inside, columns, *size, inputs);
        scale
    }
}

/// Returns history and multiple of a net; both must be at least 1.
fn checked<N: ImageNet>(net: &N) -> Result<[usize; 2], DenoiseError> {
    let both = [("history", net.history()), ("multiple", net.multiple())];
    for (quantity, value) in both {
        DenoiseError::check_range(value > 0, quantity, 0.0, "at least 1")?;
    }
    Ok(both.map(|(_, value)| value))
}

/// Returns the device that holds the net's weights.
pub(crate) fn device_of<N: ImageNet>(net: &N) -> Result<Device, DenoiseError> {
    checked(net)?;
    let nothing = || DenoiseError::Burn { what: "the net has no parameter".to_owned() };
    net.devices().into_iter().next().ok_or_else(nothing)
}

/// Appends an image padded with zeros to `size`.
pub(crate) fn padded(image: &[f32], columns: usize, size: [usize; 2], out: &mut Vec<f32>) {
    let rows = image.len() / columns;
    for row in image.chunks_exact(columns) {
        out.extend_from_slice(row);
        out.extend(std::iter::repeat_n(0.0, size[1] - columns));
    }
    out.extend(std::iter::repeat_n(0.0, (size[0] - rows) * size[1]));
}

/// Rejects images of an unexpected shape.
pub(crate) fn same_shape(made: &Tensor<4>, wanted: [usize; 4]) -> Result<(), DenoiseError> {
    let found = made.dims();
    if found == wanted { Ok(()) } else { Err(DenoiseError::NetShape { found, wanted }) }
}

/// Copies a tensor to the host.
pub(crate) fn read(values: Tensor<1>) -> Result<Vec<f32>, DenoiseError> {
    let data = values.try_into_data().map_err(|e| DenoiseError::burn(&e))?;
    data.try_into_vec::<f32>().map_err(|e| DenoiseError::burn(&e))
}
