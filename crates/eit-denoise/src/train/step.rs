//! Errors of a batch and their gradients, distributed over threads.

use crate::examples::Turned;
use crate::nets::{device_of, padded, read, same_shape};
use crate::{DenoiseError, Examples, ImageNet};
use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::{Device, Tensor, TensorData};

/// Examples per part on the processor. Fixed, so that sums do not depend on the number of threads. Not
/// fewer: burn-flex 0.22 computes the gradient of a convolution's weights by a convolution
/// whose channels are the examples, and takes a slow path for up to four (a step of 16 images takes
/// twice as long in parts of 1, 2 or 4 as in parts of 8 or 16).
const AT_ONCE: usize = 8;
/// Examples per part without gradients.
const AT_ONCE_FORWARD: usize = 16;

/// Error and gradients of a batch: what a step of [`crate::Trainer`] passes to its optimiser. Usable in
/// custom training loops.
#[derive(Debug)]
pub struct TrainStep {
    /// Sum of the examples' errors.
    pub errors: f64,
    /// Gradients of their mean.
    pub gradients: GradientsParams,
}

/// Returns the weighted mean squared error of each example over its masked pixels. [`crate::Trainer`]
/// minimises their mean. Index `k + n t` of `n` examples is the `k`-th under the `t`-th
/// symmetry ([`Examples::augmented`]).
///
/// # Errors
/// [`DenoiseError::NothingToLearn`] for an empty batch; [`DenoiseError::OutOfRange`] for an unknown
/// index; [`DenoiseError::WrongLength`] for examples with other inputs than the net's;
/// [`DenoiseError::NetShape`], [`DenoiseError::Burn`].
pub fn weighted_errors<N: ImageNet>(
    net: &N,
    examples: &Examples,
    batch: &[usize],
) -> Result<Tensor<1>, DenoiseError> {
    check_batch(net, examples, batch)?;
    errors(net, examples, batch, &device_of(net)?)
}

/// Rejects an empty batch and unknown indices.
fn check_batch<N: ImageNet>(
    net: &N,
    examples: &Examples,
    batch: &[usize],
) -> Result<(), DenoiseError> {
    if batch.is_empty() {
        return Err(DenoiseError::NothingToLearn { what: "a batch of none".to_owned() });
    }
    for &k in batch {
        let is_example = k < examples.len() * examples.turns();
        let must = "less than their number times their turns";
        DenoiseError::check_range(is_example, "the index of an example", k as f64, must)?;
    }
    check(net, examples)
}

/// Rejects examples with another number of frames, images or conditions.
fn check<N: ImageNet>(net: &N, examples: &Examples) -> Result<(), DenoiseError> {
    let counts = [
        ("frames an example", examples.history(), net.history()),
        ("images per frame", examples.images(), net.images()),
        ("conditions per frame", examples.conditions(), net.conditions()),
    ];
    match counts.into_iter().find(|(_, found, wanted)| found != wanted) {
        Some((what, found, wanted)) => Err(DenoiseError::WrongLength { what, found, wanted }),
        None => Ok(()),
    }
}

/// [`weighted_errors`] of a batch that has been checked.
fn errors<N: ImageNet>(
    net: &N,
    examples: &Examples,
    batch: &[usize],
    device: &Device,
) -> Result<Tensor<1>, DenoiseError> {
    let [rows, columns] = examples.size().map(|n| n.next_multiple_of(net.multiple()));
    let (size, width) = ([rows, columns], examples.size()[1]);
    let inside: Vec<f32> = examples.mask().iter().map(|m| f32::from(u8::from(*m))).collect();
    let (mut inputs, mut wanted, mut mask) = (Vec::new(), Vec::new(), Vec::new());
    let (mut weights, mut turned) = (Vec::new(), Turned::default());
    padded(&inside, width, size, &mut mask);
    let pixels = inside.iter().sum::<f32>().max(1.0);
    for &k in batch {
        let example = examples.get(k, &mut turned);
        weights.push(example.weight / pixels);
        for plane in example.frames.chunks_exact(inside.len()) {
            padded(plane, width, size, &mut inputs);
        }
        for condition in example.conditions {
            let plane: Vec<f32> = inside.iter().map(|m| m * condition).collect();
            padded(&plane, width, size, &mut inputs);
        }
        padded(&inside, width, size, &mut inputs);
        padded(example.wanted, width, size, &mut wanted);
    }
    let count = batch.len();
    let on_device = |values: Vec<f32>, count: usize, channels: usize| {
        let data = TensorData::new(values, [count, channels, rows, columns]);
        Tensor::<4>::from_data(data, device)
    };
    let planes = net.history() * net.images() + net.conditions() + 1;
    let made = net.forward(on_device(inputs, count, planes));
    same_shape(&made, [count, 1, rows, columns])?;
    let off = (made - on_device(wanted, count, 1)) * on_device(mask, 1, 1);
    let squares = (off.clone() * off).sum_dims_squeeze::<1, _>(&[1, 2, 3]);
    Ok(squares * Tensor::<1>::from_data(TensorData::new(weights, [count]), device))
}

