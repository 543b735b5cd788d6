//! Spatio-temporal total variation, with certificates, time limits and streaming.
//!
//! | file | contents |
//! |---|---|
//! | `batch`, `solve` | [`StTv`]: set-up, whole sequences |
//! | `stream`, `single_frame` | [`StTvStream`]: each frame on its own |
//! | `causal` | [`CausalStream`]: each frame linked to the image before |
//! | `weights`, `quiet` | weights from the noise level; frames that contain only noise |
//! | `settings`, `gradient` | user input: settings and spatial differences |
//! | `task`, `problem`, `run` | a sequence in internal units; the problem; first iterate to certificate |
//! | `schedule` | numbers that whole sequences and streams share |
//! | `state`, `engine`, `sweep`, `fit` | iterate; iteration; its passes; data step |
//! | `step`, `travel` | step sizes; how far images and duals travel, from which long runs balance them |
//! | `chain` | exact step in time, for large `lambda_time` |
//! | `reach` | smallest residual of images within bounds, where no image meets the constraints |
//! | `certificate`, `flow`, `passes` | primal value and lower bound; search for nearly feasible duals |
//! | `data`, `operators`, `laplacian` | precomputed: compressed data, packed operators, a sparse factor |
//! | `kernel`, `dense`, `ball`, `float` | inner loops, small matrices, prox of a ball, `f32` or `f64` |

mod ball;
mod batch;
mod causal;
mod certificate;
mod chain;
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
mod products;
mod quiet;
mod reach;
mod run;
mod schedule;
mod settings;
mod single_frame;
mod solve;
mod state;
mod step;
mod stream;
mod sweep;
mod task;
mod travel;
mod weights;

pub use batch::StTv;
pub use causal::{CausalDual, CausalSettings, CausalStep, CausalStream};
pub use gradient::Gradient;
pub use settings::{Fidelity, StTvSettings, Stop, StreamSettings};
pub use stream::{StTvStream, StreamStep};
pub use weights::{ChosenWeights, WeightPoint, WeightStatus};
