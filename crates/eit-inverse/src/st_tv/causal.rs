//! Causal stream: each frame is linked to the image before it and has a certified gap.
//!
//! | file | contents |
//! |---|---|
//! | `stream`, `settings` | [`CausalStream`]: events, units, rest |
//! | `frame` | one frame: rounds of iterations, evaluations, limits |
//! | `iterate`, `map` | the iteration; its step sizes and exact data step |
//! | `value`, `bound`, `proof` | objective of a candidate; lower bound; flow search for the bound |
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
