//! Quadratic triangles and edges, straight or curved (isoparametric).
//!
//! Nodes 0, 1, 2 are the corners, 3, 4, 5 the midside nodes of edges 0-1, 1-2, 2-0. In barycentric
//! coordinates `b` the shape functions are `b_i (2 b_i - 1)` for corners and `4 b_i b_j` for midside nodes;
//! the same functions map the reference triangle to the element (isoparametric). At each point of a
//! quadrature rule, the two tangents `t1, t2` of that map span the tangent plane of the skin. The
//! gradient in that plane is computed as on a linear triangle with `e1 = t1`, `e2 = t2`. (Ciarlet,
//! Raviart 1972; Hughes, The Finite Element Method, section 3.) On a straight triangle the rule is
//! exact.
//!
//! The scaled gradients at the six points have twelve components, of which only five are
//! independent. Of an orthogonal factorisation `G = Q A`, only the triangular factor `A` is kept:
//! its five components give the same products of gradients as the twelve, at less than half the
//! work per field and Jacobian entry.

use super::gradient::pair;
use crate::model::Grain;
use eit_core::vector::{cross, dot, norm, sub};

/// Number of nodes of a triangle.
const NODES: usize = 6;
/// Number of independent components of a gradient.
const COMPONENTS: usize = NODES - 1;
/// Number of coefficients.
const PAIRS: usize = 15;

/// Triangle rule of degree 4. Two barycentric coordinates of each point are equal; each entry holds
/// their value and the weight of its three points (Cowper 1973; the weights sum to one).
const ORBITS: [(f64, f64); 2] = [
    (0.445_948_490_915_964_9, 0.223_381_589_678_011_47),
    (0.091_576_213_509_770_74, 0.109_951_743_655_321_87),
];

/// Edge rule of degree 7: the four Gauss-Legendre points on -1 .. 1 and their weights.
const EDGE_POINTS: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];

/// Barycentric coordinates and weights of the triangle rule.
fn points() -> impl Iterator<Item = ([f64; 3], f64)> {
    ORBITS.into_iter().flat_map(|(a, weight)| {
        (0..3).map(move |k| {
            let mut at = [a; 3];
            at[k] = 1.0 - 2.0 * a;
            (at, weight)
        })
    })
}

/// Values of the shape functions.
fn values([b0, b1, b2]: [f64; 3]) -> [f64; NODES] {
    let corner = |b: f64| b * (2.0 * b - 1.0);
    [corner(b0), corner(b1), corner(b2), 4.0 * b0 * b1, 4.0 * b1 * b2, 4.0 * b2 * b0]
}

/// Derivatives of the shape functions along sides 0-1 and 0-2 of the reference triangle.
fn slopes([b0, b1, b2]: [f64; 3]) -> [[f64; NODES]; 2] {
    let corner = |b: f64| 4.0 * b - 1.0;
    [
        [-corner(b0), corner(b1), 0.0, 4.0 * (b0 - b1), 4.0 * b2, -4.0 * b2],
        [-corner(b0), 0.0, corner(b2), -4.0 * b1, 4.0 * b1, 4.0 * (b0 - b2)],
    ]
}

/// Sum of node positions times shape-function derivatives. It uses differences from the first node,
/// which avoids cancellation far from the origin; the derivatives sum to zero.
fn tangent<const N: usize>(nodes: &[[f64; 3]; N], slopes: &[f64; N]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (node, slope) in nodes.iter().zip(slopes).skip(1) {
        let from_first = sub(*node, nodes[0]);
        sum.iter_mut().zip(from_first).for_each(|(s, d)| *s += slope * d);
    }
    sum
}

/// Smallest ratio of the local area of the map to that of the straight triangle, over the points of
/// the rule. It is one for a straight element and negative where the element folds over.
pub(crate) fn least_stretch(nodes: [[f64; 3]; NODES]) -> f64 {
    let normal = cross(sub(nodes[1], nodes[0]), sub(nodes[2], nodes[0]));
    let stretch = |at: [f64; 3]| {
        let [t1, t2] = slopes(at).map(|s| tangent(&nodes, &s));
        dot(cross(t1, t2), normal) / dot(normal, normal)
    };
    points().map(|(at, _)| stretch(at)).fold(f64::INFINITY, f64::min)
}

