#![doc = include_str!("../README.md")]

#[cfg(feature = "unet")]
mod data_consistency;
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

#[cfg(feature = "unet")]
pub use data_consistency::{DataConsistency, DataMisfit};
pub use error::DenoiseError;
pub use image_stack::ImageStack;
#[cfg(feature = "train")]
pub use learning_base::{BaseSettings, LearningBase, Shard, ShardData};
pub use symmetry::{DiscSymmetry, MeasurementOrder};
pub use threshold::{Threshold, ThresholdRule};
#[cfg(feature = "train")]
pub use train::{
    Engine, Epoch, Examples, RasterSymmetry, Stepper, TrainSettings, TrainStatus, Trainer,
};
#[cfg(feature = "unet")]
pub use unet::{Denoiser, NetStatus, UnetShape, Weights};
