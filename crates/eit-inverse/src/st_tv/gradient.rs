//! Sparse spatial difference operator of the total variation.

use crate::InverseError;
use eit_core::vector::{dot, norm, sub};
use eit_mesh::Surface;
use ndarray::ArrayRef2;

/// Spatial difference operator whose rows form groups.
///
/// The total variation of an image `x` is `sum_g |D_g x|_2`, where a group `g` consists of one or two
/// rows of the operator `D`.
///
/// | basis | group | `D_g x` | unit of the sum |
/// |---|---|---|---|
/// | [`pixels`](Self::pixels) | pixel | differences to right and lower neighbour, times pixel edge | S m |
/// | [`nodal`](Self::nodal) | triangle | gradient in its plane times its area | S m |
/// | [`elements`](Self::elements) | inner edge | jump across the edge times its length | S m |
///
/// All three equal `integral |grad x| dA` of the represented image, exactly for nodal and element
/// images; the sum over pixels is the isotropic one-sided discretisation (rotation invariant up to
/// the pixel size). No difference crosses the outer boundary, a hole or the edge of the mask, and
/// there are no periodic boundaries.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradient {
    unknowns: usize,
    components: usize,
    /// Row `r` has the entries `row_starts[r]..row_starts[r + 1]`; rows of a group are consecutive.
    row_starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Area of each unknown.
    areas: Vec<f64>,
    /// Pixel grid; `None` on other bases.
    raster: Option<Raster>,
}

/// Pixel grid of a basis of pixels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Raster {
    /// Number of columns of the grid.
    pub(crate) width: usize,
    /// Row-major grid index of each unknown.
    pub(crate) cells: Vec<usize>,
    /// Edge of a pixel, metres.
    pub(crate) pixel_m: f64,
}

impl Gradient {
    /// Creates one-sided differences on the pixels inside `mask` `[row, column]`.
    ///
    /// The unknowns are the pixels inside the mask, in row-major order (as in
    /// [`eit_mesh::Raster::masked_pixels`]). `pixel_m` is the edge length of a pixel in metres; with 1
    /// the sums are plain differences of pixel values.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] for a mask without a pixel; [`InverseError::OutOfRange`] for an
    /// edge length that is not positive and finite.
    pub fn pixels(mask: &ArrayRef2<bool>, pixel_m: f64) -> Result<Self, InverseError> {
        crate::check::check_positive("pixel_m", pixel_m)?;
        let unknowns = mask.iter().filter(|inside| **inside).count();
        check_unknowns(unknowns)?;
        let mut index = ndarray::Array2::from_elem(mask.dim(), None);
        let inside = index.iter_mut().zip(mask.iter()).filter(|(_, inside)| **inside);
        inside.enumerate().for_each(|(next, (slot, _))| *slot = Some(next as u32));
        let mut this = Self::empty(unknowns, 2, vec![pixel_m * pixel_m; unknowns]);
        let inside = mask.iter().enumerate().filter(|(_, inside)| **inside);
        let cells = inside.map(|(cell, _)| cell).collect();
        this.raster = Some(Raster { width: mask.ncols(), cells, pixel_m });
        for ((i, j), &pixel) in index.indexed_iter() {
            let Some(pixel) = pixel else { continue };
            let neighbours = [index.get((i, j + 1)), index.get((i + 1, j))];
            let neighbours = neighbours.map(|n| n.copied().flatten());
            if neighbours == [None, None] {
                continue;
            }
            for neighbour in neighbours {
                match neighbour {
                    Some(n) => this.push_row(&[pixel, n], &[-pixel_m, pixel_m]),
                    None => this.push_row(&[], &[]),
                }
            }
        }
        Ok(this)
    }

    /// Creates gradients of an image that is linear on each triangle, with unknowns at the nodes.
    ///
    /// On a curved surface the gradient is taken in the plane of the triangle: it is isotropic and
    /// independent of the position of the surface in space.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] for a surface without a node.
    pub fn nodal(surface: &Surface) -> Result<Self, InverseError> {
        let unknowns = surface.nodes().len();
        check_unknowns(unknowns)?;
        let mut areas = vec![0.0; unknowns];
        let mut this = Self::empty(unknowns, 2, Vec::new());
        for (t, nodes) in surface.triangles().iter().enumerate() {
            let area = surface.areas_m2()[t];
            nodes.iter().for_each(|&n| areas[n as usize] += area / 3.0);
            let weights = nodal_gradient(surface.corners(t));
            for row in weights {
                this.push_row(nodes, &row);
            }
        }
        this.areas = areas;
        Ok(this)
    }

