//! The sparse spatial difference operator behind every total variation.

use crate::InverseError;
use eit_mesh::Surface;
use ndarray::ArrayRef2;

/// Spatial differences of an image in groups: the total variation of an image `x` is
/// `sum_g |D_g x|_2`, where a group `g` holds one or two rows of the operator `D`.
///
/// | basis | group | `D_g x` | unit of the sum |
/// |---|---|---|---|
/// | [`pixels`](Self::pixels) | a pixel | differences to its right and lower neighbour, times the pixel's edge | S m |
/// | [`nodal`](Self::nodal) | a triangle | gradient in its plane times its area | S m |
/// | [`elements`](Self::elements) | an inner edge | jump across it times its length | S m |
///
/// All three are `integral |grad x| dA` of the image they stand for, exactly so for nodal and
/// element images; the sum over pixels is the isotropic one-sided form (rotation invariant up to
/// the pixel size). Differences are never taken across the rim, a hole or the edge of the mask, and
/// nothing wraps around.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradient {
    unknowns: usize,
    components: usize,
    /// Entries of row `r`: `row_starts[r]..row_starts[r + 1]`; rows of a group are consecutive.
    row_starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Area that each unknown stands for.
    areas: Vec<f64>,
    /// The grid of pixels; `None` on other bases.
    raster: Option<Raster>,
}

/// Where the unknowns of a basis of pixels lie.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Raster {
    /// Columns of the grid.
    pub(crate) width: usize,
    /// Place in the grid, row by row, of each unknown.
    pub(crate) cells: Vec<usize>,
    /// Edge of a pixel, metres.
    pub(crate) pixel_m: f64,
}

impl Gradient {
    /// One-sided differences on the pixels inside `mask` `[row, column]`, unknowns in row-major
    /// order of the pixels inside (as [`eit_mesh::Raster::masked_pixels`]).
    ///
    /// `pixel_m` is the edge of a pixel in metres. With 1 the sums are plain differences of pixel
    /// values.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] for a mask without a pixel; [`InverseError::OutOfRange`] for
    /// an edge that is not positive and finite.
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

    /// Gradients of an image that is linear on each triangle, unknowns at the nodes. On a curved
    /// surface the gradient is the one in the triangle's plane: isotropic and independent of the
    /// surface's position in space.
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

    /// Jumps of an image that is constant on each triangle, unknowns on the triangles.
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
                let length = norm(subtract(corners[(k + 1) % 3], corners[k]));
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

    /// The grid of pixels, where the basis is one.
    pub(crate) fn raster(&self) -> Option<&Raster> {
        self.raster.as_ref()
    }

    /// Length of an image.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Number of groups.
    pub fn groups(&self) -> usize {
        self.rows() / self.components
    }

    /// Rows of a group: 1 or 2.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Rows of the operator.
    pub fn rows(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Columns and values of a row; rows of group `g` are `g c .. g c + c`.
    ///
    /// # Panics
    /// Where the row does not exist.
    pub fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let range = self.row_starts[row]..self.row_starts[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Area that each unknown stands for, square metres: the weight of its changes in time.
    pub fn areas_m2(&self) -> &[f64] {
        &self.areas
    }

    /// `sum_g |D_g x|_2`, siemens metre for an image in siemens.
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

    /// Connected parts: label of each unknown and their count. An image that is constant on each
    /// part has no total variation.
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
                // the smaller index becomes the root: labels do not depend on the order of rows
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

fn subtract(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// Area times the gradient of each corner's hat function, `[component][corner]`, in an orthonormal
/// frame of the triangle's plane: half the opposite edge turned by a right angle.
fn nodal_gradient(corners: [[f64; 3]; 3]) -> [[f64; 3]; 2] {
    let (first, second) = (subtract(corners[1], corners[0]), subtract(corners[2], corners[0]));
    let length = norm(first);
    let along = first.map(|x| x / length);
    let projection = dot(second, along);
    let rest = subtract(second, along.map(|x| x * projection));
    // plane coordinates of the corners: (0, 0), (length, 0), (projection, height)
    let flat = [[0.0, 0.0], [length, 0.0], [projection, norm(rest)]];
    let ends = [0, 1, 2].map(|k| [flat[(k + 1) % 3], flat[(k + 2) % 3]]);
    [ends.map(|[a, b]| 0.5 * (a[1] - b[1])), ends.map(|[a, b]| 0.5 * (b[0] - a[0]))]
}
