//! The U-net: its size, its weights in files, and images through it.

mod denoiser;
mod kernel;
mod shape;
mod weights;

pub use denoiser::Denoiser;
pub use shape::UnetShape;
pub use weights::Weights;
pub(crate) use weights::{bytes_of, floats_of};
