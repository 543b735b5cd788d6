//! The U-net: its size, its weights and its allocation-free inference.

mod denoiser;
mod kernel;
mod net;
mod shape;
mod weights;

#[cfg(any(feature = "base", feature = "burn"))]
pub(crate) use denoiser::CLAMP;
pub use denoiser::{Denoiser, NetFrame, NetStatus};
#[cfg(feature = "burn")]
pub(crate) use shape::Convolution;
pub use shape::UnetShape;
pub use weights::Weights;
#[cfg(feature = "burn")]
pub(crate) use weights::metadata;
#[cfg(feature = "base")]
pub(crate) use weights::{bytes_of, floats_of, format_error};
