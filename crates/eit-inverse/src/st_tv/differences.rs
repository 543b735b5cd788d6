//! Memory layout of the unknowns of a frame and of the gradient's groups, and the gradient in that layout.
//!
//! A raster keeps its grid, with padding around it, so that neighbours are whole lanes at a fixed
//! distance. Cells outside the mask stay zero, since their steps are zero. On any other basis the
//! unknowns are stored consecutively and neighbours are gathered by index.

use super::float::Float;
use super::gradient::Gradient;
use super::lanes::{LANES, Lane, PANEL, each, load, splat};

/// Rows of the gradient, divided by the size of their group: the problem is unchanged if the radii of the dual balls
/// are multiplied by it, but one step size then suits groups of every size, so that graded meshes converge as fast
/// as pixels.
pub(crate) struct ScaledRows {
    /// Number of rows of a group, 1 or 2.
    pub(crate) components: usize,
    /// Columns and values, `[row]`.
    pub(crate) rows: Vec<Vec<(u32, f64)>>,
    /// Half the largest sum of absolute values of a row of the group, 1 for plain differences of pixels, `[group]`.
    pub(crate) sizes: Vec<f64>,
}

impl ScaledRows {
    pub(crate) fn new(gradient: &Gradient) -> Self {
        let components = gradient.components();
        let (mut rows, mut sizes) = (Vec::new(), Vec::new());
        for group in 0..gradient.groups() {
            let own = group * components..(group + 1) * components;
            let half = |r: usize| 0.5 * gradient.row(r).1.iter().map(|v| v.abs()).sum::<f64>();
            let size = own.clone().map(half).fold(0.0, f64::max);
            rows.extend(own.map(|r| {
                let (columns, values) = gradient.row(r);
                columns.iter().zip(values).map(|(&c, v)| (c, v / size)).collect()
            }));
            sizes.push(size);
        }
        Self { components, rows, sizes }
    }
}

/// Memory layout of the unknowns.
#[derive(Debug, Clone)]
pub(crate) struct Places {
    /// First cell of each block; padded to whole panels.
    pub(crate) blocks: Vec<usize>,
    /// Cell of each unknown.
    pub(crate) cells: Vec<usize>,
    /// Length of an array over the cells.
    pub(crate) length: usize,
}

/// Gradient on lanes of cells. Rows are scaled and groups have radii as in [`ScaledRows`].
pub(crate) trait Differences<T: Float> {
    /// Returns the first positions of the blocks of groups.
    fn group_blocks(&self) -> &[usize];
    /// Computes `D' q` on the block of cells with this index and first cell.
    fn adjoint(&self, q: [&[T]; 2], block: usize, at: usize) -> Lane<T>;
    /// Computes both components of `D x` on the block of groups at `at`.
    fn difference(&self, x: &[T], at: usize) -> [Lane<T>; 2];
    /// Returns the radii of the block of groups at `at`.
    fn group_radius(&self, at: usize) -> Lane<T>;
    /// Returns the radii of the change for the block of cells at `at`.
    fn cell_radius(&self, at: usize) -> Lane<T>;
    /// Returns, for each group at `at`, the largest of its unknowns' values, which are 0 or above.
    fn group_largest(&self, x: &[T], at: usize) -> Lane<T>;
    /// Returns, for each cell of the block, the largest of its groups' values, which are 0 or above.
    fn cell_largest(&self, m: &[T], block: usize, at: usize) -> Lane<T>;
}

/// One-sided differences on a grid.
#[derive(Debug, Clone)]
pub(crate) struct Grid<T> {
    width: usize,
    /// First cell of each block that contains pixels.
    blocks: Vec<usize>,
    /// 1 if the right neighbour, or the lower one, is inside the mask, else 0.
    right: Vec<T>,
    down: Vec<T>,
    radius: T,
    time_radius: T,
}

/// Differences by index.
#[derive(Debug, Clone)]
pub(crate) struct Gathered<T> {
    group_blocks: Vec<usize>,
    /// Unknowns of each group and their weights, `[slot][group]` and `[component][slot][group]`.
    unknowns: [Vec<u32>; 3],
    weights: [[Vec<T>; 3]; 2],
    radius: Vec<T>,
    time_radius: Vec<T>,
    /// Entries of `D'` of a block of cells, one lane each: `starts[block]..starts[block + 1]`.
    starts: Vec<u32>,
    entries: Vec<Entry<T>>,
}

