//! Symmetries of a square raster: rotations and reflections that map pixels to pixels.

use ndarray::ArrayView2;

/// One of the eight symmetries of a square raster, for data augmentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RasterSymmetry {
    /// Whether the new x axis is the old y axis.
    swapped: bool,
    /// Whether the old x axis is reversed.
    flip_x: bool,
    /// Whether the old y axis is reversed.
    flip_y: bool,
}

impl RasterSymmetry {
    /// Converts a linear map of places (x to the right, y up, rows of a 2 x 2 matrix, as from
    /// [`crate::DiscSymmetry::matrix`]). Returns `None` if it does not map pixels to pixels, that is, if
    /// its entries are not 0, 1 or -1 to rounding.
    pub fn of_matrix(matrix: [[f64; 2]; 2]) -> Option<Self> {
        // tolerance for a few roundings; other rotations are off by much more
        let whole = |v: f64| (v - v.round()).abs() < 1e-9;
        if !matrix.as_flattened().iter().all(|v| whole(*v) && v.abs() < 1.5) {
            return None;
        }
        let [[a, b], [c, d]] = matrix.map(|row| row.map(|v| v.round() as i8));
        match [a.abs(), b.abs(), c.abs(), d.abs()] {
            [1, 0, 0, 1] => Some(Self { swapped: false, flip_x: a < 0, flip_y: d < 0 }),
            // new x = b old y, new y = c old x
            [0, 1, 1, 0] => Some(Self { swapped: true, flip_x: c < 0, flip_y: b < 0 }),
            _ => None,
        }
    }

    /// Returns the old pixel [row, column] that is mapped to a new one, on a raster of [rows, columns].
    fn old(self, [row, column]: [usize; 2], [rows, columns]: [usize; 2]) -> [usize; 2] {
        // y points up, rows count down: swapping axes swaps the row counted from below with the column
        let (up, right) = (rows - 1 - row, column);
        let (up, right) = if self.swapped { (right, up) } else { (up, right) };
        let up = if self.flip_y { rows - 1 - up } else { up };
        let right = if self.flip_x { columns - 1 - right } else { right };
        [rows - 1 - up, right]
    }

    /// Number of pixels in which a mask and its mapped image differ; all of them for a rotation by 90
    /// degrees on a raster that is not square.
    pub(crate) fn differing(self, mask: ArrayView2<'_, bool>) -> usize {
        let (rows, columns) = mask.dim();
        if self.swapped && rows != columns {
            return mask.len();
        }
        let turned = |(r, c)| mask[self.old([r, c], [rows, columns])];
        mask.indexed_iter().filter(|(place, inside)| turned(*place) != **inside).count()
    }

    /// Appends the mapped image in row-major order.
    #[cfg(any(feature = "train", test))]
    pub(crate) fn append(self, image: &[f32], size: [usize; 2], out: &mut Vec<f32>) {
        for row in 0..size[0] {
            for column in 0..size[1] {
                let [r, c] = self.old([row, column], size);
                out.push(image[r * size[1] + c]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;
    use ndarray::Array2;

    /// Each pixel maps to the pixel that contains the image of its centre, for the group of the
    /// square; products of half-pixels are exact.
    #[test]
    fn pixels_go_where_the_matrix_takes_them() {
        let n = 6_usize;
        let image: Vec<f32> = (0..n * n).map(|k| k as f32).collect();
        let centre = |r: usize, c: usize| {
            [(2 * c + 1) as f64 - n as f64, n as f64 - (2 * r + 1) as f64].map(|v| 0.5 * v)
        };
        for (a, d) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            for matrix in [[[a, 0.0], [0.0, d]], [[0.0, a], [d, 0.0]]] {
                let turn = RasterSymmetry::of_matrix(matrix).unwrap();
                let mut made = Vec::new();
                turn.append(&image, [n, n], &mut made);
                for r in 0..n {
                    for c in 0..n {
                        let old = centre(r, c);
                        let [x, y] = matrix.map(|row| row[0] * old[0] + row[1] * old[1]);
                        let column = (x + 0.5 * n as f64 - 0.5) as usize;
                        let row = (0.5 * n as f64 - 0.5 - y) as usize;
                        assert_eq!(made[row * n + column], image[r * n + c], "{matrix:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_turn_between_pixels_and_a_mask_without_the_symmetry_are_seen() {
        let (sin, cos) = (std::f64::consts::PI / 8.0).sin_cos();
        assert_eq!(RasterSymmetry::of_matrix([[cos, -sin], [sin, cos]]), None);
        assert_eq!(RasterSymmetry::of_matrix([[1.0, 0.0], [1.0, 0.0]]), None);
        let quarter = RasterSymmetry::of_matrix([[0.0, -1.0], [1.0, 0.0]]).unwrap();
        let mut mask = Array2::from_elem((4, 4), true);
        assert_eq!(quarter.differing(mask.view()), 0);
        mask[[0, 0]] = false;
        assert_eq!(quarter.differing(mask.view()), 2);
        assert_eq!(quarter.differing(Array2::from_elem((4, 5), true).view()), 20);
    }
}
