//! Spatio-temporal total variation: one problem, one iteration and one certificate for whole sequences, frames linked
//! to the image before, and frames on their own.
//!
//! | file | contents |
//! |---|---|
//! | `batch`, `solve`, `task`, `run` | [`StTv`]: set-up; whole sequences, from first iterate to proof |
//! | `causal` | [`CausalStream`]: frames as they come; the solution of one |
//! | `weights`, `quiet`, `settings`, `gradient` | weights from the noise; frames of noise; user input |
//! | `problem`, `data`, `units` | the problem; data compressed to the row space of the Jacobian; internal units |
//! | `engine`, `record` | what a solution changes, in either floating-point type; its best image and bound |
//! | `iterate`, `state`, `duals`, `fit`, `chain` | iteration; iterate and duals; exact data step; exact steps in time |
//! | `step`, `travel` | step sizes; how far images and duals travel, from which long runs balance them |
//! | `value` | candidate images and their objective |
//! | `certificate`, `bound`, `flow` | lower bound; its value; search for nearly feasible duals |
//! | `anchored`, `repair` | its end with an anchor, whose dual takes the rest; exact balance without one |
//! | `reach` | smallest residual of images within bounds, where no image meets the constraints |
//! | `operators`, `differences`, `lanes`, `products` | basis and gradient in the layout of cells; inner loops; products |
//! | `laplacian`, `dense`, `ball`, `float`, `schedule` | sparse factor, small matrices, prox of a ball, `f32` or `f64`, shared numbers |

mod anchored;
mod ball;
mod batch;
mod bound;
mod causal;
mod certificate;
mod chain;
mod data;
mod dense;
mod differences;
mod duals;
mod engine;
mod fit;
mod float;
mod flow;
mod gradient;
mod iterate;
mod lanes;
mod laplacian;
mod operators;
mod problem;
mod products;
mod quiet;
mod reach;
mod record;
mod repair;
mod run;
mod schedule;
mod settings;
mod solve;
mod state;
mod step;
mod task;
mod travel;
mod units;
mod value;
mod weights;

pub use batch::StTv;
pub use causal::{CausalDual, CausalSettings, CausalStep, CausalStream};
pub use gradient::Gradient;
pub use settings::{Fidelity, StTvSettings, Stop};
pub use weights::{ChosenWeights, WeightPoint, WeightStatus};
