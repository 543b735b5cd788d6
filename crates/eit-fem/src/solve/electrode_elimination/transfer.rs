//! Voltages and their error bounds from the fields of unit currents.

use super::network::Network;
use super::outcome::Outcome;
use super::variables::{Columns, Places};
use crate::model::{ForwardModel, Geometry};
use crate::solve::workspace::Workspace;
use crate::sparse::real::Real;

/// Mean potential of the skin under each electrode except the last, for unit currents.
pub(super) struct Transfer<T> {
    /// [electrode, current], ohm.
    values: Vec<T>,
    /// Error bound of each value.
    bounds: Vec<f64>,
    /// Rounding part of each bound, divided by [`Transfer::rounding`].
    sensitivities: Vec<f64>,
    rounding: f64,
    backward_error: f64,
    count: usize,
}

impl<T: Real> Transfer<T> {
    /// Corrects the solution by its residual and bounds the remaining error, in one pass over the
    /// branches.
    pub(crate) fn new(network: &Network<T>, places: &Places, fields: &Columns<T>) -> Self {
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
        // a few roundings per term, and one per term for the sum
        let rounding = (64 + 4 * longest) as f64 * T::ROUNDING;
        let (mut values, mut bounds) = (Vec::new(), Vec::new());
        for k in 0..count {
            for l in 0..count {
                // `f64` suffices: in twice the precision the correction starts near the thirtieth
                // digit
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

    /// Computes each voltage from its own products, so that large terms that cancel are not added
    /// to small ones.
    pub(crate) fn voltages(
        &self,
        model: &ForwardModel,
        geometry: &Geometry,
        network: &Network<T>,
        scale: f64,
    ) -> Outcome {
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
        Outcome {
            voltages_v,
            bounds_v,
            low: Vec::new(),
            levels_v: Vec::new(),
            backward_error: self.backward_error,
            condition: condition / largest,
            factor_entries: 0,
            extended: T::ROUNDING < f64::EPSILON,
        }
    }

    /// `z / length` of an electrode, in scaled units.
    fn contact(&self, geometry: &Geometry, network: &Network<T>, l: usize, scale: f64) -> T {
        T::of(geometry.impedance[l]) * T::of(scale) / network.measures[l]
    }

    /// Writes the electrode potentials of every stimulation into the workspace and returns the
    /// potential of the last electrode's mean. An electrode with infinite impedance that carries
    /// current has an infinite potential and is excluded when the mean is set to zero.
    pub(crate) fn potentials(
        &self,
        model: &ForwardModel,
        geometry: &Geometry,
        network: &Network<T>,
        scale: f64,
        workspace: &mut Workspace,
    ) -> Vec<f64> {
        let electrodes = self.count + 1;
        let rows = workspace.nodal.electrode_potentials.chunks_exact_mut(electrodes);
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
