//! Computes the two operators of a raster from the areas shared by triangles and pixels.

use super::overlap::{Grid, Overlaps};
use crate::{CsrMatrix, Surface};
use ndarray::Array2;

/// Index of each pixel among the masked ones, in row-major order; `None` outside the mask.
pub(super) fn masked_numbers(mask: &Array2<bool>) -> Vec<Option<u32>> {
    let mut next = 0;
    mask.iter()
        .map(|&masked| {
            masked.then(|| {
                next += 1;
                next - 1
            })
        })
        .collect()
}

/// Area of triangle `t` under the mask, in pixel areas.
pub(super) fn masked_area(overlaps: &Overlaps, t: usize, numbers: &[Option<u32>]) -> f64 {
    overlaps.of(t).filter(|(pixel, _)| numbers[*pixel as usize].is_some()).map(|o| o.1).sum()
}

/// Returns the overlaps sorted by pixel (a counting sort keeps triangles ascending), each row
/// divided by its sum.
pub(super) fn pixel_from_element(
    overlaps: &Overlaps,
    numbers: &[Option<u32>],
    masked: usize,
) -> CsrMatrix {
    let mut row_starts = vec![0; masked + 1];
    let triangles = overlaps.triangles();
    let entries = || {
        (0..triangles).flat_map(|t| {
            overlaps
                .of(t)
                .filter_map(move |(p, area)| Some((numbers[p as usize]? as usize, t as u32, area)))
        })
    };
    entries().for_each(|(row, _, _)| row_starts[row + 1] += 1);
    for row in 0..masked {
        row_starts[row + 1] += row_starts[row];
    }
    let mut next = row_starts.clone();
    let mut columns = vec![0; row_starts[masked]];
    let mut values = vec![0.0; row_starts[masked]];
    for (row, t, area) in entries() {
        columns[next[row]] = t;
        values[next[row]] = area;
        next[row] += 1;
    }
    for row in row_starts.windows(2) {
        divide_by_sum(&mut values[row[0]..row[1]]);
    }
    CsrMatrix::from_parts(triangles, row_starts, columns, values)
}

/// Returns the overlaps with masked pixels, triangle by triangle, each row divided by its sum.
pub(super) fn element_from_pixel(
    surface: &Surface,
    grid: &Grid,
    overlaps: &Overlaps,
    numbers: &[Option<u32>],
    mask: &Array2<bool>,
) -> CsrMatrix {
    let masked = numbers.iter().flatten().count();
    let mut row_starts = vec![0];
    let (mut columns, mut values) = (Vec::new(), Vec::new());
    for t in 0..overlaps.triangles() {
        let start = columns.len();
        for (pixel, area) in overlaps.of(t) {
            if let Some(number) = numbers[pixel as usize] {
                columns.push(number);
                values.push(area);
            }
        }
        if columns.len() == start {
            let [row, column] = nearest_masked(grid.centroid(surface, t), mask);
            // a masked pixel always has an index
            columns.push(numbers[row * mask.ncols() + column].unwrap_or(0));
            values.push(1.0);
        }
        divide_by_sum(&mut values[start..]);
        row_starts.push(columns.len());
    }
    CsrMatrix::from_parts(masked, row_starts, columns, values)
}

/// Scales positive weights so that they sum to one. The sum is compensated (Kahan 1965) and each
/// quotient is correct to half an ulp, so their exact sum is one to within an ulp, however many
/// there are.
fn divide_by_sum(weights: &mut [f64]) {
    let (mut sum, mut lost) = (0.0, 0.0);
    for &weight in weights.iter() {
        let term: f64 = weight - lost;
        let next = sum + term;
        lost = (next - sum) - term;
        sum = next;
    }
    weights.iter_mut().for_each(|w| *w /= sum);
}

/// Returns the masked pixel whose centre is nearest to a point in pixel units `[column, row]`.
///
/// Searches square rings around the point's own pixel. Ring `r` is at least `r - 0.5` away, so the
/// search ends once that exceeds the best distance.
fn nearest_masked(point: [f64; 2], mask: &Array2<bool>) -> [usize; 2] {
    let side = mask.nrows();
    let [column, row] = point.map(|x| (x.max(0.0) as usize).min(side - 1));
    let mut best = (f64::INFINITY, [0, 0]);
    for ring in 0..side as isize {
        if ring as f64 - 0.5 > best.0 {
            break;
        }
        for down in -ring..=ring {
            let step = if down.abs() == ring { 1 } else { 2 * ring as usize };
            for right in (-ring..=ring).step_by(step) {
                let place = (row.checked_add_signed(down), column.checked_add_signed(right));
                let (Some(r), Some(c)) = place else { continue };
                let distance = (c as f64 + 0.5 - point[0]).hypot(r as f64 + 0.5 - point[1]);
                // of equal distances, the first in row-major order wins
                if mask.get([r, c]) == Some(&true) && (distance, [r, c]) < best {
                    best = (distance, [r, c]);
                }
            }
        }
    }
    best.1
}