/// One entry of `D'` for each cell of a block.
#[derive(Debug, Clone)]
struct Entry<T> {
    group: [u32; LANES],
    /// By component; 0 if a cell has fewer entries.
    weight: [Lane<T>; 2],
    /// 1 if the cell belongs to the group.
    belongs: Lane<T>,
}

impl<T: Float> Entry<T> {
    /// The entry with this index of a block's cells, of which each lists groups and weights.
    fn of(cells: &[Vec<(u32, [T; 2])>], k: usize) -> Self {
        let zeros = [T::default(); LANES];
        let mut entry = Self { group: [0; LANES], weight: [zeros; 2], belongs: zeros };
        for (l, column) in cells.iter().enumerate() {
            if let Some(&(group, [first, second])) = column.get(k) {
                entry.group[l] = group;
                (entry.weight[0][l], entry.weight[1][l]) = (first, second);
                entry.belongs[l] = T::from_f64(1.0);
            }
        }
        entry
    }
}

/// Gradient in the layout of the basis.
#[derive(Debug, Clone)]
pub(crate) enum Basis<T> {
    Grid(Grid<T>),
    Gathered(Box<Gathered<T>>),
}

impl<T: Float> Basis<T> {
    pub(crate) fn new(gradient: &Gradient, rows: &ScaledRows) -> (Self, Places) {
        match gradient.raster() {
            Some(raster) => {
                let (grid, places) = Grid::new(raster.width, &raster.cells, raster.pixel_m);
                (Self::Grid(grid), places)
            }
            None => {
                let (gathered, places) = Gathered::new(gradient, rows);
                (Self::Gathered(Box::new(gathered)), places)
            }
        }
    }

    /// Returns the length of an array over the groups.
    pub(crate) fn group_length(&self, places: &Places) -> usize {
        match self {
            Self::Grid(_) => places.length,
            Self::Gathered(gathered) => gathered.radius.len(),
        }
    }

    /// Returns the position of one of the caller's groups. The caller's dual is `q / size` with the dual `q` at that
    /// position and the size of the group.
    pub(crate) fn group_place(&self, gradient: &Gradient, places: &Places, group: usize) -> usize {
        if let Self::Gathered(_) = self {
            return group;
        }
        let rows = [2 * group, 2 * group + 1].map(|row| gradient.row(row).0.first());
        let pixel = rows[0].or(rows[1]).map_or(0, |&pixel| pixel as usize);
        places.cells[pixel]
    }

    /// Returns the size of the group at a position.
    pub(crate) fn group_size(&self, place: usize) -> f64 {
        match self {
            Self::Grid(grid) => grid.radius.to_f64(),
            Self::Gathered(gathered) => gathered.radius[place].to_f64(),
        }
    }
}

/// Runs a call, or an operation of [`pulp`], for the gradient of either layout with the widest registers:
/// `for_basis!(ops, |differences| call)`, `for_basis!(ops, simd |differences| operation)`.
macro_rules! for_basis {
    ($ops:expr, |$differences:ident| $call:expr) => {
        match &$ops.basis {
            $crate::st_tv::differences::Basis::Grid($differences) => {
                $crate::st_tv::lanes::vectorised!($call)
            }
            $crate::st_tv::differences::Basis::Gathered(own) => {
                let $differences = own.as_ref();
                $crate::st_tv::lanes::vectorised!($call)
            }
        }
    };
}
pub(crate) use for_basis;

