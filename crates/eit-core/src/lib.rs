#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]

mod event;
#[cfg(feature = "random")]
mod random;
mod statistics;
pub mod vector;

#[cfg(feature = "random")]
pub use random::Random;
pub use statistics::{median, median_in_place, quantile};
// for the expansion of `event!`
#[doc(hidden)]
#[cfg(feature = "tracing")]
pub use tracing;
