//! Rasters: exact areas, rows that sum to one, conservation, order of accuracy.

use crate::surfaces::{self, area_m2};
use eit_mesh::{CsrMatrix, MeshError, Raster, Surface};
use ndarray::{Array2, array};
use proptest::prelude::*;

/// The surface rotated, so that no edge follows the grid.
fn turned(surface: &Surface, angle: f64) -> Surface {
    let (s, c) = angle.sin_cos();
    surfaces::moved(surface, |[x, y, z]| [c * x - s * y, s * x + c * y, z])
}

/// A rectangle whose inner nodes are displaced smoothly, giving triangles of all shapes.
fn warped(cells: u32) -> Surface {
    surfaces::moved(&surfaces::rectangle(cells, cells, 1.0, 1.0), |[x, y, z]| {
        let push = 0.08 * (std::f64::consts::PI * x).sin() * (std::f64::consts::PI * y).sin();
        [x + push * (7.0 * y).cos(), y + push * (5.0 * x).sin(), z]
    })
}

fn apply(matrix: &CsrMatrix, x: &[f64]) -> Vec<f64> {
    let mut y = vec![f64::NAN; matrix.rows()];
    matrix.apply(x, &mut y).unwrap();
    y
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn samples(surface: &Surface, f: impl Fn([f64; 2]) -> f64) -> Vec<f64> {
    surface.centroids().iter().map(|&[x, y, _]| f([x, y])).collect()
}

#[test]
fn two_triangles_by_hand() {
    // a square cut from the lower left to the upper right: pixels [0, 0] and [1, 1] lie in one triangle
    let raster = Raster::new(&surfaces::rectangle(1, 1, 1.0, 1.0), 2).unwrap();
    assert_eq!(raster.pixel_m(), 0.5);
    assert_eq!(raster.extent_m(), [0.0, 1.0, 0.0, 1.0]);
    assert_eq!(raster.coverage(), array![[1.0, 1.0], [1.0, 1.0]]);
    assert_eq!(raster.masked_pixels(), [[0, 0], [0, 1], [1, 0], [1, 1]]);
    assert_eq!(raster.centre_m(0, 1), [0.75, 0.75]);
    let places = [[0.75, 0.8], [1.0, 0.0], [1.1, 0.0], [f64::NAN, 0.0]];
    let pixels = [Some([0, 1]), Some([1, 1]), None, None];
    assert_eq!(places.map(|place| raster.pixel_at(place)), pixels);
    let down = raster.pixel_from_element();
    assert_eq!((down.rows(), down.columns()), (4, 2));
    assert_eq!(down.row_starts(), [0, 1, 3, 5, 6]);
    assert_eq!(down.column_indices(), [1, 0, 1, 0, 1, 0]);
    assert_eq!(down.values(), [1.0, 0.5, 0.5, 0.5, 0.5, 1.0]);
    assert_eq!([4, usize::MAX].map(|row| down.row(row)), [(&[][..], &[][..]); 2]);
    let up = raster.element_from_pixel();
    assert_eq!((up.rows(), up.columns()), (2, 4));
    assert_eq!(up.row(0), (&[1, 2, 3][..], &[0.25, 0.25, 0.5][..]));
    assert_eq!(up.row(1), (&[0, 1, 2][..], &[0.5, 0.25, 0.25][..]));
    assert_eq!(raster.covered_areas_m2(), [0.25; 4]);
    assert_eq!(raster.masked_areas_m2(), [0.5; 2]);
    assert_eq!(raster.image_from_elements(&[3.0, 5.0]).unwrap(), array![[5.0, 4.0], [4.0, 3.0]]);
}

#[test]
fn the_grid_is_centred_and_row_0_is_at_the_top() {
    // 0.2 m x 0.1 m on 4 x 4 pixels: rows 1 and 2 are covered, rows 0 and 3 are not
    let surface =
        surfaces::moved(&surfaces::rectangle(4, 2, 0.2, 0.1), |[x, y, z]| [x + 3.0, y - 2.0, z]);
    let raster = Raster::new(&surface, 4).unwrap();
    let wanted = [3.0, 3.2, -2.05, -1.85];
    for (found, wanted) in raster.extent_m().iter().zip(wanted) {
        // coordinates near 3 have a rounding of 4e-16
        assert!((found - wanted).abs() < 2e-15, "{:?}", raster.extent_m());
    }
    for ((row, _), &masked) in raster.mask().indexed_iter() {
        assert_eq!(masked, row == 1 || row == 2);
    }
    let image = raster.image_from_elements(&samples(&surface, |[_, y]| y)).unwrap();
    assert!(image[[1, 0]] > image[[2, 0]] && image[[0, 0]].is_nan());
}

/// Overlaps add up to the skin, rows are sorted and sum to one, and the masked integral is kept.
fn assert_areas_and_rows(surface: &Surface, raster: &Raster, field: impl Fn([f64; 2]) -> f64) {
    let total = raster.coverage().sum() * raster.pixel_m() * raster.pixel_m();
    // some thousand pieces with rounding 1e-16 of a pixel each, corners known to 64 ulp
    assert!((total / area_m2(surface) - 1.0).abs() < 1e-12, "{total}");
    for (&c, &masked) in raster.coverage().iter().zip(raster.mask()) {
        assert!((0.0..=1.0 + 1e-12).contains(&c));
        assert_eq!(masked, c >= 0.5 - 1e-9);
    }
    for matrix in [raster.pixel_from_element(), raster.element_from_pixel()] {
        for row in 0..matrix.rows() {
            let (columns, weights) = matrix.row(row);
            assert!(columns.is_sorted_by(|a, b| a < b));
            assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
            let sum: f64 = weights.iter().sum();
            // half an ulp for each addition of a running sum, and one for the weights
            let rounding = (weights.len() as f64 + 2.0) * 0.5 * f64::EPSILON;
            assert!((sum - 1.0).abs() <= rounding, "{sum}");
        }
    }
    let elements = samples(surface, field);
    let image = apply(raster.pixel_from_element(), &elements);
    let below = dot(raster.masked_areas_m2(), &elements);
    assert!((dot(raster.covered_areas_m2(), &image) / below - 1.0).abs() < 1e-12);
}

#[test]
fn overlaps_add_up_to_the_skin() {
    for (surface, pixels) in [
        (surfaces::disc(20, 0.1), 64),
        (turned(&surfaces::disc(3, 1e-6), 0.3), 64),
        (turned(&surfaces::rectangle(7, 5, 2.0, 1.0), 0.5), 33),
        (warped(40), 17),
        (surfaces::disc(2, 1e4), 1),
        (surfaces::disc(2, 1.0), 257),
    ] {
        let raster = Raster::new(&surface, pixels).unwrap();
        assert_areas_and_rows(&surface, &raster, |[x, y]| 2.0 + x.sin() * y.cos());
    }
}

#[test]
fn half_covered_pixels_are_masked() {
    // a right triangle on 4 x 4 pixels: its long side halves the four pixels of the diagonal
    let surface =
        Surface::new(vec![[0.0; 3], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0]], vec![[0, 1, 2]]).unwrap();
    for ((row, column), &masked) in Raster::new(&surface, 4).unwrap().mask().indexed_iter() {
        assert_eq!(masked, column <= row, "{row} {column}");
    }
}

