//! The Gaussian bell fitted to touches.

use eit_mesh::Surface;
use std::array::from_fn;

/// A round touch: `sigma = background (1 + amplitude exp(-d^2 / (2 radius^2)))`, where `d` is the straight
/// distance from the centre.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Bell {
    /// Centre on the skin, metres.
    pub position_m: [f64; 3],
    /// Change at the centre relative to the background; greater than -1.
    pub amplitude: f64,
    /// Radius, metres. At 1.18 radii the change is half of that at the centre.
    pub radius_m: f64,
}

/// Quadrature points of degree 2 on a triangle: barycentric permutations of (2/3, 1/6, 1/6) with equal
/// weights (Strang, Fix, *An Analysis of the Finite Element Method* (1973), table 4.1).
const HEAVY: f64 = 2.0 / 3.0;
const LIGHT: f64 = 1.0 / 6.0;

/// Distance in radii beyond which a bell is zero in double precision.
const REACH: f64 = 9.0;

/// Returns the points at which bells are averaged over each element, `[element]`.
pub(super) fn quadrature(surface: &Surface) -> Vec<[[f64; 3]; 3]> {
    let of = |t: usize| {
        let corners = surface.corners(t);
        from_fn(|heavy| {
            from_fn(|axis| {
                let total: f64 = corners.iter().map(|corner| corner[axis]).sum();
                LIGHT * total + (HEAVY - LIGHT) * corners[heavy][axis]
            })
        })
    };
    (0..surface.triangles().len()).map(of).collect()
}

/// Returns the mean of a bell of height 1 over an element and its derivatives with respect to the two
/// coordinates of the centre along `tangents` and to the logarithm of the radius.
pub(super) fn value_and_slopes(
    points: &[[f64; 3]; 3],
    bell: &Bell,
    tangents: &[[f64; 3]; 2],
) -> (f64, [f64; 3]) {
    let r2 = bell.radius_m * bell.radius_m;
    let (mut value, mut slopes) = (0.0, [0.0; 3]);
    for point in points {
        let d: [f64; 3] = from_fn(|i| point[i] - bell.position_m[i]);
        let d2 = d.iter().map(|d| d * d).sum::<f64>();
        if d2 > REACH * REACH * r2 {
            continue;
        }
        let g = (-0.5 * d2 / r2).exp() / points.len() as f64;
        value += g;
        for (slope, tangent) in slopes.iter_mut().zip(tangents) {
            *slope += g * (0..3).map(|i| d[i] * tangent[i]).sum::<f64>() / r2;
        }
        slopes[2] += g * d2 / r2;
    }
    (value, slopes)
}
