//! What is computed once for a skin: memory layout, gradient and basis of the data space.

use super::differences::{Basis, Places, ScaledRows};
use super::gradient::Gradient;
use super::lanes::{BLOCKS, Entry, LANES, PANEL, Project};
use faer::MatRef;

/// Operators of one problem in one floating-point type. Arrays over cells or groups have the layout of
/// [`super::differences`].
#[derive(Debug, Clone)]
pub(crate) struct Operators<T: Project> {
    pub(crate) places: Places,
    pub(crate) basis: Basis<T>,
    pub(crate) groups: usize,
    pub(crate) rank: usize,
    /// `rank` padded to whole lanes.
    pub(crate) padded: usize,
    /// `V` by panels of cells, `[panel][padded rank]`; zero in cells without an unknown.
    pub(crate) panels: Vec<[T; PANEL]>,
    /// The same with short entries, in units of each rank.
    pub(crate) short: Vec<[T::Short; PANEL]>,
    pub(crate) short_units: Vec<T>,
    /// `V` by unknowns, `[unknown][padded rank]`.
    pub(crate) rows: Vec<T>,
    /// 1 in cells with an unknown, else 0.
    pub(crate) inside: Vec<T>,
    /// Largest norm of a row of `V`.
    pub(crate) longest_row: f64,
    /// Largest number of entries of a row of `D'`, and largest sum of their `|weight| radius`.
    pub(crate) adjoint_terms: [f64; 2],
    /// Mean radius of a group, which scales `lambda_space` to a difference.
    pub(crate) mean_radius: f64,
    /// Norms of the radii of all groups, and of those of changes in time.
    pub(crate) radius_norms: [f64; 2],
    /// Mean radius of a change in time.
    pub(crate) mean_area: f64,
    /// Upper bound on `|D|^2`.
    pub(crate) norm_squared: f64,
}

impl<T: Project> Operators<T> {
    /// Packs the basis `V` `[unknown, rank]`, whose columns are orthonormal.
    pub(crate) fn new(source: MatRef<'_, f64>, gradient: &Gradient, scaled: &ScaledRows) -> Self {
        let (basis, places) = Basis::new(gradient, scaled);
        let (unknowns, rank) = (source.nrows(), source.ncols());
        let padded = rank.next_multiple_of(LANES);
        let mut rows = vec![T::default(); unknowns * padded];
        let mut panels = vec![[T::default(); PANEL]; places.blocks.len() / BLOCKS * padded];
        // index of the block at each cell
        let mut block_at = vec![usize::MAX; places.length];
        for (block, &first) in places.blocks.iter().enumerate() {
            block_at[first..first + LANES].fill(block);
        }
        let mut inside = vec![T::default(); places.length];
        let mut longest_row = 0.0_f64;
        let mut largest = vec![0.0_f64; padded];
        for (p, &cell) in places.cells.iter().enumerate() {
            inside[cell] = T::from_f64(1.0);
            let block = block_at[cell];
            let place = block % BLOCKS * LANES + cell - places.blocks[block];
            let mut square = 0.0;
            for k in 0..rank {
                let value = T::from_f64(source[(p, k)]);
                rows[p * padded + k] = value;
                panels[block / BLOCKS * padded + k][place] = value;
                square += source[(p, k)].powi(2);
                largest[k] = largest[k].max(source[(p, k)].abs());
            }
            longest_row = longest_row.max(square.sqrt());
        }
        let units: Vec<f64> = largest.into_iter().map(T::Short::unit).collect();
        let shorten = |(row, panel): (usize, &[T; PANEL])| {
            panel.map(|value| T::Short::rounded(value.to_f64() / units[row % padded]))
        };
        let short = panels.iter().enumerate().map(shorten).collect();
        let square = |radii: &[f64]| radii.iter().map(|r| r * r).sum::<f64>().sqrt();
        let mean = |radii: &[f64]| radii.iter().sum::<f64>() / radii.len().max(1) as f64;
        let mean_radius = mean(&scaled.sizes);
        let (adjoint_terms, norm_squared) = norms(scaled, unknowns);
        Self {
            groups: basis.group_length(&places),
            places,
            basis,
            rank,
            padded,
            panels,
            short,
            short_units: units.into_iter().map(T::from_f64).collect(),
            rows,
            inside,
            longest_row,
            adjoint_terms,
            mean_radius: if mean_radius > 0.0 { mean_radius } else { 1.0 },
            radius_norms: [square(&scaled.sizes), square(gradient.areas_m2())],
            mean_area: mean(gradient.areas_m2()),
            norm_squared,
        }
    }

    /// Returns the number of unknowns.
    pub(crate) fn unknowns(&self) -> usize {
        self.places.cells.len()
    }

    /// Returns the length of an array over the cells of a frame.
    pub(crate) fn cells(&self) -> usize {
        self.places.length
    }

    /// Returns the basis of a panel for a range of ranks.
    #[inline(always)]
    pub(crate) fn panel(&self, panel: usize, ranks: std::ops::Range<usize>) -> &[[T; PANEL]] {
        &self.panels[panel * self.padded..][ranks]
    }
}

/// Returns the largest number of entries of a row of `D'`, the largest sum of their `|weight| radius`, and the largest
/// row sum of `|D'| |D|`.
fn norms(scaled: &ScaledRows, unknowns: usize) -> ([f64; 2], f64) {
    let mut sums = vec![[0.0_f64; 3]; unknowns];
    for (r, row) in scaled.rows.iter().enumerate() {
        let length: f64 = row.iter().map(|e| e.1.abs()).sum();
        for &(p, v) in row {
            let [count, radii, norm] = &mut sums[p as usize];
            *count += 1.0;
            *radii += v.abs() * scaled.sizes[r / scaled.components];
            *norm += v.abs() * length;
        }
    }
    let largest = |i: usize| sums.iter().fold(0.0_f64, |most, sum| most.max(sum[i]));
    ([largest(0), largest(1)], largest(2))
}
