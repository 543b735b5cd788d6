#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]

mod error;
mod line;
mod publisher;
mod udp;
#[cfg(feature = "web")]
mod web;

pub use error::PublishError;
pub use publisher::{Publisher, Start};
pub use udp::UdpSink;
#[cfg(feature = "web")]
pub use web::{SkinShape, WebServer};

/// JSON schema (draft 2020-12) of every line.
pub const SCHEMA: &str = include_str!("../schema/touches.schema.json");

/// Version of the lines. It rises when a field changes its meaning or goes away; fields may be added
/// without.
pub const VERSION: u32 = 1;
