//! The P1 triangle: scaled gradients and stiffness from edge vectors alone.
//!
//! In a triangle's own plane let `e1 = p1 - p0` lie on the first axis, `l = |e1|`, and let
//! `e2 = p2 - p0 = (c, h)`. The gradient of nodal values `u`, times the square root of the area
//! `A = l h / 2`, is
//!
//! ```text
//! g = sqrt(A) grad u = ( alpha (u1 - u0),  beta (u2 - u0) - gamma (u1 - u0) )
//! alpha = sqrt(A) / l,   beta = sqrt(A) / h,   gamma = sqrt(A) c / (h l)
//! ```
//!
//! so that an element of conductivity `sigma` contributes `sigma g(u) . g(w)` to the energy, and
//! `-g(u) . g(w)` is its Jacobian entry. Three numbers a triangle serve assembly and Jacobian, on
//! flat and curved skins alike. (Linear triangle: any finite element text, for example
//! Hughes, The Finite Element Method, section 3.)

/// Scaled gradient coefficients of one triangle, dimensionless.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Element {
    /// `sqrt(A) / l`.
    pub alpha: f64,
    /// `sqrt(A) / h`.
    pub beta: f64,
    /// `sqrt(A) c / (h l)`.
    pub gamma: f64,
}

impl Element {
    /// From the three corners, metres.
    pub fn new(corners: [[f64; 3]; 3]) -> Self {
        let edge = |k: usize| sub(corners[k], corners[0]);
        let (e1, e2) = (edge(1), edge(2));
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let l = dot(e1, e1).sqrt();
        let double_area = norm(cross(e1, e2));
        let h = double_area / l;
        let root = (0.5 * double_area).sqrt();
        Self { alpha: root / l, beta: root / h, gamma: root * dot(e1, e2) / (l * l * h) }
    }

    /// Scaled gradient of nodal values.
    #[inline(always)]
    pub fn gradient(self, u: [f64; 3]) -> [f64; 2] {
        let (d1, d2) = (u[1] - u[0], u[2] - u[0]);
        [self.alpha * d1, self.beta * d2 - self.gamma * d1]
    }

    /// Off-diagonal stiffness entries between the nodes (0,1), (1,2) and (2,0) for unit
    /// conductivity; the diagonal is minus the sum of its row.
    pub fn stiffness(self) -> [f64; 3] {
        // gradients of the hat functions: columns of the map above
        let g1 = [self.alpha, -self.gamma];
        let g2 = [0.0, self.beta];
        let g0 = [-self.alpha, self.gamma - self.beta];
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        [dot(g0, g1), dot(g1, g2), dot(g2, g0)]
    }
}

/// Area of a triangle, square metres.
pub(crate) fn area_m2(corners: [[f64; 3]; 3]) -> f64 {
    0.5 * norm(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])))
}

fn sub(b: [f64; 3], a: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| b[i] - a[i])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn norm(a: [f64; 3]) -> f64 {
    (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stiffness_of_the_right_triangle_is_the_textbook_one() {
        let k = Element::new([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).stiffness();
        // exact numbers, a few roundings
        for (found, wanted) in k.iter().zip([-0.5, 0.0, -0.5]) {
            assert!((found - wanted).abs() < 4.0 * f64::EPSILON);
        }
    }

    #[test]
    fn gradient_of_a_linear_function_on_a_tilted_triangle() {
        let corners = [[0.1, 0.2, 0.3], [1.0, -0.4, 0.5], [0.3, 0.9, -0.7]];
        let slope = [0.7, -1.1, 0.4];
        let u = corners.map(|p| p[0] * slope[0] + p[1] * slope[1] + p[2] * slope[2]);
        let g = Element::new(corners).gradient(u);
        // |g|^2 = A |tangential slope|^2, computed with the unit normal
        let (a, b): ([f64; 3], [f64; 3]) = (
            std::array::from_fn(|i| corners[1][i] - corners[0][i]),
            std::array::from_fn(|i| corners[2][i] - corners[0][i]),
        );
        let n = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let norm = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        let normal = n.map(|x| x / norm);
        let along = (0..3).map(|i| slope[i] * normal[i]).sum::<f64>();
        let tangential = slope.iter().map(|s| s * s).sum::<f64>() - along * along;
        let wanted = 0.5 * norm * tangential;
        assert!((g[0] * g[0] + g[1] * g[1] - wanted).abs() < 1e-14 * wanted.max(1.0));
    }
}
