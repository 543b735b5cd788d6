//! Read-only operators of the iteration: the basis of the data space, packed for the inner loops, and
//! the gradient by rows and by unknowns.

use super::float::Float;
use super::kernel::{PANEL, RANKS};
use crate::Gradient;
use faer::MatRef;

/// Number of unknowns processed together, so that their rows and their part of the basis stay in cache:
/// 32 rows of 24 frames take 3 kB in `f32`, their part of the basis 13 kB. A multiple of [`PANEL`].
pub(crate) const BLOCK: usize = 32;

/// Columns and values of the entries of a row.
type SparseRow = Vec<(u32, f64)>;

/// Operators of one problem in one floating-point type.
///
/// Rows of the gradient are divided by the size of their group, and the radii of the dual balls are
/// multiplied by it. The problem is unchanged, but one step size then suits groups of every size, so
/// that graded meshes converge as fast as pixels.
#[derive(Debug, Clone)]
pub(crate) struct Operators<T> {
    pub(crate) unknowns: usize,
    pub(crate) rank: usize,
    /// `rank` rounded up to a multiple of [`RANKS`].
    pub(crate) padded_rank: usize,
    /// `V` `[unknown, rank]`, orthonormal columns: panels of four unknowns, each
    /// `[padded rank][4]`, padded to whole blocks.
    pub(crate) basis: Vec<[T; PANEL]>,
    pub(crate) gradient: Rows<T>,
    /// The gradient by groups, sorted by their last unknown.
    pub(crate) groups: Vec<Group<T>>,
    /// Groups and blocks that are complete after each block of unknowns, `[block]`.
    pub(crate) ready: Vec<Ready>,
    /// The transposed gradient.
    pub(crate) divergence: Rows<T>,
    /// Index of each group in the caller's gradient, `[group]`.
    pub(crate) order: Vec<u32>,
    /// Number of rows of a group, 1 or 2.
    pub(crate) components: usize,
    /// Radius of the dual ball of each group for a weight of 1, `[group]`.
    pub(crate) radius: Vec<T>,
    /// Radius of the dual interval of each unknown's change in time for a weight of 1, `[unknown]`.
    pub(crate) time_radius: Vec<T>,
    /// Upper bound on the squared norm of the scaled gradient.
    pub(crate) norm_squared: f64,
}

/// A group of the gradient: one or two rows on two or three unknowns, for every basis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Group<T> {
    /// Unused places repeat the first unknown with weight 0.
    pub(crate) unknowns: [u32; 3],
    /// `[component][place]`.
    pub(crate) weights: [[T; 3]; 2],
}

impl<T: Float> Group<T> {
    fn new(rows: &[SparseRow]) -> Self {
        let first = rows.iter().flatten().next().map_or(0, |e| e.0);
        let mut this = Self { unknowns: [first; 3], weights: [[T::default(); 3]; 2] };
        let mut used = 0;
        for (row, weights) in rows.iter().zip(0..2) {
            for &(unknown, value) in row {
                let known = this.unknowns[..used].iter().position(|&u| u == unknown);
                let place = known.unwrap_or(used).min(2);
                used = used.max(place + 1);
                this.unknowns[place] = unknown;
                this.weights[weights][place] = T::from_f64(value);
            }
        }
        this
    }
}

/// Groups and blocks that can be processed after a block of unknowns. If neighbours have close indices,
/// this happens soon, while their data is still in cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ready {
    /// All unknowns of the groups before this one are available.
    pub(crate) groups: usize,
    /// All groups of the blocks of unknowns before this one are available.
    pub(crate) blocks: usize,
}

/// A sparse matrix by rows.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rows<T> {
    pub(crate) starts: Vec<u32>,
    pub(crate) columns: Vec<u32>,
    pub(crate) values: Vec<T>,
}

impl<T: Float> Rows<T> {
    #[inline(always)]
    pub(crate) fn row(&self, row: usize) -> impl Iterator<Item = (usize, T)> {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        let columns = self.columns[range.clone()].iter().map(|&c| c as usize);
        columns.zip(self.values[range].iter().copied())
    }

    pub(crate) fn count(&self) -> usize {
        self.starts.len() - 1
    }

    fn from_rows(rows: &[SparseRow]) -> Self {
        let mut this = Self { starts: vec![0], columns: Vec::new(), values: Vec::new() };
        for row in rows {
            this.columns.extend(row.iter().map(|e| e.0));
            this.values.extend(row.iter().map(|e| T::from_f64(e.1)));
            this.starts.push(this.columns.len() as u32);
        }
        this
    }
}

