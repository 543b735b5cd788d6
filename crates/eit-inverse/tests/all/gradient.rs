//! Total variation of images with a known gradient, and the operator compared with other forms.

use crate::common::{disc, grid, solve};
use eit_core::vector::{along, cross, dot, scaled, sub};
use eit_inverse::Gradient;
use eit_mesh::Surface;
use fixtures::Random;
use ndarray::Array2;
use proptest::prelude::*;
use std::f64::consts::TAU;

/// Rounding error of sums of up to a few thousand terms of one sign.
const ROUNDING: f64 = 1e-12;

fn assert_close(found: f64, wanted: f64, what: &str) {
    let error = (found - wanted).abs();
    assert!(error <= ROUNDING * wanted.abs().max(1e-300), "{what}: {found:e}, not {wanted:e}");
}

/// The same triangles with every node moved.
fn moved(surface: &Surface, place: impl Fn([f64; 3]) -> [f64; 3]) -> Surface {
    let nodes = surface.nodes().iter().map(|&x| place(x)).collect();
    Surface::new(nodes, surface.triangles().to_vec()).unwrap()
}

/// A rotation about the axis (1, 1, 1) by 40 degrees, and a shift.
fn rotated(x: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = 40_f64.to_radians().sin_cos();
    let axis = [1.0 / 3.0_f64.sqrt(); 3];
    let turned = along(scaled(cos, x), sin, cross(axis, x));
    along(along(turned, (1.0 - cos) * dot(axis, x), axis), 1.0, [0.3, -2.0, 0.7])
}

fn total_area(surface: &Surface) -> f64 {
    surface.areas_m2().iter().sum()
}

/// `D' diag(weight of each group) D`.
fn normal_matrix(gradient: &Gradient, weight: impl Fn(usize) -> f64) -> Array2<f64> {
    let mut matrix = Array2::zeros((gradient.unknowns(), gradient.unknowns()));
    for row in 0..gradient.rows() {
        let (columns, values) = gradient.row(row);
        for (&p, a) in columns.iter().zip(values) {
            for (&q, b) in columns.iter().zip(values) {
                matrix[(p as usize, q as usize)] += weight(row / gradient.components()) * a * b;
            }
        }
    }
    matrix
}

#[test]
fn a_bent_or_moved_strip_has_the_variation_of_the_flat_one() {
    let n = 9;
    let (radius_m, height_m, angle) = (0.05, 0.12, TAU / 30.0);
    let chord_m = 2.0 * radius_m * (0.5 * angle).sin();
    let flat = grid(n, |i, j| [chord_m * i as f64, height_m * j as f64 / n as f64, 0.0]);
    // columns of nodes on a cylinder: each strip stays plane, so lengths and areas are unchanged
    let bent = grid(n, |i, j| {
        let (sin, cos) = (angle * i as f64).sin_cos();
        [radius_m * cos, height_m * j as f64 / n as f64, radius_m * sin]
    });
    let linear: Vec<f64> = flat.nodes().iter().map(|x| 6.0 * x[0] + 8.0 * x[1] + 7.0).collect();
    let mut random = Random::new(5);
    let [rough, steps] = [flat.nodes().len(), flat.triangles().len()]
        .map(|count| random.noisy(&vec![0.0; count], 1.0));
    let values = |surface: &Surface| {
        let nodal = || Gradient::nodal(surface);
        let of = [(nodal(), &linear), (nodal(), &rough), (Gradient::elements(surface), &steps)];
        of.map(|(gradient, image)| gradient.unwrap().total_variation(image).unwrap())
    };
    let wanted = values(&flat);
    assert_close(wanted[0], 10.0 * total_area(&flat), "the slope times the area");
    for (found, wanted) in values(&bent).into_iter().zip(wanted) {
        assert_close(found, wanted, "bent");
    }
    for (found, wanted) in values(&moved(&bent, rotated)).into_iter().zip(wanted) {
        // nodes rotated and shifted by 2 m lose three digits of triangles of 0.02 m
        assert!((found / wanted - 1.0).abs() < 1e-11, "{found:e}, not {wanted:e}");
    }
}

