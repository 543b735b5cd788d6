#![doc = include_str!("../README.md")]

mod error;
mod image_stack;

pub use error::DenoiseError;
pub use image_stack::ImageStack;
