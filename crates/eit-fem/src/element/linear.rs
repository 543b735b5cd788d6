//! Linear triangles; see [`crate::element`].

use crate::model::Grain;
use eit_core::vector::{cross, dot, norm, sub};

/// Computes the dimensionless coefficients of a linear triangle: `alpha`, `-gamma`, `beta`.
pub(crate) fn linear(corners: [[f64; 3]; 3], grain: Option<&Grain>) -> [f64; 3] {
    let edges = [1, 2].map(|k| sub(corners[k], corners[0]));
    let [e1, e2] = grain.map_or(edges, |grain| grain.mapped(edges));
    let l = dot(e1, e1).sqrt();
    let double_area = norm(cross(e1, e2));
    let h = double_area / l;
    let root = (0.5 * double_area).sqrt();
    [root / l, -(root * dot(e1, e2) / (l * l * h)), root / h]
}

/// Area of a triangle, square metres.
pub(crate) fn area_m2(corners: [[f64; 3]; 3]) -> f64 {
    0.5 * norm(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::gradient::{gradient, stiffness};

    #[test]
    fn stiffness_of_the_right_triangle_is_the_textbook_one() {
        let k =
            stiffness::<3, 3>(&linear([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], None));
        // the exact values, up to a few roundings
        for (found, wanted) in k.iter().zip([-0.5, -0.5, 0.0]) {
            assert!((found - wanted).abs() < 4.0 * f64::EPSILON);
        }
    }

    #[test]
    fn gradient_of_a_linear_function_on_a_tilted_triangle() {
        let corners = [[0.1, 0.2, 0.3], [1.0, -0.4, 0.5], [0.3, 0.9, -0.7]];
        let slope = [0.7, -1.1, 0.4];
        let u = corners.map(|p| dot(p, slope));
        let g: [f64; 2] = gradient(&linear(corners, None), u);
        // |g|^2 = A |tangential slope|^2, computed with the unit normal
        let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let along = dot(slope, normal) / norm(normal);
        let wanted = 0.5 * norm(normal) * (dot(slope, slope) - along * along);
        assert!((g[0] * g[0] + g[1] * g[1] - wanted).abs() < 1e-14 * wanted.max(1.0));
    }
}