/// Computes the dimensionless coefficients of an element; see [`crate::element`].
pub(crate) fn coefficients(nodes: [[f64; 3]; NODES], grain: Option<&Grain>) -> [f64; PAIRS] {
    // contribution of node i + 1 to each of the twelve components
    let mut columns = [[0.0; 2 * NODES]; COMPONENTS];
    for (k, (at, weight)) in points().enumerate() {
        let along = slopes(at);
        let tangents = along.map(|s| tangent(&nodes, &s));
        let [t1, t2] = grain.map_or(tangents, |grain| grain.mapped(tangents));
        let l = norm(t1);
        let double_area = norm(cross(t1, t2));
        let h = double_area / l;
        let root = (0.5 * weight * double_area).sqrt();
        let shear = dot(t1, t2) / (l * l);
        for (i, column) in columns.iter_mut().enumerate() {
            let [first, second] = along.map(|s| s[i + 1]);
            column[2 * k] = root / l * first;
            column[2 * k + 1] = root / h * (second - shear * first);
        }
    }
    triangular(columns)
}

/// Computes the triangular factor of an orthogonal factorisation, last column first, by modified
/// Gram-Schmidt; the factor is as accurate as that of Householder's method (Higham 2002, section
/// 19.8).
fn triangular(mut columns: [[f64; 2 * NODES]; COMPONENTS]) -> [f64; PAIRS] {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let mut factor = [0.0; PAIRS];
    for c in (0..COMPONENTS).rev() {
        let (others, last) = columns.split_at_mut(c);
        let last = &last[0];
        let length = product(last, last).sqrt();
        factor[pair(c, c + 1)] = length;
        for (i, column) in others.iter_mut().enumerate() {
            let along = product(column, last) / length;
            factor[pair(i, c + 1)] = along;
            column.iter_mut().zip(last).for_each(|(x, q)| *x -= along / length * q);
        }
    }
    factor
}

/// Values of the shape functions at the quadrature points of a triangle, and the area weight of
/// each point, square metres.
pub(crate) fn triangle_points(
    nodes: [[f64; 3]; NODES],
) -> impl Iterator<Item = ([f64; NODES], f64)> {
    points().map(move |(at, weight)| {
        let [t1, t2] = slopes(at).map(|s| tangent(&nodes, &s));
        (values(at), 0.5 * weight * norm(cross(t1, t2)))
    })
}

