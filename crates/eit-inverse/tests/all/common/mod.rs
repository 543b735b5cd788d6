//! Small skins and analytic Jacobians built by hand, independent of the mesher and the solver.

pub mod detector;

use eit_inverse::{Laplace, LaplaceSettings, Noser, OneStepGaussNewton, OneStepSettings, Prior};
use eit_mesh::Surface;
use faer::linalg::solvers::Solve;
use fixtures::Random;
use ndarray::Array2;

pub const RADIUS_M: f64 = 0.1;

/// The prior `R = I`.
pub const IDENTITY: Noser = Noser { exponent: 0.0 };

pub fn with_lambda(hyperparameter: f64) -> OneStepSettings {
    OneStepSettings { hyperparameter, ..Default::default() }
}

pub fn with_noise(hyperparameter: f64, noise_std: &[f64]) -> OneStepSettings {
    OneStepSettings { noise_std: Some(noise_std.to_vec()), ..with_lambda(hyperparameter) }
}

pub fn one_step(
    jacobian: &Array2<f64>,
    prior: &dyn Prior,
    settings: OneStepSettings,
) -> OneStepGaussNewton {
    OneStepGaussNewton::new(jacobian, prior, settings).unwrap()
}

pub fn laplace(surface: &Surface) -> Laplace {
    Laplace::new(surface, &LaplaceSettings::default()).unwrap()
}

/// Numbers from `low` to `low + 1`.
pub fn uniforms(random: &mut Random, count: usize, low: f64) -> Vec<f64> {
    (0..count).map(|_| low + random.uniform()).collect()
}

/// `R` as a matrix.
pub fn precision(prior: &Laplace, elements: usize) -> Array2<f64> {
    let mut matrix = Array2::eye(elements);
    for mut column in matrix.columns_mut() {
        let unit = column.to_vec();
        column.assign(&prior.precision_times(&unit).unwrap());
    }
    matrix
}

/// Disc of concentric rings; ring k has 6 k nodes, so triangles are near-equilateral.
pub fn disc(radius_m: f64, rings: usize) -> Surface {
    let (mut nodes, mut triangles) = (vec![[0.0; 3]], Vec::new());
    // the rings within ring k have 3 k (k - 1) nodes
    let node = |k: usize, i: usize| if k == 0 { 0 } else { 1 + 3 * k * (k - 1) + i % (6 * k) };
    let node = |k: usize, i: usize| node(k, i) as u32;
    for k in 1..=rings {
        let r = radius_m * k as f64 / rings as f64;
        for outer in 0..6 * k {
            let (sin, cos) = (std::f64::consts::TAU * outer as f64 / (6 * k) as f64).sin_cos();
            nodes.push([r * cos, r * sin, 0.0]);
            // one node fewer in each of six sectors
            let inner = outer - outer / k;
            triangles.push([node(k, outer), node(k, outer + 1), node(k - 1, inner)]);
            if (outer + 1) % k != 0 {
                triangles.push([node(k - 1, inner), node(k, outer + 1), node(k - 1, inner + 1)]);
            }
        }
    }
    Surface::new(nodes, triangles).unwrap()
}

/// Parallelogram of `n` x `n` pairs of equilateral triangles of edge `1 / n` metres.
pub fn equilateral(n: usize) -> Surface {
    let h = 1.0 / n as f64;
    grid(n, |i, j| [h * (i as f64 + 0.5 * j as f64), h * j as f64 * 0.75_f64.sqrt(), 0.0])
}

/// `n` x `n` cells cut along one diagonal, with nodes placed by `place(i, j)`.
pub fn grid(n: usize, place: impl Fn(usize, usize) -> [f64; 3]) -> Surface {
    let nodes = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))).map(|(i, j)| place(i, j));
    let node = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    let cell = |(i, j)| {
        let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1)];
        [[a, b, c], [b, d, c]]
    };
    let cells = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    Surface::new(nodes.collect(), cells.flat_map(cell).collect()).unwrap()
}

/// Quadruples [a, b, m, n] of adjacent drive and measurement without driven electrodes.
pub fn adjacent(electrodes: usize) -> Vec<[usize; 4]> {
    let pair = |l: usize| [l % electrodes, (l + 1) % electrodes];
    let of = |d: usize| (2..electrodes - 1).map(move |k| [pair(d), pair(d + k)]);
    (0..electrodes).flat_map(of).map(|[[a, b], [m, n]]| [a, b, m, n]).collect()
}

/// Sensitivity of a homogeneous disc of 0.1 m with point electrodes just outside its rim, volts per siemens.
///
/// A current I between points a and b on the rim of a disc of sheet conductivity sigma gives
/// `u = I / (pi sigma) log(|x - b| / |x - a|)`, and `dV/dsigma_e = -area grad u . grad w` with `w` the
/// field of a unit current through m and n (here I = 1 A, sigma = 1 S). The point electrodes are at 1.02
/// radii, so that the gradient stays finite in the outermost elements; the field is then that of the plane,
/// times two.
pub fn jacobian(surface: &Surface, electrodes: usize) -> Array2<f64> {
    // field of a unit current out of an electrode
    let push = |x: [f64; 3], l: usize| {
        let (sin, cos) = (std::f64::consts::TAU * l as f64 / electrodes as f64).sin_cos();
        let [dx, dy] = [x[0] - 1.02 * RADIUS_M * cos, x[1] - 1.02 * RADIUS_M * sin];
        let r2 = dx * dx + dy * dy;
        [dx / r2 / std::f64::consts::PI, dy / r2 / std::f64::consts::PI]
    };
    let quadruples = adjacent(electrodes);
    let centroids = surface.centroids();
    Array2::from_shape_fn((quadruples.len(), centroids.len()), |(i, e)| {
        let [pa, pb, pm, pn] = quadruples[i].map(|l| push(centroids[e], l));
        let products = (0..2).map(|k| (pb[k] - pa[k]) * (pn[k] - pm[k]));
        -surface.areas_m2()[e] * products.sum::<f64>()
    })
}

/// Image of a round target, siemens, [element].
pub fn target(surface: &Surface, [x, y]: [f64; 2], radius_m: f64, change_s: f64) -> Vec<f64> {
    let value = |c: [f64; 3]| if (c[0] - x).hypot(c[1] - y) <= radius_m { change_s } else { 0.0 };
    surface.centroids().into_iter().map(value).collect()
}

/// Solves `a x = b` by Gaussian elimination with partial pivoting, which the library uses nowhere.
pub fn solve(a: Array2<f64>, b: Array2<f64>) -> Array2<f64> {
    let mat = |x: &Array2<f64>| faer::Mat::from_fn(x.nrows(), x.ncols(), |i, j| x[(i, j)]);
    let x = mat(&a).partial_piv_lu().solve(mat(&b));
    Array2::from_shape_fn(b.dim(), |(i, j)| x[(i, j)])
}

/// Returns the largest difference relative to the largest entry of `b`.
pub fn relative_difference<'a>(
    a: impl IntoIterator<Item = &'a f64>,
    b: impl IntoIterator<Item = &'a f64>,
) -> f64 {
    let larger = |[difference, size]: [f64; 2], (x, y): (&f64, &f64)| {
        // `max` would ignore it
        assert!(x.is_finite() && y.is_finite(), "{x} {y}");
        [difference.max((x - y).abs()), size.max(y.abs())]
    };
    let [difference, size] = a.into_iter().zip(b).fold([0.0; 2], larger);
    difference / size
}