impl<T: Float> Grid<T> {
    fn new(width: usize, pixels: &[usize], pixel_m: f64) -> (Self, Places) {
        let room = (width + 1).next_multiple_of(LANES);
        let last = pixels.last().copied().unwrap_or(0);
        let cells: Vec<usize> = pixels.iter().map(|cell| room + cell).collect();
        let end = (room + last + 1).next_multiple_of(LANES);
        // an empty block pads the last panel
        let idle = end + room;
        let length = idle + LANES + room;
        let one = T::from_f64(1.0);
        let mut inside = vec![false; length];
        cells.iter().for_each(|&cell| inside[cell] = true);
        let (mut right, mut down) = (vec![T::default(); length], vec![T::default(); length]);
        for &cell in &cells {
            let at_edge = (cell - room) % width + 1 == width;
            if inside[cell + 1] && !at_edge {
                right[cell] = one;
            }
            if inside[cell + width] {
                down[cell] = one;
            }
        }
        let blocks: Vec<usize> = (room..end)
            .step_by(LANES)
            .filter(|&first| inside[first..first + LANES].contains(&true))
            .collect();
        let mut padded = blocks.clone();
        padded.resize(blocks.len().next_multiple_of(PANEL / LANES), idle);
        let (radius, time_radius) = (T::from_f64(pixel_m), T::from_f64(pixel_m * pixel_m));
        let grid = Self { width, blocks, right, down, radius, time_radius };
        (grid, Places { blocks: padded, cells, length })
    }
}

impl<T: Float> Differences<T> for Grid<T> {
    #[inline(always)]
    fn group_blocks(&self) -> &[usize] {
        &self.blocks
    }

    #[inline(always)]
    fn adjoint(&self, q: [&[T]; 2], _: usize, at: usize) -> Lane<T> {
        let (left, here) = (load(q[0], at - 1), load(q[0], at));
        let (above, below) = (load(q[1], at - self.width), load(q[1], at));
        each!(|l| (left[l] - here[l]) + (above[l] - below[l]))
    }

    #[inline(always)]
    fn difference(&self, x: &[T], at: usize) -> [Lane<T>; 2] {
        let (here, right, down) = (load(x, at), load(x, at + 1), load(x, at + self.width));
        let (has_right, has_down) = (load(&self.right, at), load(&self.down, at));
        [
            each!(|l| has_right[l] * (right[l] - here[l])),
            each!(|l| has_down[l] * (down[l] - here[l])),
        ]
    }

    #[inline(always)]
    fn group_radius(&self, _: usize) -> Lane<T> {
        splat(self.radius)
    }

    #[inline(always)]
    fn cell_radius(&self, _: usize) -> Lane<T> {
        splat(self.time_radius)
    }

    #[inline(always)]
    fn group_largest(&self, x: &[T], at: usize) -> Lane<T> {
        let (here, right, down) = (load(x, at), load(x, at + 1), load(x, at + self.width));
        let (has_right, has_down) = (load(&self.right, at), load(&self.down, at));
        each!(|l| here[l].max(has_right[l] * right[l]).max(has_down[l] * down[l]))
    }

    #[inline(always)]
    fn cell_largest(&self, m: &[T], _: usize, at: usize) -> Lane<T> {
        let here = load(m, at);
        let (left, above) = (load(m, at - 1), load(m, at - self.width));
        let (has_left, has_above) = (load(&self.right, at - 1), load(&self.down, at - self.width));
        each!(|l| here[l].max(has_left[l] * left[l]).max(has_above[l] * above[l]))
    }
}

