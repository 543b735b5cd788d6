//! Steps of a solve with electrodes eliminated.

use super::network::Network;
use super::outcome::Outcome;
use super::transfer::Transfer;
use super::variables::{Columns, Places};
use crate::error::FemError;
use crate::model::{ForwardModel, Geometry};
use crate::solve::workspace::Workspace;
use crate::sparse::ldl::Ldl;
use crate::sparse::real::{DoubleDouble, Real};

/// Solves for validated conductivities and stores the potentials in the workspace. Uses `f64` if
/// that meets the required accuracy (relative to the largest voltage), otherwise twice its
/// precision.
pub(crate) fn solve(
    model: &ForwardModel,
    geometry: &Geometry,
    conductivity_s: &[f64],
    workspace: &mut Workspace,
    required_accuracy: f64,
) -> Result<Outcome, FemError> {
    let found = solve_in::<f64>(model, geometry, conductivity_s, workspace);
    match found {
        Ok(found) if found.bound() <= required_accuracy => Ok(found),
        _ => solve_in::<DoubleDouble>(model, geometry, conductivity_s, workspace),
    }
}

fn solve_in<T: Real>(
    model: &ForwardModel,
    geometry: &Geometry,
    conductivity_s: &[f64],
    workspace: &mut Workspace,
) -> Result<Outcome, FemError> {
    let scale = power_of_two_near(conductivity_s);
    let scaled: Vec<f64> = conductivity_s.iter().map(|s| s / scale).collect();
    let network = Network::<T>::new(model, geometry, &scaled, scale)?;
    let places = Places::new(&network)?;
    let factor = Ldl::new(&places.matrix(&network))
        .map_err(|unknown| FemError::NotPositiveDefinite { unknown, unknowns: places.count })?;
    let mut fields = Columns::unit_currents(&places, &network);
    factor.solve(&mut fields.values, fields.count);
    let transfer = Transfer::new(&network, &places, &fields);
    let mut outcome = transfer.voltages(model, geometry, &network, scale);
    outcome.factor_entries = factor.entries();
    outcome.levels_v = transfer.potentials(model, geometry, &network, scale, workspace);
    outcome.low = store_fields(model, &network, &places, &fields, scale, workspace);
    check(model, &outcome, workspace)?;
    Ok(outcome)
}

/// Returns a power of two within a factor of two of the largest value. Scaling by it is exact.
fn power_of_two_near(values: &[f64]) -> f64 {
    let largest = values.iter().fold(0.0_f64, |m, v| m.max(*v));
    // clamped so that the power and its reciprocal are both normal numbers
    largest.log2().floor().clamp(-1021.0, 1021.0).exp2()
}

/// Writes the node potentials of the basis fields, which are zero at the last electrode's mean, and
/// returns their low-order parts.
fn store_fields<T: Real>(
    model: &ForwardModel,
    network: &Network<T>,
    places: &Places,
    fields: &Columns<T>,
    scale: f64,
    workspace: &mut Workspace,
) -> Vec<f64> {
    let basis = &model.fields.basis;
    let solves = basis.nrows();
    let extended = T::ROUNDING < f64::EPSILON;
    let mut low = vec![0.0; if extended { workspace.nodal.potentials.len() } else { 0 }];
    workspace.nodal.potentials.fill(0.0);
    let mut unit = vec![T::of(0.0); fields.count];
    for (i, node) in network.nodes.iter().enumerate() {
        unit.fill(T::of(0.0));
        for (place, c) in places.terms(node) {
            unit.iter_mut().zip(fields.row(place)).for_each(|(u, x)| *u += c * *x);
        }
        for r in 0..solves {
            let terms = unit.iter().zip(basis.row(r)).map(|(u, b)| *u * T::of(*b));
            let potential = terms.fold(T::of(0.0), |sum, term| sum + term);
            workspace.nodal.potentials[i * solves + r] = potential.high() / scale;
            if extended {
                low[i * solves + r] = potential.low() / scale;
            }
        }
    }
    low
}

/// Checks that every voltage is finite.
fn check(model: &ForwardModel, outcome: &Outcome, workspace: &Workspace) -> Result<(), FemError> {
    let numbers = outcome.voltages_v.iter().zip(&outcome.bounds_v);
    let Some(datum) = numbers.map(|(v, b)| v + b).position(|v| !v.is_finite()) else {
        return Ok(());
    };
    let [stimulation, pattern] = model.protocol().data()[datum].map(|i| i as usize);
    let row = &workspace.nodal.electrode_potentials[stimulation * model.protocol().electrodes()..];
    let measured = &model.patterns.measurements[pattern];
    let electrode = measured.iter().map(|m| m.0 as usize).find(|&l| !row[l].is_finite());
    let electrode = electrode.or(measured.first().map(|m| m.0 as usize)).unwrap_or(0);
    Err(FemError::NonFinitePotential {
        stimulation,
        electrode: electrode + 1,
        value_v: row[electrode],
    })
}
