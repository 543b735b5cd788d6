//! What an iteration reads and never writes: the basis of the data space, packed for the inner
//! loops, and the gradient by rows and by unknowns.

use super::kernel::PANEL;
use super::scalar::Scalar;
use crate::Gradient;
use faer::MatRef;

/// Unknowns that are handled together, so that their rows stay in the first-level cache: 64 rows of
/// 24 frames are 6 kB in `f32`. A multiple of [`PANEL`].
pub(crate) const BLOCK: usize = 64;

/// The operators of one problem in one floating point type.
///
/// Rows of the gradient are divided by the size of their group, and the radii of the dual balls
/// multiplied by it: the same problem, but one step size then fits groups of every size, which is
/// what makes graded meshes as quick as pixels.
#[derive(Debug, Clone)]
pub(crate) struct Operators<T> {
    pub(crate) unknowns: usize,
    pub(crate) rank: usize,
    /// `rank` rounded up to whole panels.
    pub(crate) padded_rank: usize,
    /// `V` `[unknown, rank]`, orthonormal columns, for `V' x`: per block of unknowns, panels of
    /// four columns, each `[unknown of the block][4]`.
    pub(crate) analysis: Vec<[T; PANEL]>,
    /// `V` for `V c`: panels of four unknowns, each `[padded rank][4]`.
    pub(crate) synthesis: Vec<[T; PANEL]>,
    pub(crate) gradient: Rows<T>,
    /// The gradient by groups.
    pub(crate) groups: Vec<Group<T>>,
    /// The transposed gradient.
    pub(crate) divergence: Rows<T>,
    /// Rows of a group: 1 or 2.
    pub(crate) components: usize,
    /// Radius of the dual ball of each group for a weight of 1, `[group]`.
    pub(crate) radius: Vec<T>,
    /// Radius of the dual interval of each unknown's change in time for a weight of 1, `[unknown]`.
    pub(crate) time_radius: Vec<T>,
    /// An upper bound on the squared norm of the scaled gradient.
    pub(crate) norm_squared: f64,
}

/// A group of the gradient: every basis has one or two rows on two or three unknowns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Group<T> {
    /// Unused places repeat the first unknown with weight 0.
    pub(crate) unknowns: [u32; 3],
    /// `[component][place]`.
    pub(crate) weights: [[T; 3]; 2],
}

impl<T: Scalar> Group<T> {
    fn new(rows: &[Vec<(u32, f64)>]) -> Self {
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

/// A sparse matrix by rows.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rows<T> {
    pub(crate) starts: Vec<u32>,
    pub(crate) columns: Vec<u32>,
    pub(crate) values: Vec<T>,
}

impl<T: Scalar> Rows<T> {
    #[inline(always)]
    pub(crate) fn row(&self, row: usize) -> impl Iterator<Item = (usize, T)> {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        let columns = self.columns[range.clone()].iter().map(|&c| c as usize);
        columns.zip(self.values[range].iter().copied())
    }

    pub(crate) fn count(&self) -> usize {
        self.starts.len() - 1
    }

    fn from_rows(rows: &[Vec<(u32, f64)>]) -> Self {
        let mut this = Self { starts: vec![0], columns: Vec::new(), values: Vec::new() };
        for row in rows {
            this.columns.extend(row.iter().map(|e| e.0));
            this.values.extend(row.iter().map(|e| T::from_f64(e.1)));
            this.starts.push(this.columns.len() as u32);
        }
        this
    }
}

impl<T: Scalar> Operators<T> {
    /// Packs `basis` `[unknown, rank]`.
    pub(crate) fn new(basis: MatRef<'_, f64>, gradient: &Gradient) -> Self {
        let (unknowns, rank) = (basis.nrows(), basis.ncols());
        let padded_rank = rank.next_multiple_of(PANEL);
        let entry = |p: usize, k: usize| {
            T::from_f64(if p < unknowns && k < rank { basis[(p, k)] } else { 0.0 })
        };
        let mut analysis = Vec::with_capacity(unknowns.div_ceil(BLOCK) * BLOCK * padded_rank);
        for block in (0..unknowns).step_by(BLOCK) {
            for k in (0..padded_rank).step_by(PANEL) {
                let unknowns = block..(block + BLOCK).min(unknowns);
                analysis.extend(unknowns.map(|p| std::array::from_fn(|r| entry(p, k + r))));
            }
        }
        let mut synthesis = Vec::with_capacity(unknowns.next_multiple_of(PANEL) * padded_rank);
        for p in (0..unknowns).step_by(PANEL) {
            synthesis.extend((0..padded_rank).map(|k| std::array::from_fn(|r| entry(p + r, k))));
        }
        let (rows, sizes) = scaled_rows(gradient);
        let mut transposed = vec![Vec::new(); unknowns];
        for (r, row) in rows.iter().enumerate() {
            row.iter().for_each(|&(p, v)| transposed[p as usize].push((r as u32, v)));
        }
        let length = |row: &Vec<(u32, f64)>| row.iter().map(|e| e.1.abs()).sum::<f64>();
        let lengths: Vec<f64> = rows.iter().map(length).collect();
        // the largest row sum of |D'| |D|
        let norm_squared = transposed
            .iter()
            .map(|row| row.iter().map(|&(r, v)| v.abs() * lengths[r as usize]).sum::<f64>())
            .fold(0.0, f64::max);
        Self {
            unknowns,
            rank,
            padded_rank,
            analysis,
            synthesis,
            gradient: Rows::from_rows(&rows),
            groups: rows.chunks(gradient.components()).map(Group::new).collect(),
            divergence: Rows::from_rows(&transposed),
            components: gradient.components(),
            radius: sizes.iter().map(|&s| T::from_f64(s)).collect(),
            time_radius: gradient.areas_m2().iter().map(|&a| T::from_f64(a)).collect(),
            norm_squared,
        }
    }
}

/// Rows divided by the size of their group, and the sizes: half the largest sum of absolute values
/// of a row, which is 1 for differences of pixels.
fn scaled_rows(gradient: &Gradient) -> (Vec<Vec<(u32, f64)>>, Vec<f64>) {
    let components = gradient.components();
    let mut rows = Vec::with_capacity(gradient.rows());
    let mut sizes = Vec::with_capacity(gradient.groups());
    for group in 0..gradient.groups() {
        let own = group * components..(group + 1) * components;
        let half = |r: usize| 0.5 * gradient.row(r).1.iter().map(|v| v.abs()).sum::<f64>();
        let size = own.clone().map(half).fold(0.0, f64::max);
        sizes.push(size);
        for r in own {
            let (columns, values) = gradient.row(r);
            rows.push(columns.iter().zip(values).map(|(&c, v)| (c, v / size)).collect());
        }
    }
    (rows, sizes)
}
