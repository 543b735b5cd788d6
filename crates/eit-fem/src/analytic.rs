//! Mesh-free reference solution of the complete electrode model on a homogeneous disc.
//!
//! On a disc of radius `R` the map from boundary current density to boundary potential is diagonal
//! in Fourier modes, `cos n t -> R / (sigma n) cos n t`. On electrode `l`, centred at `t_l` with
//! half angle `a`, the current density is expanded in Legendre polynomials,
//! `j(t_l + a s) = sum_k c_lk P_k(s)`, whose Fourier coefficients are spherical Bessel functions,
//! `integral of P_k(s) exp(i x s) ds = 2 i^k j_k(x)`. The condition `u + z j = U_l`, tested with
//! `P_m`, gives for `m >= 1`
//!
//! ```text
//! sum_{l', k} G_{lm, l'k} c_{l'k} + 2 z / (2 m + 1) c_lm = 0
//! G_{lm, l'k} = 4 R a / (pi sigma) sum_n j_m(n a) j_k(n a) cos(n (t_l - t_l') + (m - k) pi / 2) / n
//! ```
//!
//! and for `m = 0` the electrode potential; `c_l0 = I_l / (2 a R)` is given. The sum over `n` is
//! truncated at `harmonics`, and the mean of its tail is added: `1 / (4 n^2 a^2)` for terms of one
//! electrode. The module shares no numerical code with the finite elements.

use crate::element::ElementOrder;
use crate::error::FemError;
use crate::model::checks::check_impedances;
use faer::prelude::*;
use faer::{Mat, Side};
use ndarray::{Array2, ArrayView2};
use std::f64::consts::PI;

/// Series solution for a homogeneous disc with rim electrodes of equal width.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DiscSeries {
    /// Radius, metres.
    pub radius_m: f64,
    /// Sheet conductivity, siemens.
    pub conductivity_s: f64,
    /// Centre of each electrode, radians.
    pub electrode_angles_rad: Vec<f64>,
    /// Length of rim covered by each electrode, metres.
    pub electrode_width_m: f64,
    /// Contact impedance, ohm metre.
    pub contact_impedance_ohm_m: f64,
    /// Highest Legendre degree of the current density.
    pub degree: usize,
    /// Highest Fourier mode.
    pub harmonics: usize,
}

