//! Validation of contact impedances, conductivities and required accuracies.

use crate::element::ElementOrder;
use crate::error::FemError;
use std::cmp::Ordering::{Equal, Greater};

/// Rejects a required accuracy that `f64` results cannot meet.
pub(crate) fn check_accuracy(required_accuracy: f64) -> Result<(), FemError> {
    let fits = (4.0 * f64::EPSILON..1.0).contains(&required_accuracy);
    let must = "at least 9e-16 and below 1";
    FemError::require("required_accuracy", required_accuracy, fits, must)
}

/// Requires one non-negative impedance per electrode; for quadratic elements above zero and finite.
pub(crate) fn check_impedances(
    order: ElementOrder,
    count: usize,
    contact_impedance: &[f64],
) -> Result<(), FemError> {
    let what = "contact impedance (one per electrode)";
    FemError::check_length(what, contact_impedance.len(), count)?;
    // NaN does not compare as at least zero
    let bad = |z: &f64| !matches!(z.partial_cmp(&0.0), Some(Equal | Greater));
    if let Some(l) = contact_impedance.iter().position(bad) {
        let (electrode, value) = (l + 1, contact_impedance[l]);
        return Err(FemError::BadContactImpedance { electrode, value });
    }
    let limit = |z: &f64| order == ElementOrder::Quadratic && (*z == 0.0 || z.is_infinite());
    match contact_impedance.iter().position(limit) {
        None => Ok(()),
        Some(l) => {
            Err(FemError::LimitOfImpedance { electrode: l + 1, value: contact_impedance[l] })
        }
    }
}

/// Requires one conductivity per element, finite and above zero.
pub(crate) fn check_conductivity(elements: usize, conductivity_s: &[f64]) -> Result<(), FemError> {
    FemError::check_length("conductivity (one per element)", conductivity_s.len(), elements)?;
    let bad = |s: &f64| !(s.is_finite() && *s > 0.0);
    match conductivity_s.iter().position(bad) {
        None => Ok(()),
        Some(element) => {
            let count = conductivity_s.iter().filter(|s| bad(s)).count();
            Err(FemError::BadConductivity { element, value_s: conductivity_s[element], count })
        }
    }
}