#[test]
fn constants_stay_constant() {
    for (surface, pixels) in [(surfaces::disc(40, 0.1), 64), (warped(9), 100), (warped(100), 8)] {
        let raster = Raster::new(&surface, pixels).unwrap();
        for matrix in [raster.pixel_from_element(), raster.element_from_pixel()] {
            for value in [1.0, -1.0 / 3.0, 1.7e-5] {
                let found = apply(matrix, &vec![value; matrix.columns()]);
                let worst = found.iter().map(|v| (v / value - 1.0).abs()).fold(0.0, f64::max);
                // four running sums of up to 90 products: a few ulp
                assert!(worst <= 1e-15, "{pixels}: {worst:e}");
            }
        }
    }
}

#[test]
fn the_masked_integral_is_kept() {
    let surface = turned(&surfaces::disc(17, 0.1), 0.2);
    let raster = Raster::new(&surface, 40).unwrap();
    let elements = samples(&surface, |[x, y]| 1.0 + (30.0 * x).sin() * (20.0 * y).cos());
    let pixels = apply(raster.pixel_from_element(), &elements);
    let down = dot(raster.covered_areas_m2(), &pixels);
    // sums of 1700 positive terms
    assert!((down / dot(raster.masked_areas_m2(), &elements) - 1.0).abs() < 1e-13);
    let back = apply(raster.element_from_pixel(), &pixels);
    assert!((dot(raster.masked_areas_m2(), &back) / down - 1.0).abs() < 1e-13);
    // both operators are the same areas, divided by rows or columns: c P = (a E)'
    for row in 0..pixels.len() {
        let (triangles, weights) = raster.pixel_from_element().row(row);
        for (&t, w) in triangles.iter().zip(weights) {
            let (columns, up) = raster.element_from_pixel().row(t as usize);
            let place = columns.iter().position(|&c| c as usize == row).unwrap();
            let of_pixel = raster.covered_areas_m2()[row] * w;
            let of_triangle = raster.masked_areas_m2()[t as usize] * up[place];
            assert!((of_pixel - of_triangle).abs() <= 1e-14 * raster.pixel_m().powi(2));
        }
    }
    // all pixels of a rectangle that fills the grid are masked: the whole integral is kept
    let surface = warped(13);
    let raster = Raster::new(&surface, 10).unwrap();
    let elements = samples(&surface, |[x, y]| 2.0 + x * y);
    let pixels = apply(raster.pixel_from_element(), &elements);
    let whole = dot(surface.areas_m2(), &elements);
    assert!((dot(raster.covered_areas_m2(), &pixels) / whole - 1.0).abs() < 1e-13);
}

