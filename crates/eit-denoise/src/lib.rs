#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

#[cfg(feature = "unet")]
mod data_consistency;
mod error;
#[cfg(feature = "base")]
mod examples;
mod image_stack;
#[cfg(feature = "unet")]
mod judge;
#[cfg(feature = "base")]
mod learning_base;
#[cfg(feature = "unet")]
mod model_error;
#[cfg(feature = "burn")]
mod nets;
#[cfg(feature = "base")]
mod raster_symmetry;
mod symmetry;
mod threshold;
#[cfg(feature = "train")]
mod train;
#[cfg(feature = "base")]
mod train_settings;
#[cfg(feature = "unet")]
mod unet;

/// ndarray, in the version of this crate's interface.
pub use ndarray;

/// burn, in the version that this crate's nets and devices use.
#[cfg(feature = "burn")]
pub use burn;
#[cfg(feature = "unet")]
pub use data_consistency::{DataConsistency, DataMisfit};
pub use error::DenoiseError;
#[cfg(feature = "base")]
pub use examples::Examples;
pub use image_stack::ImageStack;
#[cfg(feature = "unet")]
pub use judge::{Judge, Judgement, Verdict};
#[cfg(feature = "base")]
pub use learning_base::{BaseSettings, Beside, LearningBase, Part, Shard, ShardData, ShardTouches};
#[cfg(feature = "unet")]
pub use model_error::{ModelError, ModelErrorNorm, ModelErrorSum};
#[cfg(all(feature = "burn", feature = "base"))]
pub use nets::shard_through;
#[cfg(feature = "burn")]
pub use nets::{ImageNet, Unet, images_through};
#[cfg(feature = "base")]
pub use raster_symmetry::RasterSymmetry;
pub use symmetry::{DiscSymmetry, MeasurementOrder};
pub use threshold::{Threshold, ThresholdRule};
#[cfg(feature = "train")]
pub use train::{TrainStep, Trainer, weighted_errors};
#[cfg(feature = "base")]
pub use train_settings::{Epoch, TrainDevice, TrainSettings, TrainStatus};
#[cfg(feature = "unet")]
pub use unet::{Denoiser, NetFrame, NetStatus, UnetShape, Weights};