    /// Creates jumps of an image that is constant on each triangle, with unknowns on the triangles.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] for a surface without a triangle.
    pub fn elements(surface: &Surface) -> Result<Self, InverseError> {
        let unknowns = surface.triangles().len();
        check_unknowns(unknowns)?;
        let mut this = Self::empty(unknowns, 1, surface.areas_m2().to_vec());
        for (t, neighbours) in surface.neighbours().iter().enumerate() {
            let corners = surface.corners(t);
            for (k, neighbour) in neighbours.iter().enumerate() {
                // each inner edge once, from its triangle of smaller index
                let Some(other) = neighbour.filter(|&n| n as usize > t) else { continue };
                // side k runs from corner k to the next
                let length = norm(sub(corners[(k + 1) % 3], corners[k]));
                this.push_row(&[t as u32, other], &[-length, length]);
            }
        }
        Ok(this)
    }

    fn empty(unknowns: usize, components: usize, areas: Vec<f64>) -> Self {
        let (columns, values) = (Vec::new(), Vec::new());
        Self { unknowns, components, row_starts: vec![0], columns, values, areas, raster: None }
    }

    fn push_row(&mut self, columns: &[u32], values: &[f64]) {
        self.columns.extend_from_slice(columns);
        self.values.extend_from_slice(values);
        self.row_starts.push(self.columns.len());
    }

    /// Returns the pixel grid of a basis of pixels.
    pub(crate) fn raster(&self) -> Option<&Raster> {
        self.raster.as_ref()
    }

    /// Returns the length of an image.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Returns the number of groups.
    pub fn groups(&self) -> usize {
        self.rows() / self.components
    }

    /// Returns the number of rows per group, 1 or 2.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Returns the number of rows of the operator.
    pub fn rows(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Returns the columns and values of a row. With `c` components, group `g` consists of the rows
    /// `g c .. g c + c`.
    ///
    /// # Panics
    /// Panics if the row does not exist.
    pub fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let range = self.row_starts[row]..self.row_starts[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Returns the area of each unknown in square metres, which weights its changes in time.
    pub fn areas_m2(&self) -> &[f64] {
        &self.areas
    }

    /// Returns the total variation `sum_g |D_g x|_2`, in siemens metre for an image in siemens.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn total_variation(&self, image: &[f64]) -> Result<f64, InverseError> {
        crate::check::check_length("image", image.len(), self.unknowns)?;
        let difference = |row: usize| -> f64 {
            let (columns, values) = self.row(row);
            columns.iter().zip(values).map(|(&c, v)| v * image[c as usize]).sum()
        };
        let group = |g: usize| -> f64 {
            let rows = g * self.components..(g + 1) * self.components;
            rows.map(|r| difference(r).powi(2)).sum::<f64>().sqrt()
        };
        Ok((0..self.groups()).map(group).sum())
    }

    /// Returns the label of the connected part of each unknown and the number of parts. The total
    /// variation of an image that is constant on each part is zero.
    pub(crate) fn parts(&self) -> (Vec<u32>, usize) {
        let mut parent: Vec<u32> = (0..self.unknowns as u32).collect();
        fn root(parent: &mut [u32], mut x: u32) -> u32 {
            while parent[x as usize] != x {
                parent[x as usize] = parent[parent[x as usize] as usize];
                x = parent[x as usize];
            }
            x
        }
        for row in 0..self.rows() {
            let columns = self.row(row).0;
            for pair in columns.windows(2) {
                let (a, b) = (root(&mut parent, pair[0]), root(&mut parent, pair[1]));
                // the smaller index becomes the root, so labels do not depend on the order of rows
                parent[a.max(b) as usize] = a.min(b);
            }
        }
        let mut label = vec![u32::MAX; self.unknowns];
        let mut count = 0;
        for x in 0..self.unknowns as u32 {
            let r = root(&mut parent, x) as usize;
            if label[r] == u32::MAX {
                label[r] = count;
                count += 1;
            }
            label[x as usize] = label[r];
        }
        (label, count as usize)
    }
}

fn check_unknowns(unknowns: usize) -> Result<(), InverseError> {
    match unknowns {
        0 => Err(InverseError::WrongLength { what: "unknowns", found: 0, wanted: 1 }),
        _ => Ok(()),
    }
}

/// Returns the area times the gradient of each corner's hat function, `[component][corner]`, in an
/// orthonormal frame of the triangle's plane. This is half the opposite edge, rotated by 90 degrees.
fn nodal_gradient(corners: [[f64; 3]; 3]) -> [[f64; 3]; 2] {
    let (first, second) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
    let length = norm(first);
    let along = first.map(|x| x / length);
    let projection = dot(second, along);
    let rest = sub(second, along.map(|x| x * projection));
    // plane coordinates of the corners: (0, 0), (length, 0), (projection, height)
    let flat = [[0.0, 0.0], [length, 0.0], [projection, norm(rest)]];
    let ends = [0, 1, 2].map(|k| [flat[(k + 1) % 3], flat[(k + 2) % 3]]);
    [ends.map(|[a, b]| 0.5 * (a[1] - b[1])), ends.map(|[a, b]| 0.5 * (b[0] - a[0]))]
}