/// Largest error of a linear function in fully covered pixels, or in triangles.
fn linear_errors(cells: u32, pixels: usize) -> (f64, f64) {
    let f = |[x, y]: [f64; 2]| 2.0 * x - 3.0 * y;
    let surface = warped(cells);
    let raster = Raster::new(&surface, pixels).unwrap();
    let elements = samples(&surface, f);
    let centres: Vec<f64> =
        raster.masked_pixels().iter().map(|&[r, c]| f(raster.centre_m(r, c))).collect();
    let largest = |found: &[f64], wanted: &[f64]| {
        found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let down = largest(&apply(raster.pixel_from_element(), &elements), &centres);
    let up = largest(&apply(raster.element_from_pixel(), &centres), &elements);
    (down, up)
}

#[test]
fn linear_functions_converge_at_the_stated_order() {
    let gradient = 13.0_f64.sqrt();
    // longest edge of the warped grid: the diagonal, stretched by the push's slope (below 1.6)
    let longest = |cells: u32| 1.6 * std::f64::consts::SQRT_2 / f64::from(cells);
    // coarse triangles, or pixels: error below |gradient| h
    for (cells, pixels) in [(4, 8), (8, 16), (16, 32)] {
        let (down, up) = (linear_errors(cells, 64).0, linear_errors(64, pixels).1);
        assert!(down <= gradient * longest(cells), "{cells}: {down}");
        assert!(up <= gradient * std::f64::consts::SQRT_2 / pixels as f64, "{pixels}: {up}");
    }
    // triangles far smaller than pixels, or the opposite: second order in h
    let down = [40, 80, 160].map(|cells| linear_errors(cells, 8).0);
    let up = [64, 128, 256].map(|pixels| linear_errors(8, pixels).1);
    for errors in [down, up] {
        let orders: Vec<f64> = errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
        // cut triangles differ between meshes, so the order scatters around 2 or above
        assert!(orders.iter().all(|o| *o > 1.7), "{errors:?} {orders:?}");
    }
}

#[test]
fn triangles_outside_the_mask_take_the_nearest_pixel() {
    // a square with a thin tongue on the right, which covers a quarter of its pixels
    let nodes = vec![
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 0.25, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [4.0, 0.0, 0.0],
        [4.0, 0.25, 0.0],
    ];
    let triangles = vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [1, 5, 6], [1, 6, 2]];
    let surface = Surface::new(nodes, triangles).unwrap();
    let raster = Raster::new(&surface, 4).unwrap();
    // rows of 1 m, the skin's box centred: y from -1.5 to 2.5, so the square straddles rows
    assert_eq!(raster.pixel_m(), 1.0);
    let masked = raster.masked_pixels().to_vec();
    let up = raster.element_from_pixel();
    for t in 3..5 {
        let [x, y, _] = surface.centroids()[t];
        let distance = |&[r, c]: &[usize; 2]| {
            let [px, py] = raster.centre_m(r, c);
            (px - x).hypot(py - y)
        };
        let nearest = masked.iter().map(distance).fold(f64::INFINITY, f64::min);
        let (columns, weights) = up.row(t);
        assert_eq!(weights, [1.0]);
        assert_eq!(distance(&masked[columns[0] as usize]), nearest);
        assert_eq!(raster.masked_areas_m2()[t], 0.0);
    }
}

