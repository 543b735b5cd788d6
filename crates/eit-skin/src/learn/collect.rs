//! Collects presses while they are made: asks for a press at a place, notices by itself when it is held,
//! stores it, and tells how the error falls.
//!
//! ```text
//! frames -> PressCollector: untouched -> asked -> held -> released -> asked ...
//!              |                          |
//!          PressStore (recording, table)  CollectedPress -> LearnedSkin::learn -> FallingError
//! ```
//!
//! [`PressCollector`] needs no instrument and no clock: push frames from anywhere. [`PressStore`] (feature
//! `recording`) writes every frame and a line per press as they arrive, in the form that `eit learn
//! --presses` reads, so that nothing is lost when the program ends early and collecting can be continued.
//!
//! | file | holds |
//! |---|---|
//! | `collector.rs` | [`PressCollector`]: from frames to presses |
//! | `places.rs` | places to press, and how a place is described and drawn |
//! | `falling.rs` | [`FallingError`]: the error after each number of presses, and when to end |
//! | `store.rs` | `PressStore`: recording and table |
//! | `watch.rs` | when a press is held, and the means of its frames |

mod collector;
mod falling;
mod places;
#[cfg(feature = "recording")]
mod store;
mod watch;

pub use collector::{AskedPress, CollectSettings, CollectedPress, Collecting, PressCollector};
pub use falling::{ErrorPoint, FallingError};
pub use places::{draw_places, place_text};
#[cfg(feature = "recording")]
pub use store::{PressStore, StoredPresses};