impl DiscSeries {
    /// Returns electrode potentials, [pattern, electrode] in volt, for currents, [pattern,
    /// electrode] in ampere. Each row sums to zero.
    ///
    /// # Errors
    /// Parameters that are not finite and above zero; electrodes that cover the whole rim or more;
    /// a current matrix with the wrong number of electrodes; a series too long for these
    /// electrodes.
    pub fn electrode_potentials(
        &self,
        currents_a: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, FemError> {
        let impedance = vec![self.contact_impedance_ohm_m; self.electrode_angles_rad.len()];
        self.electrode_potentials_with(currents_a, &impedance)
    }

    /// Same as [`DiscSeries::electrode_potentials`], but with one contact impedance per electrode,
    /// ohm metre, instead of [`DiscSeries::contact_impedance_ohm_m`].
    ///
    /// # Errors
    /// Those of [`DiscSeries::electrode_potentials`]; a wrong number of impedances, or an impedance
    /// that is not above zero and finite.
    pub fn electrode_potentials_with(
        &self,
        currents_a: ArrayView2<'_, f64>,
        contact_impedance_ohm_m: &[f64],
    ) -> Result<Array2<f64>, FemError> {
        self.validate(currents_a.ncols())?;
        check_impedances(ElementOrder::Linear, currents_a.ncols(), contact_impedance_ohm_m)?;
        let limit = |z: &&f64| **z == 0.0 || z.is_infinite();
        if let Some(&value) = contact_impedance_ohm_m.iter().find(limit) {
            let (quantity, must) = ("contact_impedance_ohm_m", "above zero and finite");
            return Err(FemError::OutOfRange { quantity, value, must });
        }
        let (electrodes, terms) = (self.electrode_angles_rad.len(), self.degree + 1);
        let coupling = self.coupling();
        let at = |l: usize, m: usize| l * terms + m;
        let mass = |l: usize, m: usize| 2.0 * contact_impedance_ohm_m[l] / (2 * m + 1) as f64;
        let unknowns: Vec<usize> =
            (0..electrodes).flat_map(|l| (1..terms).map(move |m| at(l, m))).collect();
        let matrix = Mat::from_fn(unknowns.len(), unknowns.len(), |i, j| {
            let own = || mass(unknowns[i] / terms, unknowns[i] % terms);
            let diagonal = if i == j { own() } else { 0.0 };
            coupling[(unknowns[i], unknowns[j])] + diagonal
        });
        let factor = matrix.llt(Side::Lower).map_err(|_| FemError::OutOfRange {
            quantity: "degree (the series is too long for these electrodes)",
            value: self.degree as f64,
            must: "lower",
        })?;
        let mut potentials = Array2::zeros(currents_a.raw_dim());
        for (mut row, currents) in potentials.rows_mut().into_iter().zip(currents_a.rows()) {
            let mut density = Mat::<f64>::zeros(electrodes * terms, 1);
            for l in 0..electrodes {
                density[(at(l, 0), 0)] = currents[l] / self.electrode_width_m;
            }
            let given = &coupling * &density;
            let mut rest = Mat::from_fn(unknowns.len(), 1, |i, _| -given[(unknowns[i], 0)]);
            factor.solve_in_place(rest.as_mut());
            unknowns.iter().enumerate().for_each(|(i, &u)| density[(u, 0)] = rest[(i, 0)]);
            let mean = &coupling * &density;
            for l in 0..electrodes {
                let contact = contact_impedance_ohm_m[l] * density[(at(l, 0), 0)];
                row[l] = 0.5 * mean[(at(l, 0), 0)] + contact;
            }
            let mean = row.sum() / electrodes as f64;
            row -= mean;
        }
        Ok(potentials)
    }

    fn validate(&self, electrodes: usize) -> Result<(), FemError> {
        let count = self.electrode_angles_rad.len();
        if count != electrodes {
            return Err(FemError::ElectrodeCount { protocol: electrodes, mesh: count });
        }
        let covered = count as f64 * self.electrode_width_m / (2.0 * PI * self.radius_m);
        let checks = [
            ("radius_m", self.radius_m, self.radius_m > 0.0),
            ("conductivity_s", self.conductivity_s, self.conductivity_s > 0.0),
            ("electrode_width_m", self.electrode_width_m, self.electrode_width_m > 0.0),
            ("contact_impedance_ohm_m", self.contact_impedance_ohm_m, {
                self.contact_impedance_ohm_m > 0.0
            }),
            ("harmonics", self.harmonics as f64, self.harmonics > 0),
            ("covered part of the rim", covered, covered < 1.0),
        ];
        let must = "above zero and finite (the covered part: below one)";
        checks
            .into_iter()
            .try_for_each(|(quantity, value, fits)| FemError::require(quantity, value, fits, must))
    }

    /// Computes `G` for all electrodes and degrees.
    fn coupling(&self) -> Mat<f64> {
        let (electrodes, terms) = (self.electrode_angles_rad.len(), self.degree + 1);
        let half_angle = 0.5 * self.electrode_width_m / self.radius_m;
        let scale = 4.0 * self.radius_m * half_angle / (PI * self.conductivity_s);
        let mut sum = Mat::<f64>::zeros(electrodes * terms, electrodes * terms);
        let mut bessel = vec![0.0; terms];
        for n in 1..=self.harmonics {
            spherical_bessel(n as f64 * half_angle, &mut bessel);
            for l in 0..electrodes {
                for other in 0..=l {
                    let angle = self.electrode_angles_rad[l] - self.electrode_angles_rad[other];
                    let (sin, cos) = (n as f64 * angle).sin_cos();
                    let shifted = [cos, -sin, -cos, sin];
                    for m in 0..terms {
                        let row = bessel[m] / n as f64;
                        for k in 0..terms {
                            let phase = shifted[(m + 4 * terms - k) % 4];
                            sum[(l * terms + m, other * terms + k)] += row * bessel[k] * phase;
                        }
                    }
                }
            }
        }
        let tail = 0.25 / (self.harmonics as f64 * half_angle).powi(2);
        for l in 0..electrodes {
            for m in 0..terms {
                for k in (m % 2..terms).step_by(2) {
                    sum[(l * terms + m, l * terms + k)] += tail;
                }
            }
        }
        Mat::from_fn(sum.nrows(), sum.ncols(), |i, j| {
            let lower = if i / terms >= j / terms { sum[(i, j)] } else { sum[(j, i)] };
            scale * lower
        })
    }
}

/// Computes spherical Bessel functions `j_0 .. j_K` at `x > 0`.
///
/// Uses upward recurrence where it is stable (`x > K`), otherwise downward recurrence from a much
/// higher degree (Miller), normalised by `j_0` or `j_1`, whichever is larger.
fn spherical_bessel(x: f64, out: &mut [f64]) {
    let (sin, cos) = x.sin_cos();
    let exact = [sin / x, sin / (x * x) - cos / x];
    let top = out.len();
    if x > top as f64 {
        for k in 0..top {
            out[k] = match k {
                0 | 1 => exact[k],
                _ => (2 * k - 1) as f64 / x * out[k - 1] - out[k - 2],
            };
        }
        return;
    }
    // 30 extra terms: each gains at least a factor (2k + 1) / x > 2, in total at least 1e-16
    let start = 2 * top + 30;
    let (mut above, mut here) = (0.0_f64, 1e-280_f64);
    let mut found = vec![0.0; top.max(2)];
    for k in (0..start).rev() {
        let below = (2 * k + 3) as f64 / x * here - above;
        (above, here) = (here, below);
        if here.abs() > 1e250 {
            (above, here) = (above * 1e-250, here * 1e-250);
            found.iter_mut().for_each(|f| *f *= 1e-250);
        }
        if k < found.len() {
            found[k] = here;
        }
    }
    let norm =
        if exact[0].abs() > exact[1].abs() { exact[0] / found[0] } else { exact[1] / found[1] };
    out.iter_mut().zip(&found).for_each(|(o, f)| *o = norm * f);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spherical_bessel_against_tables() {
        // j_5(1), j_5(10), j_10(1): Abramowitz and Stegun, table 10.1 and recurrence in 50 digits
        for (x, k, wanted) in [
            (1.0, 5, 9.256_115_861_125_815e-5),
            (10.0, 5, -5.553_451_162_145_218e-2),
            (1.0, 10, 7.116_552_640_047_314e-11),
        ] {
            let mut j = vec![0.0; 11];
            spherical_bessel(x, &mut j);
            assert!((j[k] - wanted).abs() < 1e-13 * wanted.abs(), "j_{k}({x}) = {}", j[k]);
        }
    }
}
