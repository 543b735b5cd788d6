#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

#[cfg(feature = "zenoh")]
pub mod body;
#[cfg(feature = "zenoh")]
mod change;
mod error;
#[cfg(feature = "foxglove")]
mod foxglove_sink;
mod image;
mod line;
mod lines;
#[cfg_attr(not(feature = "zenoh"), allow(dead_code, reason = "only ROS messages have all fields"))]
mod outbox;
mod publisher;
#[cfg(feature = "zenoh")]
pub mod ros;
mod shape;
mod udp;
#[cfg(feature = "web")]
mod web;
#[cfg(feature = "zenoh")]
mod zenoh_sink;

#[cfg(feature = "zenoh")]
pub use change::ChangeThreshold;
pub use error::PublishError;
#[cfg(all(feature = "foxglove", feature = "zenoh"))]
pub use foxglove_sink::FoxgloveBody;
#[cfg(feature = "foxglove")]
pub use foxglove_sink::{FoxgloveSettings, FoxgloveSink};
pub use image::SkinImage;
pub use outbox::SinkStatistics;
pub use publisher::{Publisher, Start};
pub use shape::SkinShape;
pub use udp::UdpSink;
#[cfg(feature = "web")]
pub use web::{Recording, WebServer};
#[cfg(feature = "zenoh")]
pub use zenoh_sink::{RosNode, RosPublisher, SessionSettings, ZenohSettings, ZenohSink};

/// JSON schema (draft 2020-12) of every line.
pub const SCHEMA: &str = include_str!("../schema/touches.schema.json");

/// Version of the lines. It rises when a field changes its meaning or is removed; fields may be added without.
pub const VERSION: u32 = 1;