impl TrainStep {
    /// Computes errors and gradients of a batch, indexed as in [`weighted_errors`], on `threads` threads.
    /// On the processor the batch is split into parts of a fixed size whose gradients are added in order.
    ///
    /// # Errors
    /// Those of [`weighted_errors`]; [`DenoiseError::OutOfRange`] for 0 threads,
    /// [`DenoiseError::Burn`] for a net on a device without automatic differentiation.
    pub fn of<N: ImageNet>(
        net: &N,
        examples: &Examples,
        batch: &[usize],
        threads: usize,
    ) -> Result<Self, DenoiseError> {
        let device = device_of(net)?;
        check_batch(net, examples, batch)?;
        let whole = batch.len() as f32;
        let derive = |net: N, part: &[usize]| {
            let errors = errors(&net, examples, part, &device)?;
            let mean = errors.clone().sum().div_scalar(whole);
            if !mean.is_tracked() {
                let what = "the net is on a device without automatic differentiation: make it on \
                            one of TrainDevice::open";
                return Err(DenoiseError::Burn { what: what.to_owned() });
            }
            let gradients = GradientsParams::from_grads(mean.backward(), &net);
            Ok((read(errors.inner())?, gradients))
        };
        let made = shared_out(net, &device, batch, AT_ONCE, threads, &derive)?;
        let (mut sum, mut total) = (0.0, GradientsAccumulator::new());
        // in the order of the examples, whichever thread computed them
        for (errors, gradients) in made {
            sum += errors.iter().map(|e| f64::from(*e)).sum::<f64>();
            total.accumulate(net, gradients);
        }
        Ok(Self { errors: sum, gradients: total.grads() })
    }
}

/// Mean error of all examples, without symmetries.
pub(super) fn error<N: ImageNet>(
    net: &N,
    examples: &Examples,
    threads: usize,
) -> Result<f64, DenoiseError> {
    let device = device_of(net)?;
    check(net, examples)?;
    let all: Vec<usize> = (0..examples.len()).collect();
    let work = |net: N, part: &[usize]| read(errors(&net, examples, part, &device)?);
    let made = shared_out(net, &device, &all, AT_ONCE_FORWARD, threads, &work)?;
    Ok(made.iter().flatten().map(|e| f64::from(*e)).sum::<f64>() / all.len() as f64)
}

/// Splits a batch into parts of `at_once` examples, distributes them over threads, each with its own copy
/// of the net, and returns the results in the order of the parts. A graphics processor gets parts of 64.
fn shared_out<N: ImageNet, T: Send, W>(
    net: &N,
    device: &Device,
    batch: &[usize],
    at_once: usize,
    threads: usize,
    work: &W,
) -> Result<Vec<T>, DenoiseError>
where
    W: Fn(N, &[usize]) -> Result<T, DenoiseError> + Sync,
{
    DenoiseError::check_range(threads > 0, "threads", 0.0, "at least 1")?;
    let on_processor = *device == Device::flex();
    let parts: Vec<&[usize]> = batch.chunks(if on_processor { at_once } else { 64 }).collect();
    let copy = || net.clone().fork(device);
    let threads = if on_processor { threads.min(parts.len()) } else { 1 };
    if threads == 1 {
        return parts.into_iter().map(|part| work(copy(), part)).collect();
    }
    let mut jobs: Vec<Vec<(usize, N, &[usize])>> = (0..threads).map(|_| Vec::new()).collect();
    for (k, part) in parts.into_iter().enumerate() {
        jobs[k % threads].push((k, copy(), part));
    }
    let mut made: Vec<(usize, Result<T, DenoiseError>)> = std::thread::scope(|scope| {
        let run = |jobs: Vec<(usize, N, &[usize])>| {
            let one = |(k, net, part)| (k, work(net, part));
            jobs.into_iter().map(one).collect::<Vec<_>>()
        };
        let running: Vec<_> = jobs.into_iter().map(|jobs| scope.spawn(move || run(jobs))).collect();
        let joined = running.into_iter().map(|thread| match thread.join() {
            Ok(made) => made,
            Err(panic) => std::panic::resume_unwind(panic),
        });
        joined.flatten().collect()
    });
    made.sort_by_key(|(k, _)| *k);
    made.into_iter().map(|(_, made)| made).collect()
}