/// Values of the shape functions of an edge (ends, middle) at its quadrature points, and the length
/// weight of each point, metres.
pub(crate) fn edge_points(nodes: [[f64; 3]; 3]) -> impl Iterator<Item = ([f64; 3], f64)> {
    EDGE_POINTS.into_iter().map(move |(t, weight)| {
        let values = [0.5 * t * (t - 1.0), 0.5 * t * (t + 1.0), 1.0 - t * t];
        let along = tangent(&nodes, &[t - 0.5, t + 0.5, -2.0 * t]);
        (values, weight * norm(along))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::gradient::{gradient, stiffness};
    use crate::element::linear::{area_m2, linear};

    const CORNERS: [[f64; 3]; 3] = [[0.1, 0.2, 0.3], [1.0, -0.4, 0.5], [0.3, 0.9, -0.7]];

    fn straight(corners: [[f64; 3]; 3]) -> [[f64; 3]; NODES] {
        let middle =
            |i: usize, j: usize| std::array::from_fn(|k| 0.5 * (corners[i][k] + corners[j][k]));
        [corners[0], corners[1], corners[2], middle(0, 1), middle(1, 2), middle(2, 0)]
    }

    /// Integral of `b0^i b1^j b2^k` over a triangle of unit area: `2 i! j! k! / (i + j + k + 2)!`.
    #[test]
    fn the_rules_are_exact_to_their_degree() {
        let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
        for [i, j, k] in [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0], [3, 0, 0], [1, 1, 1]]
            .into_iter()
            .chain([[2, 1, 0], [4, 0, 0], [3, 1, 0], [2, 2, 0], [2, 1, 1]])
        {
            let found: f64 =
                points().map(|(b, w)| w * b[0].powi(i) * b[1].powi(j) * b[2].powi(k)).sum();
            let wanted =
                2.0 * factorial(i) * factorial(j) * factorial(k) / factorial(i + j + k + 2);
            // constants of 16 digits
            assert!((found - wanted).abs() < 1e-15, "{i} {j} {k}: {found} {wanted}");
        }
        for power in 0..8 {
            let found: f64 = EDGE_POINTS.iter().map(|(t, w)| w * t.powi(power)).sum();
            let wanted = if power % 2 == 0 { 2.0 / f64::from(power + 1) } else { 0.0 };
            assert!((found - wanted).abs() < 1e-15, "{power}: {found} {wanted}");
        }
    }

    /// On a straight triangle, a linear function has the energy of the linear element.
    #[test]
    fn linear_functions_have_the_energy_of_linear_elements() {
        let nodes = straight(CORNERS);
        let slope = [0.7, -1.1, 0.4];
        let g: [f64; 2] = gradient(&linear(CORNERS, None), CORNERS.map(|p| dot(p, slope)));
        let q: [f64; 5] = gradient(&coefficients(nodes, None), nodes.map(|p| dot(p, slope)));
        let square = |g: &[f64]| g.iter().map(|x| x * x).sum::<f64>();
        assert!((square(&g) - square(&q)).abs() < 1e-14 * square(&g));
        assert!((least_stretch(nodes) - 1.0).abs() < 1e-14);
    }

    /// Textbook stiffness of the right triangle with legs of 1; six times the stiffness is an
    /// integer.
    #[test]
    fn stiffness_of_the_right_triangle() {
        let right = straight([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let k = stiffness::<6, 15>(&coefficients(right, None));
        let wanted = [
            (0, 1, 1.0),
            (0, 2, 1.0),
            (1, 2, 0.0),
            (0, 3, -4.0),
            (1, 3, -4.0),
            (2, 3, 0.0),
            (0, 4, 0.0),
            (1, 4, 0.0),
            (2, 4, 0.0),
            (3, 4, -8.0),
            (0, 5, -4.0),
            (1, 5, 0.0),
            (2, 5, -4.0),
            (3, 5, 0.0),
            (4, 5, -8.0),
        ];
        for (i, j, six_times) in wanted {
            let found = 6.0 * k[pair(i, j)];
            assert!((found - six_times).abs() < 1e-13, "({i}, {j}): {found}, not {six_times}");
        }
    }

    /// On an element curved in space, the five components give the products of the twelve.
    #[test]
    fn the_triangular_factor_keeps_all_products() {
        let mut nodes = straight(CORNERS);
        nodes[3] = [0.5, -0.2, 0.5];
        nodes[4][2] += 0.1;
        let a = coefficients(nodes, None);
        let u = [0.3, -0.8, 0.5, 1.1, 0.2, -0.4];
        let g: [f64; 5] = gradient(&a, u);
        // |surface gradient|^2 by the metric of the tangents
        let energy: f64 = points()
            .map(|(at, weight)| {
                let along = slopes(at);
                let [t1, t2] = along.map(|s| tangent(&nodes, &s));
                let [p, q] = along.map(|s| s.iter().zip(u).map(|(s, u)| s * u).sum::<f64>());
                let [e, f, g] = [dot(t1, t1), dot(t1, t2), dot(t2, t2)];
                let determinant = e * g - f * f;
                let square = (g * p * p - 2.0 * f * p * q + e * q * q) / determinant;
                0.5 * weight * determinant.sqrt() * square
            })
            .sum();
        assert!((g.iter().map(|x| x * x).sum::<f64>() - energy).abs() < 1e-13 * energy);
    }

    /// Length of a quarter of the unit circle as one parabola, and area of a straight triangle.
    #[test]
    fn edges_and_triangles_have_their_measure() {
        let root = 0.5_f64.sqrt();
        let quarter = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [root, root, 0.0]];
        let length: f64 = edge_points(quarter).map(|p| p.1).sum();
        // the parabola differs from the arc by (h / R)^4 / 600 or so
        assert!((length - std::f64::consts::FRAC_PI_2).abs() < 0.01, "{length}");
        let area: f64 = triangle_points(straight(CORNERS)).map(|p| p.1).sum();
        assert!((area - area_m2(CORNERS)).abs() < 1e-15);
        let sums = triangle_points(straight(CORNERS)).map(|(v, _)| v.iter().sum::<f64>());
        assert!(sums.into_iter().all(|sum| (sum - 1.0).abs() < 1e-15));
    }

    #[test]
    fn folded_elements_show() {
        let mut nodes = straight([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        nodes[3][1] = 0.45;
        assert!(least_stretch(nodes) < 0.0);
    }
}
