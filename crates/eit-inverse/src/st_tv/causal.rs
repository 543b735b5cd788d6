//! A causal stream: each frame anchored to the image before, with a certified gap.
//!
//! | file | holds |
//! |---|---|
//! | `stream`, `settings` | [`CausalStream`]: events, units, rest |
//! | `frame` | one frame: rounds of iterations, looks, budgets |
//! | `iterate`, `map` | the iteration; its step sizes and exact data step |
//! | `value`, `bound`, `proof` | objective of a candidate; lower bound; the flow that proves it |
//! | `fields`, `differences`, `lanes` | arrays, gradient and inner loops over them |

mod bound;
mod differences;
mod fields;
mod frame;
mod iterate;
mod lanes;
mod map;
mod proof;
mod settings;
mod stream;
mod value;

use super::data::seen;

pub use settings::{CausalDual, CausalSettings, CausalStep};
pub use stream::CausalStream;