#[test]
fn images_and_batches() {
    let raster = Raster::new(&surfaces::disc(5, 0.1), 9).unwrap();
    let count = raster.masked_pixels().len();
    assert!(count < 81);
    let frames = Array2::from_shape_fn((3, count), |(f, p)| (100 * f + p) as f64);
    let images = raster.images_from_pixels(frames.view()).unwrap();
    assert_eq!(images.dim(), (3, 9, 9));
    for (frame, image) in frames.rows().into_iter().zip(images.outer_iter()) {
        let values = frame.to_vec();
        let single = raster.image_from_pixels(&values).unwrap();
        for ((place, found), masked) in image.indexed_iter().zip(raster.mask()) {
            assert_eq!(found.is_nan(), !masked);
            assert!(found.is_nan() || *found == single[place]);
        }
        let mut back = vec![0.0; count];
        raster.pixels_from_image_into(image, &mut back).unwrap();
        assert_eq!(back, values);
    }
}

#[test]
fn wrong_lengths_are_refused() {
    let raster = Raster::new(&surfaces::disc(3, 0.1), 8).unwrap();
    let masked = raster.masked_pixels().len();
    let matrix = raster.pixel_from_element();
    let mut pixels = vec![0.0; masked];
    let zeros = |rows, columns| Array2::<f64>::zeros((rows, columns));
    let calls = [
        matrix.apply(&[0.0; 53], &mut pixels),
        matrix.apply(&[0.0; 54], &mut pixels[1..]),
        matrix.multiply_dense(zeros(53, 2).view()).map(drop),
        matrix.premultiply_dense(zeros(2, masked + 1).view()).map(drop),
        raster.image_from_pixels(&pixels[1..]).map(drop),
        raster.image_from_pixels_into(&pixels, zeros(8, 9).view_mut()),
        raster.image_from_pixels_into(&pixels, zeros(9, 8).view_mut()),
        raster.images_from_pixels(zeros(2, masked + 1).view()).map(drop),
        raster.pixels_from_image_into(zeros(8, 9).view(), &mut pixels),
        raster.image_from_elements(&[0.0; 3]).map(drop),
    ];
    for (call, refused) in calls.into_iter().enumerate() {
        assert!(matches!(refused, Err(MeshError::WrongLength { .. })), "{call}: {refused:?}");
    }
}

#[test]
fn products_agree() {
    let raster = Raster::new(&warped(6), 7).unwrap();
    let matrix = raster.element_from_pixel();
    let dense = Array2::from_shape_fn((matrix.columns(), 3), |(i, j)| ((7 * i + j) as f64).sin());
    let product = matrix.multiply_dense(dense.view()).unwrap();
    for (column, result) in dense.columns().into_iter().zip(product.columns()) {
        for (a, b) in apply(matrix, &column.to_vec()).iter().zip(result) {
            assert!((a - b).abs() < 1e-15, "sums of a few products below 1");
        }
    }
    // B A = (A' B')', row by row, from a transposed (column-major) view too
    let dense = Array2::from_shape_fn((matrix.rows(), 4), |(i, j)| ((3 * i + j) as f64).cos());
    let product = matrix.premultiply_dense(dense.t()).unwrap();
    assert_eq!(product.dim(), (4, matrix.columns()));
    assert_eq!(product, matrix.premultiply_dense(dense.t().to_owned().view()).unwrap());
    // <A x, y> = <x, A' y>
    for (y, transposed) in dense.columns().into_iter().zip(product.rows()) {
        let x: Vec<f64> = (0..matrix.columns()).map(|i| (i as f64).cos()).collect();
        let (of_x, of_y) = (dot(&apply(matrix, &x), &y.to_vec()), dot(&x, &transposed.to_vec()));
        // sums of about 70 terms below 1
        assert!((of_x - of_y).abs() < 1e-13);
    }
}

