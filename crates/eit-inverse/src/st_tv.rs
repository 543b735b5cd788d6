//! Spatio-temporal total variation: certified, anytime, streaming.
//!
//! | file | holds |
//! |---|---|
//! | `batch`, `solve` | [`StTv`]: set-up, whole sequences |
//! | `stream`, `window` | [`StTvStream`]: a sliding window |
//! | `causal` | [`CausalStream`]: each frame anchored to the image before |
//! | `weights`, `quiet` | weights from the noise, frames that hold nothing else |
//! | `settings`, `gradient` | what a caller states |
//! | `task`, `problem`, `run` | one sequence in inner units; what of it is solved; the run from the first iterate to the proof |
//! | `state`, `engine`, `sweep`, `fit`, `step` | the iterate; one iteration; its passes; the exact data step; step sizes |
//! | `certificate`, `flow`, `passes` | primal value and lower bound of any iterate; duals brought nearer to feasible |
//! | `data`, `operators`, `laplacian` | what is computed once: compressed data, packed operators, a sparse factor |
//! | `kernel`, `dense`, `ball`, `float` | inner loops along the frames, small matrices, the map of a ball, `f32` or `f64` |

mod ball;
mod batch;
mod causal;
mod certificate;
mod data;
mod dense;
mod engine;
mod fit;
mod float;
mod flow;
mod gradient;
mod kernel;
mod laplacian;
mod operators;
mod passes;
mod problem;
mod quiet;
mod run;
mod settings;
mod solve;
mod state;
mod step;
mod stream;
mod sweep;
mod task;
mod weights;
mod window;

pub use batch::StTv;
pub use causal::{CausalDual, CausalSettings, CausalStep, CausalStream};
pub use gradient::Gradient;
pub use settings::{Fidelity, StTvSettings, Stop, StreamSettings};
pub use stream::{StTvStream, StreamStep};
pub use weights::{ChosenWeights, WeightPoint, WeightStatus};
