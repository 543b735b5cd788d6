#![doc = include_str!("../README.md")]

mod error;
mod image_stack;
mod symmetry;
mod threshold;
#[cfg(feature = "unet")]
mod unet;

pub use error::DenoiseError;
pub use image_stack::ImageStack;
pub use symmetry::{DiscSymmetry, MeasurementOrder};
pub use threshold::{Threshold, ThresholdRule};
#[cfg(feature = "unet")]
pub use unet::{Denoiser, UnetShape, Weights};
