//! The forward problem in variables that stiff contacts cannot spoil, in `f64` or twice the precision.
//!
//! Eliminating each electrode potential, `U = mu + z I / length` with the mean `mu` of the skin's
//! potential over the electrode, leaves a problem on the skin alone:
//!
//! ```text
//! sigma-energy(u) + sum over electrodes 1/z integral of (u - mu)^2   with currents I into mu
//! voltages = m^T (E^T A^-1 E) I + sum m z I / length,   E: the means
//! ```
//!
//! A large `z` no longer enters the matrix but as a vanishing term, and cancels exactly in what is
//! measured between electrodes without current. A small `z` multiplies deviations from the mean
//! only, which are variables of their own ([`network`]). Both limits, `z = 0` (a shunt) and
//! infinite `z` (an ideal current source), are ordinary cases. What is left is the contrast of the
//! skin and the shape of its triangles, and against those numbers carry 32 digits where the bound in
//! `f64` does not suffice (a bound 1e5 times the error in the cases of `tests/accurate.rs`).
//!
//! **Bound.** With fields `x_k` of unit currents and their residuals `r_l = e_l - A x_l`, the
//! transfer value `mu_k` under current `l` is `e_k^T x_l + x_k^T r_l + (A^-1 r_k)^T r_l`. The second
//! term is computed and added; the third is the product of two errors. The bound is the size of the
//! second term and twice the rounding of every step in it, `gamma sum_b size_b (|t_k| a_l + a_k
//! |t_l|)` over branches with `t = e_b . x`, `a = |e_b| . |x|`. It takes the third term to
//! be below the second, which holds while the factor has right digits: a pivot that keeps fewer than
//! 30 of its 104 bits, or half of 52, is refused ([`ldl`]).

mod ldl;
mod network;
mod real;
mod transfer;

use crate::FemError;
use crate::assembly::Adjacency;
use crate::forward::ForwardModel;
use crate::geometry::Geometry;
use crate::solver::order;
use crate::workspace::Workspace;
use ldl::{Ldl, Rows};
use network::{Combination, Network};
use real::{Real, Twice};
use transfer::Transfer;

/// What a solve leaves beside the potentials in the workspace.
#[derive(Debug)]
pub(crate) struct Accurate {
    /// Voltages in protocol order.
    pub voltages_v: Vec<f64>,
    /// Bound of the error of each.
    pub bounds_v: Vec<f64>,
    /// What the potentials of the workspace lack: [unknown, solve], low parts.
    pub low: Vec<f64>,
    /// Potential of the fields' zero for each stimulation.
    pub levels_v: Vec<f64>,
    /// Largest componentwise backward error of the fields.
    pub backward_error: f64,
    /// Relative change of the voltages per relative change of conductances, at most.
    pub condition: f64,
    /// Stored entries of the factor.
    pub factor_entries: usize,
    /// Whether numbers had twice the precision.
    pub twice: bool,
}

impl Accurate {
    /// Largest bound over the largest voltage.
    pub fn bound(&self) -> f64 {
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        largest(&self.bounds_v) / largest(&self.voltages_v)
    }

    /// What the potentials of the workspace lack, where it is anything.
    pub fn low(&self) -> Option<&[f64]> {
        self.twice.then_some(&self.low)
    }
}

/// Solves for checked conductivities; potentials go into the workspace. Where `f64` meets the
/// required accuracy (relative to the largest voltage), in that, else in twice its precision.
pub(crate) fn solve(
    model: &ForwardModel,
    geometry: &Geometry,
    conductivity_s: &[f64],
    workspace: &mut Workspace,
    required_accuracy: f64,
) -> Result<Accurate, FemError> {
    let found = solve_in::<f64>(model, geometry, conductivity_s, workspace);
    match found {
        Ok(found) if found.bound() <= required_accuracy => Ok(found),
        _ => solve_in::<Twice>(model, geometry, conductivity_s, workspace),
    }
}

fn solve_in<T: Real>(
    model: &ForwardModel,
    geometry: &Geometry,
    conductivity_s: &[f64],
    workspace: &mut Workspace,
) -> Result<Accurate, FemError> {
    let scale = power_of_two_near(conductivity_s);
    let scaled: Vec<f64> = conductivity_s.iter().map(|s| s / scale).collect();
    let network = Network::<T>::new(model, geometry, &scaled, scale)?;
    let places = Places::new(&network)?;
    let factor = Ldl::new(&places.matrix(&network))
        .map_err(|unknown| FemError::NotPositiveDefinite { unknown, unknowns: places.count })?;
    let mut fields = Columns::unit_currents(&places, &network);
    factor.solve(&mut fields.values, fields.count);
    let transfer = Transfer::new(&network, &places, &fields);
    let mut accurate = transfer.voltages(model, geometry, &network, scale);
    accurate.factor_entries = factor.entries();
    accurate.levels_v = transfer.potentials(model, geometry, &network, scale, workspace);
    accurate.low = store_fields(model, &network, &places, &fields, scale, workspace);
    check(model, &accurate, workspace)?;
    Ok(accurate)
}

