//! One-step linear reconstruction of single frames, and the choice of its hyperparameter.
//!
//! | file | contents |
//! |---|---|
//! | `gauss_newton`, `settings`, `report` | [`OneStepGaussNewton`](crate::OneStepGaussNewton): set-up |
//! | `whitened`, `spectrum` | weighted problem and its eigen-expansion, shared with sequence methods |
//! | `reconstructor`; `masked`, `missing` | frames to images; the same with masked measurements |
//! | `hyperparameter` | rules that choose lambda |

mod gauss_newton;
mod hyperparameter;
mod masked;
mod missing;
mod reconstructor;
mod report;
mod settings;
mod spectrum;
mod whitened;

pub use gauss_newton::OneStepGaussNewton;
pub use hyperparameter::{
    ChosenHyperparameter, CurvePoint, HyperparameterChoice, HyperparameterStatus, NoiseTarget,
};
pub use reconstructor::{Reconstructor, Workspace};
pub use report::OneStepReport;
pub use settings::OneStepSettings;
pub(crate) use spectrum::{Spectrum, gram};
pub(crate) use whitened::{covariance_times, weighted_rows};
