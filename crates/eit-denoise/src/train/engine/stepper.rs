//! An engine at work: what it is given is checked here, once for all.

#[cfg(feature = "burn")]
use super::autodiff;
use super::choice::Engine;
use super::own;
use super::steps::Steps;
use crate::train::examples::Examples;
use crate::{DenoiseError, UnetShape};

impl Engine {
    /// Refuses an engine that was not compiled in, or has no device here.
    ///
    /// # Errors
    /// [`DenoiseError::NoEngine`], [`DenoiseError::NoDevice`].
    pub fn check(self) -> Result<(), DenoiseError> {
        match self {
            Self::Own => Ok(()),
            #[cfg(feature = "burn")]
            _ => autodiff::device(self).map(drop),
            #[cfg(not(feature = "burn"))]
            _ => Err(DenoiseError::NoEngine { engine: self.name() }),
        }
    }

    /// Makes ready for examples of this size. Only [`Engine::Own`] takes more than one thread.
    ///
    /// # Errors
    /// Those of [`UnetShape::validate`] and [`Engine::check`]; [`DenoiseError::OutOfRange`] for no
    /// thread.
    pub fn start(
        self,
        shape: UnetShape,
        size: [usize; 2],
        threads: usize,
    ) -> Result<Stepper, DenoiseError> {
        shape.validate()?;
        if threads == 0 {
            let (quantity, must) = ("threads", "at least 1");
            return Err(DenoiseError::OutOfRange { quantity, value: 0.0, must });
        }
        let steps: Box<dyn Steps> = match self {
            Self::Own => Box::new(own::Own::new(shape, size, threads)),
            #[cfg(feature = "burn")]
            _ => Box::new(autodiff::Autodiff::new(self, shape, size)?),
            #[cfg(not(feature = "burn"))]
            _ => return Err(DenoiseError::NoEngine { engine: self.name() }),
        };
        Ok(Stepper { shape, size, steps, loaded: false })
    }
}

/// An engine that is ready for the examples of one size.
#[derive(Debug)]
pub struct Stepper {
    shape: UnetShape,
    size: [usize; 2],
    steps: Box<dyn Steps>,
    loaded: bool,
}

impl Stepper {
    /// The net from here on.
    ///
    /// # Errors
    /// [`DenoiseError::WrongLength`]; [`DenoiseError::EngineFailed`].
    pub fn load(&mut self, parameters: &[f32]) -> Result<(), DenoiseError> {
        let (found, wanted) = (parameters.len(), self.shape.parameters());
        if found != wanted {
            return Err(DenoiseError::WrongLength { what: "weights", found, wanted });
        }
        self.steps.load(parameters)?;
        self.loaded = true;
        Ok(())
    }

    /// Sum over these examples of their weighted mean squared errors, and the derivative of the
    /// batch's mean error by all parameters. Index `k + n t` of `n` examples is the `k`-th in its
    /// `t`-th turn ([`Examples::augmented`]).
    ///
    /// # Errors
    /// [`DenoiseError::NothingToLearn`] for no example; [`DenoiseError::OutOfRange`] for one that
    /// is not there; those of [`Stepper::check`]; [`DenoiseError::WrongLength`] where nothing was
    /// loaded; [`DenoiseError::EngineFailed`].
    pub fn step(
        &mut self,
        examples: &Examples,
        batch: &[usize],
    ) -> Result<(f64, &[f32]), DenoiseError> {
        self.check_batch(examples, batch)?;
        self.steps.step(examples, batch)
    }

    /// Sum over these examples of their weighted mean squared errors.
    ///
    /// # Errors
    /// Those of [`Stepper::step`].
    pub fn error(&mut self, examples: &Examples, batch: &[usize]) -> Result<f64, DenoiseError> {
        self.check_batch(examples, batch)?;
        self.steps.error(examples, batch)
    }

    /// Refuses examples with another number of frames or pixels.
    ///
    /// # Errors
    /// [`DenoiseError::WrongLength`], [`DenoiseError::ShapeMismatch`].
    pub fn check(&self, examples: &Examples) -> Result<(), DenoiseError> {
        let (found, wanted) = (examples.history(), self.shape.history);
        if found != wanted {
            return Err(DenoiseError::WrongLength { what: "frames an example", found, wanted });
        }
        if examples.size() != self.size {
            let (images, mask) = (examples.size(), self.size);
            return Err(DenoiseError::ShapeMismatch { images, mask });
        }
        Ok(())
    }

    fn check_batch(&self, examples: &Examples, batch: &[usize]) -> Result<(), DenoiseError> {
        if !self.loaded {
            let wanted = self.shape.parameters();
            return Err(DenoiseError::WrongLength { what: "weights", found: 0, wanted });
        }
        self.check(examples)?;
        if batch.is_empty() {
            return Err(DenoiseError::NothingToLearn { what: "a batch of none".to_owned() });
        }
        if let Some(&k) = batch.iter().find(|&&k| k >= examples.len() * examples.turns()) {
            let (quantity, must) =
                ("the index of an example", "less than their number times their turns");
            return Err(DenoiseError::OutOfRange { quantity, value: k as f64, must });
        }
        Ok(())
    }
}
