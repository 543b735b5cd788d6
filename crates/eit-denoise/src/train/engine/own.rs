//! Our kernels: examples shared out to threads, sums in the order of the examples.

use super::steps::Steps;
use crate::train::examples::{Examples, Turned};
use crate::unet::{PackedNet, Tape};
use crate::{DenoiseError, UnetShape};

/// Memory of every thread and of every example of a batch.
#[derive(Debug)]
pub(super) struct Own {
    shape: UnetShape,
    net: PackedNet,
    tapes: Vec<Tape>,
    /// A derivative for each example.
    gradients: Vec<Vec<f32>>,
}

impl Own {
    /// For a valid shape and at least one thread.
    pub fn new(shape: UnetShape, size: [usize; 2], threads: usize) -> Self {
        let net = PackedNet::new(shape, &vec![0.0; shape.parameters()]);
        Self { shape, net, tapes: vec![Tape::new(shape, size); threads], gradients: Vec::new() }
    }
}

impl Steps for Own {
    fn load(&mut self, parameters: &[f32]) -> Result<(), DenoiseError> {
        self.net = PackedNet::new(self.shape, parameters);
        Ok(())
    }

    fn step(
        &mut self,
        examples: &Examples,
        batch: &[usize],
    ) -> Result<(f64, &[f32]), DenoiseError> {
        let Self { shape, net, tapes, gradients } = self;
        let count = gradients.len().max(batch.len());
        gradients.resize_with(count, || vec![0.0; shape.parameters()]);
        let errors = of_batch(net, examples, batch, tapes, gradients);
        // in the order of the examples, whichever thread had them
        let (total, others) = gradients.split_at_mut(1);
        for other in &others[..batch.len() - 1] {
            for (total, other) in total[0].iter_mut().zip(other) {
                *total += other;
            }
        }
        Ok((errors.iter().sum(), &total[0]))
    }

    fn error(&mut self, examples: &Examples, batch: &[usize]) -> Result<f64, DenoiseError> {
        let (net, mut errors) = (&self.net, vec![0.0; batch.len()]);
        let share = batch.len().div_ceil(self.tapes.len());
        std::thread::scope(|scope| {
            let parts = batch.chunks(share).zip(errors.chunks_mut(share));
            for ((batch, errors), tape) in parts.zip(&mut self.tapes) {
                scope.spawn(move || {
                    let mut turned = Turned::default();
                    for (&k, error) in batch.iter().zip(errors) {
                        *error = tape.run(net, &examples.get(k, &mut turned), None);
                    }
                });
            }
        });
        Ok(errors.iter().sum())
    }
}

/// Errors of a batch; each example's derivative of its part of the mean in a slice of its own.
fn of_batch(
    net: &PackedNet,
    examples: &Examples,
    batch: &[usize],
    tapes: &mut [Tape],
    gradients: &mut [Vec<f32>],
) -> Vec<f64> {
    let weight = 1.0 / batch.len() as f32;
    let mut errors = vec![0.0; batch.len()];
    let share = batch.len().div_ceil(tapes.len());
    let parts = batch.chunks(share).zip(errors.chunks_mut(share)).zip(gradients.chunks_mut(share));
    std::thread::scope(|scope| {
        for (((batch, errors), gradients), tape) in parts.zip(tapes) {
            scope.spawn(move || {
                let mut turned = Turned::default();
                for ((&k, error), gradient) in batch.iter().zip(errors).zip(gradients) {
                    gradient.fill(0.0);
                    let example = examples.get(k, &mut turned);
                    *error = tape.run(net, &example, Some((weight, gradient)));
                }
            });
        }
    });
    errors
}
