//! The U-net: its size, its weights in files, and images through it.

mod denoiser;
#[cfg(feature = "train")]
mod gradient;
mod kernel;
mod net;
mod shape;
mod weights;

pub use denoiser::{Denoiser, NetStatus};
#[cfg(feature = "train")]
pub(crate) use gradient::{Example, PackedNet, Tape};
pub use shape::UnetShape;
pub use weights::Weights;
#[cfg(feature = "train")]
pub(crate) use weights::{bytes_of, floats_of, format_error};
