//! One frame, one linear step: the map from difference data to an image, and its hyperparameter.
//!
//! | file | holds |
//! |---|---|
//! | `gauss_newton`, `settings`, `report` | [`OneStepGaussNewton`](crate::OneStepGaussNewton): set-up |
//! | `whitened`, `spectrum` | the weighted problem and its eigen-expansion, which methods of sequences share |
//! | `reconstructor`; `masked`, `missing` | frames to images; without masked measurements |
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
pub(crate) use spectrum::Spectrum;
pub(crate) use whitened::{covariance_times, weighted_rows};
