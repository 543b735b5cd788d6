//! Arrays of the iteration of one frame, in one floating-point type.

use super::differences::{Basis, Places};
use super::lanes::{BLOCKS, LANES, Lane, PANEL, Project, short_unit};
use crate::st_tv::StTv;
use crate::st_tv::operators::Operators;

/// Ranks are padded to a multiple of this number.
const RANKS: usize = LANES;

/// Quantities computed once: memory layout, gradient and basis of the data space.
#[derive(Debug, Clone)]
pub(crate) struct Setting<T: Project> {
    pub(crate) places: Places,
    pub(crate) basis: Basis<T>,
    pub(crate) rank: usize,
    /// `rank` padded to whole lanes.
    pub(crate) padded: usize,
    /// `V` by panels of cells, `[panel][padded rank]`; zero in cells without an unknown.
    pub(crate) panels: Vec<[T; PANEL]>,
    /// The same with short entries, and the unit of each rank; empty if the type has no short entries.
    pub(crate) short: Vec<[T::Short; PANEL]>,
    pub(crate) short_units: Vec<T>,
    /// `V` by unknowns, `[unknown][padded rank]`.
    pub(crate) rows: Vec<T>,
    /// Singular values, descending.
    pub(crate) singular: Vec<f64>,
    /// 1 in cells with an unknown, else 0.
    pub(crate) inside: Vec<T>,
    /// Largest norm of a row of `V`.
    pub(crate) longest_row: f64,
    /// Largest number of entries of a row of `D'`, and largest sum of their `|weight| radius`.
    pub(crate) adjoint_terms: [f64; 2],
    /// Mean radius of a group, which scales `lambda_space` to a difference.
    pub(crate) mean_radius: f64,
    /// Upper bound on `|D|^2 + 1`, the divisor of step sizes.
    pub(crate) norm_squared: f64,
}

impl<T: Project> Setting<T> {
    pub(crate) fn new(solver: &StTv, ops: &Operators<T>) -> Self {
        let (basis, places) = Basis::new(&solver.gradient, ops);
        let source = &solver.compression.basis;
        let (unknowns, rank) = (source.nrows(), source.ncols());
        let padded = rank.next_multiple_of(RANKS);
        let mut rows = vec![T::default(); unknowns * padded];
        let mut panels = vec![[T::default(); PANEL]; places.blocks.len() / BLOCKS * padded];
        // index of the block at each cell
        let mut block_at = vec![usize::MAX; places.length];
        for (block, &first) in places.blocks.iter().enumerate() {
            block_at[first..first + LANES].fill(block);
        }
        let mut inside = vec![T::default(); places.length];
        let mut longest_row = 0.0_f64;
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
            }
            longest_row = longest_row.max(square.sqrt());
        }
        let largest = |k: usize| (0..unknowns).map(|p| source[(p, k)].abs()).fold(0.0, f64::max);
        let units: Vec<f64> =
            (0..padded).map(|k| short_unit(if k < rank { largest(k) } else { 0.0 })).collect();
        let mut short = Vec::new();
        if T::HAS_SHORT {
            for (row, panel) in panels.iter().enumerate() {
                let unit = units[row % padded];
                let most = short_unit(1.0) / unit;
                short.push(std::array::from_fn(|l| {
                    T::shorten(if unit > 0.0 { panel[l].to_f64() * most } else { 0.0 })
                }));
            }
        }
        let mut adjoint_terms = [0.0_f64; 2];
        for p in 0..unknowns {
            let (mut count, mut sum) = (0.0, 0.0);
            for (row, weight) in ops.divergence.row(p) {
                count += 1.0;
                sum += weight.to_f64().abs() * ops.radius[row / ops.components].to_f64();
            }
            adjoint_terms = [adjoint_terms[0].max(count), adjoint_terms[1].max(sum)];
        }
        let count = ops.radius.len().max(1) as f64;
        let sum: f64 = ops.radius.iter().map(|r| r.to_f64()).sum();
        Self {
            mean_radius: if sum > 0.0 { sum / count } else { 1.0 },
            norm_squared: ops.norm_squared.max(0.0) + 1.0,
            places,
            basis,
            rank,
            padded,
            panels,
            short,
            short_units: units.into_iter().map(T::from_f64).collect(),
            rows,
            singular: solver.compression.singular.clone(),
            inside,
            longest_row,
            adjoint_terms,
        }
    }

    /// Returns the basis of a panel for a range of ranks.
    #[inline(always)]
    pub(crate) fn panel(&self, panel: usize, ranks: std::ops::Range<usize>) -> &[[T; PANEL]] {
        &self.panels[panel * self.padded..][ranks]
    }
}

/// Iterate and its work arrays. Arrays are over cells or over groups.
#[derive(Debug, Clone)]
pub(crate) struct Fields<T> {
    /// `d = x - x^`, the change from the anchor `x^`.
    pub(crate) change: Vec<T>,
    /// Change of the last iteration before relaxation.
    pub(crate) fresh: Vec<T>,
    pub(crate) anchor: Vec<T>,
    /// `w`, and `x^ + 2 fresh - change`.
    pub(crate) work: Vec<T>,
    pub(crate) bar: Vec<T>,
    /// Dual of the gradient, by component and group.
    pub(crate) flow: [Vec<T>; 2],
    /// Dual of the change.
    pub(crate) force: Vec<T>,
    /// Force of the tail of the data term.
    pub(crate) tail: Vec<T>,
    /// Distances `lower - x^` and `upper - x^` to the bounds; 0 in cells without an unknown.
    pub(crate) room: [Vec<T>; 2],
    pub(crate) tau: Vec<T>,
    /// Step of each group and each cell, and `1 / (1 + step gamma / radius)`.
    pub(crate) group_step: Vec<T>,
    pub(crate) group_damp: Vec<T>,
    pub(crate) cell_step: Vec<T>,
    pub(crate) cell_damp: Vec<T>,
    /// Partial sums of `V' w`, one lane per rank, `[rank]`.
    pub(crate) sums: Vec<Lane<T>>,
    /// Coefficients `V' w` of the last iteration, and force `F y`, `[padded rank]`.
    pub(crate) coefficients: Vec<T>,
    pub(crate) force_coefficients: Vec<T>,
    pub(crate) scratch: Vec<T>,
}

impl<T: Project> Fields<T> {
    pub(crate) fn new(setting: &Setting<T>) -> Self {
        let cells = vec![T::default(); setting.places.length];
        let groups = vec![T::default(); setting.basis.group_length(&setting.places)];
        let ranks = vec![T::default(); setting.padded];
        Self {
            change: cells.clone(),
            fresh: cells.clone(),
            anchor: cells.clone(),
            work: cells.clone(),
            bar: cells.clone(),
            flow: [groups.clone(), groups.clone()],
            force: cells.clone(),
            tail: cells.clone(),
            room: [cells.clone(), cells.clone()],
            tau: cells.clone(),
            group_step: groups.clone(),
            group_damp: groups,
            cell_step: cells.clone(),
            cell_damp: cells,
            sums: vec![[T::default(); LANES]; setting.padded],
            coefficients: ranks.clone(),
            force_coefficients: ranks.clone(),
            scratch: ranks,
        }
    }
}
