#![doc = include_str!("../README.md")]
#![allow(missing_docs)]

pub mod connect;
pub mod denoise;
pub mod emulate;
mod error;
pub mod frames;
pub mod live;
pub mod method;
pub mod pipeline;
pub mod plan;
mod progress;
pub mod scene;
mod stop;
#[cfg(feature = "learn")]
pub mod train;

pub use error::SkinError;
pub use progress::{Observer, Progress, Silent, StageTime, Steps};
pub use stop::StopFlag;