#[test]
fn jumps_of_a_half_plane_are_its_border() {
    let n = 8;
    let height_m = 0.4;
    let surface = grid(n, |i, j| [0.1 * i as f64, height_m * j as f64 / n as f64, 0.0]);
    for surface in [moved(&surface, |x| x), moved(&surface, rotated)] {
        let gradient = Gradient::elements(&surface).unwrap();
        // triangles 2 i and 2 i + 1 of a row are those of its cell i
        let cell = |t: usize| ((t / 2) % n, t / 2 / n);
        let close = |inside: &dyn Fn(usize) -> bool, wanted: f64| {
            let value = |t: usize| if inside(t) { 2.5 } else { 0.0 };
            let image: Vec<f64> = (0..surface.triangles().len()).map(value).collect();
            let found = gradient.total_variation(&image).unwrap() / 2.5;
            // nodes rotated and shifted by 2 m lose two digits of cells of 0.05 m
            assert!((found / wanted - 1.0).abs() < 1e-11, "{found:e}, not {wanted:e}");
        };
        close(&|t| cell(t).0 < 3, height_m);
        close(&|t| cell(t).1 >= 5, 0.1 * n as f64);
        // below the diagonal of cell (2, 2) alone: two sides and the diagonal
        let (width, height) = (0.1, height_m / n as f64);
        close(&|t| t == 2 * (2 * n + 2), width + height + f64::hypot(width, height));
    }
}

#[test]
fn nodal_gradients_make_the_stiffness_matrix() {
    // sum_g |D_g x|^2 / area_g = integral |grad x|^2, whose matrix has -cot / 2 of the opposite
    // angles between two nodes (Pinkall, Polthier, Exp. Math. 2 (1993) 15)
    let bumpy = grid(4, |i, j| {
        let (x, y) = (i as f64, 1.3 * j as f64);
        [x + 0.2 * (y * 1.7).sin(), y, 0.3 * (x * y).cos()]
    });
    for surface in [bumpy, disc(1.0, 3)] {
        let gradient = Gradient::nodal(&surface).unwrap();
        assert_eq!((gradient.groups(), gradient.components()), (surface.triangles().len(), 2));
        let found = normal_matrix(&gradient, |g| 1.0 / surface.areas_m2()[g]);
        let mut wanted = Array2::<f64>::zeros(found.dim());
        for (t, nodes) in surface.triangles().iter().enumerate() {
            let corners = surface.corners(t);
            for k in 0..3 {
                let side = |to: usize| sub(corners[(k + to) % 3], corners[k]);
                let half_cotangent = 0.25 * dot(side(1), side(2)) / surface.areas_m2()[t];
                let (p, q) = (nodes[(k + 1) % 3] as usize, nodes[(k + 2) % 3] as usize);
                for (row, column, sign) in [(p, q, -1.0), (q, p, -1.0), (p, p, 1.0), (q, q, 1.0)] {
                    wanted[(row, column)] += sign * half_cotangent;
                }
            }
        }
        // entries of order 1
        assert!(found.iter().zip(&wanted).all(|(f, w)| (f - w).abs() < 1e-13));
    }
}