impl<T: Float> Gathered<T> {
    fn new(gradient: &Gradient, scaled: &ScaledRows) -> (Self, Places) {
        let (zero, one) = (T::default(), T::from_f64(1.0));
        let length = gradient.unknowns().next_multiple_of(PANEL);
        let groups = scaled.sizes.len().next_multiple_of(LANES);
        let mut unknowns: [Vec<u32>; 3] = std::array::from_fn(|_| vec![0; groups]);
        let mut weights: [[Vec<T>; 3]; 2] =
            std::array::from_fn(|_| std::array::from_fn(|_| vec![zero; groups]));
        let mut radius = vec![one; groups];
        // entries of D' for each cell: group and weights
        let mut columns: Vec<Vec<(u32, [T; 2])>> = vec![Vec::new(); length];
        for (g, rows) in scaled.rows.chunks(scaled.components).enumerate() {
            radius[g] = T::from_f64(scaled.sizes[g]);
            let mut own: Vec<(u32, [f64; 2])> = Vec::new();
            for (component, row) in rows.iter().enumerate() {
                for &(unknown, value) in row {
                    let place = own.iter().position(|o| o.0 == unknown).unwrap_or(own.len());
                    if place == own.len() {
                        own.push((unknown, [0.0; 2]));
                    }
                    own[place].1[component] = value;
                }
            }
            for place in 0..3 {
                // unused places repeat the first unknown with weight 0
                let first = own.first().map_or(0, |o| o.0);
                let (unknown, values) = own.get(place).copied().unwrap_or((first, [0.0; 2]));
                let values = values.map(T::from_f64);
                unknowns[place][g] = unknown;
                (weights[0][place][g], weights[1][place][g]) = (values[0], values[1]);
                if values != [zero; 2] {
                    columns[unknown as usize].push((g as u32, values));
                }
            }
        }
        let mut time_radius: Vec<T> = gradient.areas_m2().iter().map(|a| T::from_f64(*a)).collect();
        time_radius.resize(length, one);
        let blocks: Vec<usize> = (0..length).step_by(LANES).collect();
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for &first in &blocks {
            let own = &columns[first..first + LANES];
            let count = own.iter().map(Vec::len).max().unwrap_or(0);
            entries.extend((0..count).map(|k| Entry::of(own, k)));
            starts.push(entries.len() as u32);
        }
        let group_blocks = (0..groups).step_by(LANES).collect();
        let this = Self { group_blocks, unknowns, weights, radius, time_radius, starts, entries };
        (this, Places { blocks, cells: (0..gradient.unknowns()).collect(), length })
    }

    /// Gathers the values at a lane of indices.
    #[inline(always)]
    fn gather(values: &[T], at: &[u32]) -> Lane<T> {
        let mut out = [T::default(); LANES];
        for (out, &i) in out.iter_mut().zip(at) {
            *out = values[i as usize];
        }
        out
    }

    #[inline(always)]
    fn own(&self, block: usize) -> &[Entry<T>] {
        &self.entries[self.starts[block] as usize..self.starts[block + 1] as usize]
    }
}

impl<T: Float> Differences<T> for Gathered<T> {
    #[inline(always)]
    fn group_blocks(&self) -> &[usize] {
        &self.group_blocks
    }

    #[inline(always)]
    fn adjoint(&self, q: [&[T]; 2], block: usize, _: usize) -> Lane<T> {
        let mut sum = [T::default(); LANES];
        for entry in self.own(block) {
            let first = Self::gather(q[0], &entry.group);
            let second = Self::gather(q[1], &entry.group);
            let [a, b] = &entry.weight;
            sum = each!(|l| a[l].mul_add(first[l], b[l].mul_add(second[l], sum[l])));
        }
        sum
    }

    #[inline(always)]
    fn difference(&self, x: &[T], at: usize) -> [Lane<T>; 2] {
        let mut out = [[T::default(); LANES]; 2];
        for place in 0..3 {
            let x = Self::gather(x, &self.unknowns[place][at..at + LANES]);
            for (out, weights) in out.iter_mut().zip(&self.weights) {
                let w = load(&weights[place], at);
                let before = *out;
                *out = each!(|l| w[l].mul_add(x[l], before[l]));
            }
        }
        out
    }

    #[inline(always)]
    fn group_radius(&self, at: usize) -> Lane<T> {
        load(&self.radius, at)
    }

    #[inline(always)]
    fn cell_radius(&self, at: usize) -> Lane<T> {
        load(&self.time_radius, at)
    }

    #[inline(always)]
    fn group_largest(&self, x: &[T], at: usize) -> Lane<T> {
        let mut most = [T::default(); LANES];
        for unknowns in &self.unknowns {
            let x = Self::gather(x, &unknowns[at..at + LANES]);
            most = each!(|l| most[l].max(x[l]));
        }
        most
    }

    #[inline(always)]
    fn cell_largest(&self, m: &[T], block: usize, _: usize) -> Lane<T> {
        let mut most = [T::default(); LANES];
        for entry in self.own(block) {
            let m = Self::gather(m, &entry.group);
            most = each!(|l| most[l].max(entry.belongs[l] * m[l]));
        }
        most
    }
}