/// A power of two within a factor of two of the largest value: scaling by it is exact.
fn power_of_two_near(values: &[f64]) -> f64 {
    let largest = values.iter().fold(0.0_f64, |m, v| m.max(*v));
    // between the smallest normal number and the largest: its reciprocal is a number too
    largest.log2().floor().clamp(-1021.0, 1021.0).exp2()
}

/// Where each variable stands in elimination order: deviations and nodes, then means.
struct Places {
    /// `None`: held at zero.
    of_variable: Vec<Option<u32>>,
    count: usize,
    /// Unknowns before the means.
    inner: usize,
}

impl Places {
    fn new<T: Real>(network: &Network<T>) -> Result<Self, FemError> {
        let variables = network.nodes.len();
        let mut last = vec![false; variables];
        network.means.iter().for_each(|&m| last[m as usize] = true);
        let free = (0..variables).filter(|&v| !last[v] && !network.held[v]);
        let inner_of: Vec<usize> = free.collect();
        let mut of_variable: Vec<Option<u32>> = vec![None; variables];
        inner_of.iter().enumerate().for_each(|(k, &v)| of_variable[v] = Some(k as u32));
        let mut links = Vec::new();
        for branch in &network.branches {
            let ends: Vec<u32> =
                branch.difference.iter().filter_map(|t| of_variable[t.0 as usize]).collect();
            for &i in &ends {
                links.extend(ends.iter().filter(|j| **j != i).map(|&j| (i, j)));
            }
        }
        let new_from_old = order(&Adjacency::from_links(inner_of.len(), links), &[])?;
        for (k, &v) in inner_of.iter().enumerate() {
            of_variable[v] = Some(new_from_old[k]);
        }
        // the last electrode's mean is the ground
        let inner = inner_of.len();
        let grounded = network.means.len() - 1;
        for (k, &m) in network.means[..grounded].iter().enumerate() {
            of_variable[m as usize] = Some((inner + k) as u32);
        }
        Ok(Self { of_variable, count: inner + grounded, inner })
    }

    /// The terms of a combination that are unknowns.
    fn terms<'a, T: Real>(
        &'a self,
        of: &'a Combination<T>,
    ) -> impl Iterator<Item = (usize, T)> + 'a {
        of.iter().filter_map(|&(v, c)| Some((self.of_variable[v as usize]? as usize, c)))
    }

    fn matrix<T: Real>(&self, network: &Network<T>) -> Rows<T> {
        let mut entries = Vec::new();
        for branch in &network.branches {
            for (i, a) in self.terms(&branch.difference) {
                let weighted = branch.weight * a;
                let before = self.terms(&branch.difference).filter(|(j, _)| *j <= i);
                entries.extend(before.map(|(j, b)| ((i as u32, j as u32), weighted * b)));
            }
        }
        Rows::new(self.count, entries)
    }
}

/// Several columns [unknown, column], row-major.
struct Columns<T> {
    values: Vec<T>,
    count: usize,
}

impl<T: Real> Columns<T> {
    /// One ampere into the mean of each electrode but the last.
    fn unit_currents(places: &Places, network: &Network<T>) -> Self {
        let count = network.means.len() - 1;
        let mut values = vec![T::of(0.0); places.count * count];
        (0..count).for_each(|k| values[(places.inner + k) * count + k] = T::of(1.0));
        Self { values, count }
    }

    fn row(&self, place: usize) -> &[T] {
        &self.values[place * self.count..][..self.count]
    }
}

/// Writes the basis fields' node potentials, zero at the last electrode's mean; returns low parts.
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
    let twice = T::ROUNDING < f64::EPSILON;
    let mut low = vec![0.0; if twice { workspace.potentials.len() } else { 0 }];
    workspace.potentials.fill(0.0);
    let mut unit = vec![T::of(0.0); fields.count];
    for (i, node) in network.nodes.iter().enumerate() {
        unit.fill(T::of(0.0));
        for (place, c) in places.terms(node) {
            unit.iter_mut().zip(fields.row(place)).for_each(|(u, x)| *u += c * *x);
        }
        for r in 0..solves {
            let terms = unit.iter().zip(basis.row(r)).map(|(u, b)| *u * T::of(*b));
            let potential = terms.fold(T::of(0.0), |sum, term| sum + term);
            workspace.potentials[i * solves + r] = potential.high() / scale;
            if twice {
                low[i * solves + r] = potential.low() / scale;
            }
        }
    }
    low
}

/// That every voltage is a number.
fn check(model: &ForwardModel, accurate: &Accurate, workspace: &Workspace) -> Result<(), FemError> {
    let numbers = accurate.voltages_v.iter().zip(&accurate.bounds_v);
    let Some(datum) = numbers.map(|(v, b)| v + b).position(|v| !v.is_finite()) else {
        return Ok(());
    };
    let [stimulation, pattern] = model.protocol().data()[datum].map(|i| i as usize);
    let row = &workspace.electrode_potentials[stimulation * model.protocol().electrodes()..];
    let measured = &model.patterns.measurements[pattern];
    let electrode = measured.iter().map(|m| m.0 as usize).find(|&l| !row[l].is_finite());
    let electrode = electrode.or(measured.first().map(|m| m.0 as usize)).unwrap_or(0);
    Err(FemError::NonFinitePotential {
        stimulation,
        electrode: electrode + 1,
        value_v: row[electrode],
    })
}