#[test]
fn one_unknown_has_no_variation_and_areas_are_those_of_the_skin() {
    let corners = vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
    let triangle = Surface::new(corners, vec![[0, 1, 2]]).unwrap();
    let pixel = Gradient::pixels(&Array2::from_elem((1, 1), true), 0.5).unwrap();
    for (one, area) in [(pixel, 0.25), (Gradient::elements(&triangle).unwrap(), 3.0)] {
        assert_eq!((one.unknowns(), one.rows(), one.groups()), (1, 0, 0));
        assert_eq!(one.areas_m2(), [area]);
        assert_eq!(one.total_variation(&[7.0]).unwrap(), 0.0);
    }
    // one triangle of nodes: |grad x| = |(1/2, 1/3)| for the values 0, 1, 1
    let nodal = Gradient::nodal(&triangle).unwrap();
    assert_close(nodal.total_variation(&[0.0, 1.0, 1.0]).unwrap(), 13.0_f64.sqrt() / 6.0 * 3.0, "");

    let surface = disc(0.1, 5);
    let mask = Array2::from_shape_fn((5, 6), |(i, j)| (i + j) % 3 != 0);
    let inside = mask.iter().filter(|m| **m).count() as f64;
    for (gradient, wanted) in [
        (Gradient::nodal(&surface), total_area(&surface)),
        (Gradient::elements(&surface), total_area(&surface)),
        (Gradient::pixels(&mask, 0.2), inside * 0.04),
    ] {
        assert_close(gradient.unwrap().areas_m2().iter().sum(), wanted, "area");
    }
}

#[test]
fn a_constant_is_all_that_has_no_variation_on_one_part() {
    // D' D + 1 1' is regular if only constant images have no differences
    let mask = Array2::from_shape_fn((5, 5), |at| at != (2, 2) && at != (0, 4));
    let surface = disc(1.0, 2);
    for gradient in [
        Gradient::pixels(&mask, 1.0).unwrap(),
        Gradient::nodal(&surface).unwrap(),
        Gradient::elements(&surface).unwrap(),
    ] {
        let matrix = normal_matrix(&gradient, |_| 1.0) + 1.0;
        let n = gradient.unknowns();
        let constant = solve(matrix, Array2::from_elem((n, 1), n as f64));
        // condition below 1e4 times rounding
        assert!(constant.iter().all(|x| (x - 1.0).abs() < 1e-11), "{constant}");
        assert!(gradient.total_variation(&vec![3.0; n]).unwrap() < 1e-14);
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let nothing = Gradient::pixels(&Array2::from_elem((3, 3), false), 1.0);
    refused!(nothing, WrongLength { found: 0, wanted: 1, .. });
    let mask = Array2::from_elem((2, 2), true);
    for pixel_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused!(Gradient::pixels(&mask, pixel_m), OutOfRange { quantity: "pixel_m", .. });
    }
    let short = Gradient::pixels(&mask, 1.0).unwrap().total_variation(&[0.0; 3]);
    refused!(short, WrongLength { found: 3, wanted: 4, .. });
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    /// Any mask and any image against the sum written out pixel by pixel.
    #[test]
    fn pixels_equal_the_sum_over_pixels(
        rows in 1_usize..7,
        columns in 1_usize..7,
        inside in 0.2..1.0_f64,
        pixel_m in 1e-3..10.0_f64,
        seed: u64,
    ) {
        let mut random = Random::new(seed);
        let mut mask = Array2::from_shape_simple_fn((rows, columns), || random.uniform() < inside);
        mask[(rows / 2, columns / 2)] = true;
        let image = Array2::from_shape_simple_fn((rows, columns), || random.normal());
        let gradient = Gradient::pixels(&mask, pixel_m).unwrap();
        let (mut wanted, mut pixels) = (0.0, Vec::new());
        for ((i, j), _) in mask.indexed_iter().filter(|(_, m)| **m) {
            let difference = |i2: usize, j2: usize| match mask.get((i2, j2)) {
                Some(true) => image[(i2, j2)] - image[(i, j)],
                _ => 0.0,
            };
            wanted += pixel_m * difference(i, j + 1).hypot(difference(i + 1, j));
            pixels.push(image[(i, j)]);
        }
        let found = gradient.total_variation(&pixels).unwrap();
        prop_assert!((found - wanted).abs() <= ROUNDING * wanted, "{} {}", found, wanted);
        // pixels of the mask are unknowns, all others are not
        prop_assert_eq!(gradient.unknowns(), pixels.len());
        for row in 0..gradient.rows() {
            let (columns, values) = gradient.row(row);
            prop_assert!(columns.iter().all(|&c| (c as usize) < gradient.unknowns()));
            prop_assert_eq!(values.iter().sum::<f64>(), 0.0);
        }
    }
}
