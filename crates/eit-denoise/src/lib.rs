#![doc = include_str!("../README.md")]

mod error;
mod image_stack;
#[cfg(feature = "train")]
mod learning_base;
mod symmetry;
mod threshold;
#[cfg(feature = "train")]
mod train;
#[cfg(feature = "unet")]
mod unet;

pub use error::DenoiseError;
pub use image_stack::ImageStack;
#[cfg(feature = "train")]
pub use learning_base::{BaseSettings, LearningBase, Shard};
pub use symmetry::{DiscSymmetry, MeasurementOrder};
pub use threshold::{Threshold, ThresholdRule};
#[cfg(feature = "train")]
pub use train::{Engine, Epoch, Examples, Stepper, TrainSettings, TrainStatus, Trainer};
#[cfg(feature = "unet")]
pub use unet::{Denoiser, UnetShape, Weights};
