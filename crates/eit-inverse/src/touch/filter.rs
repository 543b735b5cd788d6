//! Kalman filter of a position with nearly constant velocity.

use super::skin::across;
use std::array::from_fn;

type Matrix3 = [[f64; 3]; 3];

/// Position and velocity with their covariance; coordinates are coupled through the measurements.
///
/// State `(p, v)`, `p' = p + v dt`, with acceleration white from step to step and of standard deviation
/// `a`: `Q = a^2 [dt^4/4, dt^3/2; dt^3/2, dt^2]` for each coordinate (Bar-Shalom, Li, Kirubarajan,
/// *Estimation with Applications to Tracking and Navigation* (2001), section 6.3.2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Filter {
    pub(super) position_m: [f64; 3],
    pub(super) velocity_m_s: [f64; 3],
    /// Blocks of the covariance: position, position with velocity, velocity.
    pub(super) pp: Matrix3,
    pv: Matrix3,
    vv: Matrix3,
}

impl Filter {
    /// Starts at rest, with velocity of standard deviation `velocity_std_m_s` in each coordinate.
    pub(super) fn new(position_m: [f64; 3], covariance_m2: Matrix3, velocity_std_m_s: f64) -> Self {
        Self {
            position_m,
            velocity_m_s: [0.0; 3],
            pp: covariance_m2,
            pv: [[0.0; 3]; 3],
            vv: diagonal(velocity_std_m_s.powi(2)),
        }
    }

    /// Predicts the state `dt` seconds later.
    pub(super) fn predict(&mut self, dt: f64, acceleration_m_s2: f64) {
        let q = acceleration_m_s2.powi(2);
        for i in 0..3 {
            self.position_m[i] += dt * self.velocity_m_s[i];
        }
        let (pp, pv, vv) = (self.pp, self.pv, self.vv);
        self.pp =
            from_fn(|i| from_fn(|j| pp[i][j] + dt * (pv[i][j] + pv[j][i]) + dt * dt * vv[i][j]));
        self.pv = from_fn(|i| from_fn(|j| pv[i][j] + dt * vv[i][j]));
        for i in 0..3 {
            self.pp[i][i] += q * dt.powi(4) / 4.0;
            self.pv[i][i] += q * dt.powi(3) / 2.0;
            self.vv[i][i] += q * dt * dt;
        }
    }

    /// Stops at the current position, with the velocity as uncertain as at the start.
    pub(super) fn rest(&mut self, velocity_std_m_s: f64) {
        self.velocity_m_s = [0.0; 3];
        self.pv = [[0.0; 3]; 3];
        self.vv = diagonal(velocity_std_m_s.powi(2));
    }

    /// Stops for good: sets the velocity to zero, exactly.
    pub(super) fn stop(&mut self) {
        self.velocity_m_s = [0.0; 3];
        (self.pv, self.vv) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
    }

    /// Adds a variance to each coordinate of the position.
    pub(super) fn spread(&mut self, variance_m2: f64) {
        (0..3).for_each(|i| self.pp[i][i] += variance_m2);
    }

    /// Mean and covariance of two states with the given weights, whose sum is above zero.
    pub(super) fn mixed(states: [(f64, &Self); 2]) -> Self {
        let whole = states[0].0 + states[1].0;
        let shares = states.map(|(weight, _)| weight / whole);
        let [a, b] = states.map(|(_, state)| state);
        let mean = |a: [f64; 3], b: [f64; 3]| from_fn(|i| shares[0] * a[i] + shares[1] * b[i]);
        // of two points, the covariance is the product of their shares times their distance squared
        let apart = shares[0] * shares[1];
        let way: [f64; 3] = from_fn(|i| a.position_m[i] - b.position_m[i]);
        let change: [f64; 3] = from_fn(|i| a.velocity_m_s[i] - b.velocity_m_s[i]);
        let block = |a: &Matrix3, b: &Matrix3, x: [f64; 3], y: [f64; 3]| -> Matrix3 {
            from_fn(|i| {
                from_fn(|j| shares[0] * a[i][j] + shares[1] * b[i][j] + apart * x[i] * y[j])
            })
        };
        Self {
            position_m: mean(a.position_m, b.position_m),
            velocity_m_s: mean(a.velocity_m_s, b.velocity_m_s),
            pp: block(&a.pp, &b.pp, way, way),
            pv: block(&a.pv, &b.pv, way, change),
            vv: block(&a.vv, &b.vv, change, change),
        }
    }

