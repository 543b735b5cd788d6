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
mod trust;
#[cfg(feature = "unet")]
mod unet;

pub use error::DenoiseError;
pub use image_stack::ImageStack;
#[cfg(feature = "train")]
pub use learning_base::{BaseSettings, LearningBase, Shard, ShardData};
pub use symmetry::{DiscSymmetry, MeasurementOrder};
pub use threshold::{Threshold, ThresholdRule};
#[cfg(feature = "train")]
pub use train::{Engine, Epoch, Examples, PixelTurn, Stepper, TrainSettings, TrainStatus, Trainer};
#[cfg(feature = "unet")]
pub use trust::{Evidence, Misfit};
#[cfg(feature = "unet")]
pub use unet::{Denoiser, NetStatus, UnetShape, Weights};
