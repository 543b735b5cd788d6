//! Spatio-temporal total variation: one problem, one iteration and one certificate for whole sequences, frames linked
//! to the image before, and frames on their own.
//!
//! | file | contents |
//! |---|---|
//! | `batch`, `solve`, `task`, `run` | [`StTv`]: set-up; whole sequences, in internal units, from first iterate to proof |
//! | `causal` | [`CausalStream`]: frames as they come; the solution of one |
//! | `weights`, `quiet`, `settings`, `gradient` | weights from the noise; frames of noise; user input |
//! | `problem`, `data` | the problem; data compressed to the row space of the Jacobian |
//! | `iterate`, `state`, `fit`, `step`, `chain` | iteration; iterate; exact data step; step sizes; exact steps in time |
//! | `value` | candidate images and their objective |
//! | `certificate`, `flow`, `repair` | lower bound; search for nearly feasible duals; exact balance without an anchor |
//! | `reach` | smallest residual of images within bounds, where no image meets the constraints |
//! | `operators`, `differences`, `lanes` | basis and gradient in the layout of cells; inner loops |
//! | `laplacian`, `dense`, `ball`, `float`, `schedule` | sparse factor, small matrices, prox of a ball, `f32` or `f64`, shared numbers |

mod ball;
mod batch;
mod causal;
mod certificate;
mod chain;
mod data;
mod dense;
mod differences;
mod fit;
mod float;
mod flow;
mod gradient;
mod iterate;
mod lanes;
mod laplacian;
mod operators;
mod problem;
mod quiet;
mod reach;
mod repair;
mod run;
mod schedule;
mod settings;
mod solve;
mod state;
mod step;
mod task;
mod value;
mod weights;

pub use batch::StTv;
pub use causal::{CausalDual, CausalSettings, CausalStep, CausalStream};
pub use gradient::Gradient;
pub use settings::{Fidelity, StTvSettings, Stop};
pub use weights::{ChosenWeights, WeightPoint, WeightStatus};