impl<T: Float> Operators<T> {
    /// Packs `basis` `[unknown, rank]`.
    pub(crate) fn new(basis: MatRef<'_, f64>, gradient: &Gradient) -> Self {
        let (unknowns, rank) = (basis.nrows(), basis.ncols());
        let padded_rank = rank.next_multiple_of(RANKS);
        let entry = |p: usize, k: usize| {
            T::from_f64(if p < unknowns && k < rank { basis[(p, k)] } else { 0.0 })
        };
        let mut panels = Vec::with_capacity(unknowns.next_multiple_of(BLOCK) * padded_rank);
        for p in (0..unknowns.next_multiple_of(BLOCK)).step_by(PANEL) {
            panels.extend((0..padded_rank).map(|k| std::array::from_fn(|r| entry(p + r, k))));
        }
        let (rows, sizes, order) = scaled_rows(gradient);
        let mut transposed = vec![Vec::new(); unknowns];
        for (r, row) in rows.iter().enumerate() {
            row.iter().for_each(|&(p, v)| transposed[p as usize].push((r as u32, v)));
        }
        let length = |row: &SparseRow| row.iter().map(|e| e.1.abs()).sum::<f64>();
        let lengths: Vec<f64> = rows.iter().map(length).collect();
        // largest row sum of |D'| |D|
        let norm_squared = transposed
            .iter()
            .map(|row| row.iter().map(|&(r, v)| v.abs() * lengths[r as usize]).sum::<f64>())
            .fold(0.0, f64::max);
        Self {
            unknowns,
            rank,
            padded_rank,
            basis: panels,
            gradient: Rows::from_rows(&rows),
            ready: ready(&rows, &transposed, gradient.components()),
            groups: rows.chunks(gradient.components()).map(Group::new).collect(),
            divergence: Rows::from_rows(&transposed),
            order,
            components: gradient.components(),
            radius: sizes.iter().map(|&s| T::from_f64(s)).collect(),
            time_radius: gradient.areas_m2().iter().map(|&a| T::from_f64(a)).collect(),
            norm_squared,
        }
    }
}

/// See [`Ready`].
fn ready(rows: &[SparseRow], transposed: &[SparseRow], components: usize) -> Vec<Ready> {
    let last_group = |block: &[SparseRow]| {
        block.iter().flatten().map(|e| e.0 as usize / components + 1).max().unwrap_or(0)
    };
    let needed: Vec<usize> = transposed.chunks(BLOCK).map(last_group).collect();
    let ends: Vec<usize> = rows.chunks(components).map(last_unknown).collect();
    let (mut groups, mut blocks) = (0, 0);
    (0..needed.len())
        .map(|block| {
            while groups < ends.len() && ends[groups] < (block + 1) * BLOCK {
                groups += 1;
            }
            while blocks <= block && needed[blocks] <= groups {
                blocks += 1;
            }
            Ready { groups, blocks }
        })
        .collect()
}

fn last_unknown(group: &[SparseRow]) -> usize {
    group.iter().flatten().map(|e| e.0 as usize).max().unwrap_or(0)
}

/// Returns the rows divided by the size of their group, the sizes, and the original indices of the
/// groups, which are sorted by their last unknown.
///
/// The size is half the largest sum of absolute values of a row, which is 1 for plain differences of
/// pixels.
fn scaled_rows(gradient: &Gradient) -> (Vec<SparseRow>, Vec<f64>, Vec<u32>) {
    let components = gradient.components();
    let mut groups: Vec<(f64, Vec<SparseRow>, u32)> = (0..gradient.groups())
        .map(|group| {
            let own = group * components..(group + 1) * components;
            let half = |r: usize| 0.5 * gradient.row(r).1.iter().map(|v| v.abs()).sum::<f64>();
            let size = own.clone().map(half).fold(0.0, f64::max);
            let scaled = |r: usize| {
                let (columns, values) = gradient.row(r);
                columns.iter().zip(values).map(|(&c, v)| (c, v / size)).collect()
            };
            (size, own.map(scaled).collect(), group as u32)
        })
        .collect();
    groups.sort_by_key(|(_, rows, _)| last_unknown(rows));
    let sizes = groups.iter().map(|group| group.0).collect();
    let order = groups.iter().map(|group| group.2).collect();
    (groups.into_iter().flat_map(|group| group.1).collect(), sizes, order)
}