#[test]
fn surfaces_without_a_picture_are_refused() {
    let flat = surfaces::rectangle(8, 8, 1.0, 1.0);
    // edge-on
    let upright = surfaces::moved(&flat, |[x, y, _]| [x, 0.0, y]);
    assert_error!(Raster::new(&upright, 16), MeshError::UprightSurface { .. });
    // folded at x = 0.5 like a tent lying on its side
    let folded = surfaces::moved(&flat, |[x, y, _]| [0.7 * x.min(1.05 - x), y, x]);
    assert_error!(Raster::new(&folded, 16), MeshError::FoldedSurface { .. });
    // a ramp of one and a half turns faces up everywhere, but covers half of the ring twice
    let ramp = surfaces::moved(&surfaces::rectangle(60, 4, 1.0, 1.0), |[x, y, _]| {
        let angle = 3.0 * std::f64::consts::PI * x;
        [(2.0 - y) * angle.sin(), (2.0 - y) * angle.cos(), -x]
    });
    assert_error!(Raster::new(&ramp, 16), MeshError::OverlappingSheets { .. });
    for pixels in [0, 4097, usize::MAX] {
        assert_error!(Raster::new(&flat, pixels), MeshError::OutOfRange { .. });
    }
    // a strip of 1 m x 1 mm: one pixel of 1/16 m holds 1 mm, cut by no row or by the middle one in two
    assert_error!(
        Raster::new(&surfaces::rectangle(4, 1, 1.0, 1e-3), 16),
        MeshError::NoMaskedPixel { pixels: 16, largest } if (largest - 0.008).abs() < 1e-12
    );
}

#[test]
fn curved_surfaces_are_seen_from_above() {
    // a dome: projected areas count, and vertical walls take their nearest pixel
    let flat = surfaces::disc(12, 0.1);
    let dome = surfaces::moved(&flat, |[x, y, _]| [x, y, (0.0121 - x * x - y * y).sqrt()]);
    let (one, other) = (Raster::new(&flat, 32).unwrap(), Raster::new(&dome, 32).unwrap());
    assert!(area_m2(&dome) > 1.2 * area_m2(&flat));
    assert_eq!(one, other);
    let nodes = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.5, -1.0]];
    let step = Surface::new(nodes, vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]]).unwrap();
    let raster = Raster::new(&step, 4).unwrap();
    assert_eq!(raster.masked_areas_m2()[2], 0.0);
    let (pixel, weight) = raster.element_from_pixel().row(2);
    // the wall's centroid [1, 0.5] is as near to rows 1 and 2 of the last column: the first wins
    assert_eq!((pixel, weight), (&[7][..], &[1.0][..]));
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    #[test]
    fn areas_and_rows_of_any_raster(
        cells in 1_u32..12,
        pixels in 1_usize..40,
        angle in -7.0_f64..7.0,
        exponent in -60_i32..60,
        stretch in 0.6_f64..1.0,
    ) {
        let scale = 10.0_f64.powi(exponent);
        let surface = surfaces::moved(&turned(&warped(cells), angle), |[x, y, z]| {
            [scale * x, scale * stretch * y, scale * z]
        });
        let raster = match Raster::new(&surface, pixels) {
            Ok(raster) => raster,
            Err(MeshError::NoMaskedPixel { largest, .. }) => {
                prop_assert!(largest < 0.5);
                return Ok(());
            }
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        };
        assert_areas_and_rows(&surface, &raster, |[x, y]| {
            1.0 + (x / scale).sin() * (y / scale).cos()
        });
    }
}