    /// Logarithm of the probability density of a measured position, of its component across
    /// `normal`, up to a constant; `None` if the covariance is singular.
    pub(super) fn log_density(
        &self,
        place_m: [f64; 3],
        covariance_m2: &Matrix3,
        normal: [f64; 3],
    ) -> Option<f64> {
        let axes = across(normal);
        let s = sum(&self.pp, covariance_m2);
        let y: [f64; 3] = from_fn(|i| place_m[i] - self.position_m[i]);
        let along = axes.map(|axis| (0..3).map(|i| axis[i] * y[i]).sum::<f64>());
        let block = |a: usize, b: usize| -> f64 {
            (0..3)
                .flat_map(|i| (0..3).map(move |j| (i, j)))
                .map(|(i, j)| axes[a][i] * s[i][j] * axes[b][j])
                .sum()
        };
        let (aa, ab, bb) = (block(0, 0), block(0, 1), block(1, 1));
        let determinant = aa * bb - ab * ab;
        let squared = (bb * along[0] * along[0] - 2.0 * ab * along[0] * along[1]
            + aa * along[1] * along[1])
            / determinant;
        (determinant > 0.0 && squared.is_finite()).then(|| -0.5 * (squared + determinant.ln()))
    }

    /// Updates the state with a measured position.
    pub(super) fn update(&mut self, place_m: [f64; 3], covariance_m2: &Matrix3) {
        let Some(inverse) = inverse(&sum(&self.pp, covariance_m2)) else { return };
        let y: [f64; 3] = from_fn(|i| place_m[i] - self.position_m[i]);
        let product = times(&inverse, y);
        let (pp, pv, vv) = (self.pp, self.pv, self.vv);
        for i in 0..3 {
            self.position_m[i] += (0..3).map(|k| pp[i][k] * product[k]).sum::<f64>();
            // the rows of the velocity are the transposed block
            self.velocity_m_s[i] += (0..3).map(|k| pv[k][i] * product[k]).sum::<f64>();
        }
        // A - B' S^-1 C, both factors read by rows of the measured position
        let reduced = |a: &Matrix3, b: &Matrix3, c: &Matrix3| -> Matrix3 {
            from_fn(|i| {
                from_fn(|j| {
                    let mut value = a[i][j];
                    for k in 0..3 {
                        for l in 0..3 {
                            value -= b[k][i] * inverse[k][l] * c[l][j];
                        }
                    }
                    value
                })
            })
        };
        self.pp = symmetric(&reduced(&pp, &pp, &pp));
        self.pv = reduced(&pv, &pp, &pv);
        self.vv = symmetric(&reduced(&vv, &pv, &pv));
    }
}

fn diagonal(value: f64) -> Matrix3 {
    from_fn(|i| from_fn(|j| if i == j { value } else { 0.0 }))
}

fn sum(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    from_fn(|i| from_fn(|j| a[i][j] + b[i][j]))
}

fn symmetric(a: &Matrix3) -> Matrix3 {
    from_fn(|i| from_fn(|j| 0.5 * (a[i][j] + a[j][i])))
}

fn times(a: &Matrix3, x: [f64; 3]) -> [f64; 3] {
    from_fn(|i| (0..3).map(|j| a[i][j] * x[j]).sum())
}

/// Inverse of a symmetric positive definite matrix by cofactors.
fn inverse(a: &Matrix3) -> Option<Matrix3> {
    let minor = |i: usize, j: usize| {
        let (r, c) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
        a[r[0]][c[0]] * a[r[1]][c[1]] - a[r[0]][c[1]] * a[r[1]][c[0]]
    };
    let determinant: f64 = (0..3).map(|j| a[0][j] * minor(0, j)).sum();
    (determinant > 0.0 && determinant.recip().is_finite())
        .then(|| from_fn(|i| from_fn(|j| minor(j, i) / determinant)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_to_least_squares_on_a_line() {
        // no acceleration and an unknown velocity: the straight line through the measurements. Five of
        // variance 1 at t = 0..4 of 3 + 2 t, with residuals orthogonal to both terms
        let error = [1.0, -1.0, -1.0, 1.0, 0.0];
        let fit = {
            let (mut s, mut st) = (0.0, 0.0);
            for (t, e) in error.iter().enumerate() {
                s += e;
                st += e * (t as f64 - 2.0);
            }
            [3.0 + 2.0 * 4.0 + s / 5.0 + 2.0 * st / 10.0, 2.0 + st / 10.0]
        };
        let one = diagonal(1.0);
        let mut filter = Filter::new([3.0 + error[0], 0.0, 0.0], one, 1e4);
        for (t, e) in error.iter().enumerate().skip(1) {
            filter.predict(1.0, 0.0);
            filter.update([3.0 + 2.0 * t as f64 + e, 0.0, 0.0], &one);
        }
        // the prior of the velocity weighs 1e-8
        assert!((filter.position_m[0] - fit[0]).abs() < 1e-6);
        assert!((filter.velocity_m_s[0] - fit[1]).abs() < 1e-6);
        // variances of a regression at its last point and of its slope
        assert!((filter.pp[0][0] - (0.2 + 4.0 / 10.0)).abs() < 1e-6);
        assert!((filter.vv[0][0] - 0.1).abs() < 1e-6);
    }
}
