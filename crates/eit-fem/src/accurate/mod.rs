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

use crate::FemError;
use crate::assembly::Adjacency;
use crate::forward::ForwardModel;
use crate::geometry::Geometry;
use crate::solver::order;
use crate::workspace::Workspace;
use ldl::{Ldl, Rows};
use network::{Combination, Network};
use real::{Real, Twice};

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

/// Means of the skin's potential under each electrode but the last, for unit currents.
struct Transfer<T> {
    /// [electrode, current], ohm.
    values: Vec<T>,
    /// Error bound of each value.
    bounds: Vec<f64>,
    /// Rounding part of each bound over [`Transfer::rounding`].
    sensitivities: Vec<f64>,
    rounding: f64,
    backward_error: f64,
    count: usize,
}

impl<T: Real> Transfer<T> {
    /// Corrects the solution by its residual, and bounds what remains. One pass over branches.
    fn new(network: &Network<T>, places: &Places, fields: &Columns<T>) -> Self {
        let count = fields.count;
        let mut residual = Columns::unit_currents(places, network);
        let mut sizes = vec![0.0; residual.values.len()];
        let mut sensitivities = vec![0.0; count * count];
        let (mut t, mut a) = (vec![T::of(0.0); count], vec![0.0; count]);
        let mut longest = 0;
        for branch in &network.branches {
            longest = longest.max(branch.difference.len());
            t.fill(T::of(0.0));
            a.fill(0.0);
            for (i, c) in places.terms(&branch.difference) {
                for ((t, a), x) in t.iter_mut().zip(&mut a).zip(fields.row(i)) {
                    *t += c * *x;
                    *a += (c.high() * x.high()).abs();
                }
            }
            for (i, c) in places.terms(&branch.difference) {
                let (weight, size) = (branch.weight * c, branch.size * c.high().abs());
                for k in 0..count {
                    residual.values[i * count + k] -= weight * t[k];
                    sizes[i * count + k] += size * a[k];
                }
            }
            for k in 0..count {
                for l in 0..count {
                    let product = t[k].high().abs() * a[l] + a[k] * t[l].high().abs();
                    sensitivities[k * count + l] += branch.size * product;
                }
            }
        }
        // a term takes a few roundings, a sum one per term
        let rounding = (64 + 4 * longest) as f64 * T::ROUNDING;
        let (mut values, mut bounds) = (Vec::new(), Vec::new());
        for k in 0..count {
            for l in 0..count {
                // sixteen digits of a term that starts at the thirtieth
                let product = |i| fields.row(i)[k].high() * residual.row(i)[l].high();
                let products = (0..places.count).map(product);
                let correction: f64 = products.sum();
                values.push(fields.row(places.inner + k)[l] + T::of(correction));
                let rounded = 2.0 * rounding * sensitivities[k * count + l];
                bounds.push(correction.abs() + rounded);
            }
        }
        let ratio = |(r, s): (&T, &f64)| if *s > 0.0 { r.high().abs() / s } else { 0.0 };
        let backward_error = residual.values.iter().zip(&sizes).map(ratio).fold(0.0, f64::max);
        Self { values, bounds, sensitivities, rounding, backward_error, count }
    }

    /// Every voltage, formed from its own products: what cancels never meets what does not.
    fn voltages(
        &self,
        model: &ForwardModel,
        geometry: &Geometry,
        network: &Network<T>,
        scale: f64,
    ) -> Accurate {
        let (mut voltages_v, mut bounds_v, mut condition) = (Vec::new(), Vec::new(), 0.0_f64);
        for &[s, m] in model.protocol().data() {
            let mut voltage = T::of(0.0);
            let (mut bound, mut sensitivity) = (0.0, 0.0);
            for &(k, weight) in &model.patterns.measurements[m as usize] {
                for &(l, current) in &model.patterns.stimulations_a[s as usize] {
                    let factor = T::of(weight) * T::of(current);
                    let (k, l) = (k as usize, l as usize);
                    if k == l {
                        let contact = factor * self.contact(geometry, network, k, scale);
                        voltage += contact;
                        bound += self.rounding * contact.high().abs();
                    }
                    if k < self.count && l < self.count {
                        let at = k * self.count + l;
                        voltage += factor * self.values[at];
                        let rounded = self.rounding * self.values[at].high().abs();
                        bound += factor.high().abs() * (self.bounds[at] + rounded);
                        sensitivity += factor.high().abs() * self.sensitivities[at];
                    }
                }
            }
            voltages_v.push(voltage.high() / scale);
            bounds_v.push(bound / scale + f64::EPSILON * (voltage.high() / scale).abs());
            condition = condition.max(sensitivity / scale);
        }
        let largest = voltages_v.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        Accurate {
            voltages_v,
            bounds_v,
            low: Vec::new(),
            levels_v: Vec::new(),
            backward_error: self.backward_error,
            condition: condition / largest,
            factor_entries: 0,
            twice: T::ROUNDING < f64::EPSILON,
        }
    }

    /// `z / length` of an electrode in scaled units.
    fn contact(&self, geometry: &Geometry, network: &Network<T>, l: usize, scale: f64) -> T {
        T::of(geometry.impedance[l]) * T::of(scale) / network.measures[l]
    }

    /// Electrode potentials of every stimulation into the workspace; returns the potential of the
    /// last electrode's mean. An infinite impedance that carries current has an infinite potential
    /// and is left out of the mean that is zero.
    fn potentials(
        &self,
        model: &ForwardModel,
        geometry: &Geometry,
        network: &Network<T>,
        scale: f64,
        workspace: &mut Workspace,
    ) -> Vec<f64> {
        let electrodes = self.count + 1;
        let rows = workspace.electrode_potentials.chunks_exact_mut(electrodes);
        rows.zip(&model.patterns.stimulations_a)
            .map(|(row, currents)| {
                let mut exact = vec![T::of(0.0); electrodes];
                let mut infinite = vec![None; electrodes];
                for &(l, current) in currents {
                    let l = l as usize;
                    if geometry.impedance[l].is_infinite() {
                        infinite[l] = Some(f64::INFINITY.copysign(current));
                    } else {
                        exact[l] += self.contact(geometry, network, l, scale) * T::of(current);
                    }
                    if l < self.count {
                        for (k, u) in exact[..self.count].iter_mut().enumerate() {
                            *u += self.values[k * self.count + l] * T::of(current);
                        }
                    }
                }
                let finite = exact.iter().zip(&infinite).filter(|(_, i)| i.is_none());
                let (sum, n) = finite.fold((T::of(0.0), 0.0), |(s, n), (u, _)| (s + *u, n + 1.0));
                let mean = if n > 0.0 { sum / T::of(n) } else { sum };
                for ((u, e), i) in row.iter_mut().zip(&exact).zip(&infinite) {
                    *u = i.unwrap_or((*e - mean).high() / scale);
                }
                -mean.high() / scale
            })
            .collect()
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
