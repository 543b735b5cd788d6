//! Many patches of skin, each published by a process of its own, joined into one list of touches in the robot's
//! frame and on one clock (feature `zenoh`). docs/BODY.md describes the file, the output and its limits.

mod clock;
mod latency;
mod lines;
mod link;
mod placement;
mod settings;
mod state;

pub use latency::Latency;
pub use link::Body;
pub use placement::Placement;
pub use settings::{BodySettings, PatchSettings};
pub use state::{BodyNews, BodyState, BodyTouches, Origin, PlacedTouch};
