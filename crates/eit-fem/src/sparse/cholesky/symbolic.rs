//! Symbolic analysis of a pattern: elimination tree, supernodes and the positions of all numbers.

use super::tile::LANES;
use crate::sparse::elimination_tree::{NONE, counts, parents, postorder};
use crate::sparse::graph::Adjacency;
use crate::sparse::pattern::Pattern;

/// A supernode (columns of the factor with one pattern) and its front.
///
/// Rows of a front are numbered locally: its own columns, padding up to `padded`, the rows below,
/// padding up to `stride`. Padding is zero.
#[derive(Debug, Clone)]
pub(super) struct Front {
    /// Index of the first column.
    pub first: usize,
    /// Number of columns.
    pub columns: usize,
    /// Local index of the first row below the columns.
    pub padded: usize,
    /// Number of rows below the columns.
    pub below: usize,
    /// Number of rows of the panel, including padding.
    pub stride: usize,
    /// Start of its panel, `[column, row]`, in the factor.
    pub panel: usize,
    /// Start of its rows below in [`Symbolic::below`] and [`Symbolic::relative`].
    pub below_at: usize,
    /// Range of its children in [`Symbolic::children`]; their update matrices are on top of the
    /// stack when the front is processed.
    pub children: (usize, usize),
}

impl Front {
    /// Side length of the update matrix, including padding.
    pub(crate) fn rest(&self) -> usize {
        self.stride - self.padded
    }
}

/// Symbolic factorisation.
#[derive(Debug, Clone, Default)]
pub(super) struct Symbolic {
    pub fronts: Vec<Front>,
    /// Fronts in processing order: children before parents, the last child on top of the stack.
    pub sequence: Vec<u32>,
    /// Children of all fronts, in processing order.
    pub children: Vec<u32>,
    /// Unknowns below the columns of each front, ascending.
    pub below: Vec<u32>,
    /// The same unknowns as local rows of the parent.
    pub relative: Vec<u32>,
    /// Position of each matrix entry in the panel of its front.
    pub places: Vec<u32>,
    /// Number of values in the factor, including padding.
    pub factor_length: usize,
    /// Largest number of values on the stack.
    pub stack_length: usize,
    /// Number of rows of the longest panel.
    pub longest: usize,
}

impl Symbolic {
    /// Analyses a pattern. The unknowns from `leading` on form the last front.
    pub(crate) fn new(pattern: &Pattern, leading: usize) -> Self {
        let (starts, rows, count) = (pattern.column_starts(), pattern.rows(), pattern.unknowns());
        let mut links = Vec::with_capacity(rows.len());
        for column in 0..count {
            let own = &rows[starts[column] as usize..starts[column + 1] as usize];
            let below = own.iter().filter(|row| **row as usize != column);
            links.extend(below.map(|&row| (row, column as u32)));
        }
        let earlier = Adjacency::from_links(count, links);
        let parents = parents(&earlier);
        let counts = counts(&earlier, &parents);
        let firsts = relaxed(&fundamental(&parents, &counts, leading), &parents, &counts, leading);
        let mut symbolic = Self {
            fronts: Vec::with_capacity(firsts.len()),
            places: Vec::with_capacity(rows.len()),
            ..Self::default()
        };
        let parents = symbolic.fronts(&firsts, pattern);
        symbolic.order_work(&parents);
        symbolic
    }

    /// Computes the rows and sizes of every front and the positions of the matrix entries; returns
    /// each front's parent.
    fn fronts(&mut self, firsts: &[usize], pattern: &Pattern) -> Vec<u32> {
        let (starts, rows, count) = (pattern.column_starts(), pattern.rows(), pattern.unknowns());
        let mut front_of = vec![0u32; count];
        let mut parents = vec![NONE; firsts.len()];
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); firsts.len()];
        let mut seen = vec![NONE; count];
        let mut local = vec![0u32; count];
        for (f, &first) in firsts.iter().enumerate() {
            let end = firsts.get(f + 1).copied().unwrap_or(count);
            front_of[first..end].fill(f as u32);
            let below_at = self.below.len();
            let own = &rows[starts[first] as usize..starts[end] as usize];
            self.append_below(own, &children[f], |row| {
                let row = row as usize;
                row >= end && std::mem::replace(&mut seen[row], f as u32) != f as u32
            });
            let (columns, below) = (end - first, self.below.len() - below_at);
            let padded = columns.next_multiple_of(LANES);
            let stride = padded + below.next_multiple_of(LANES);
            (first..end).zip(0u32..).for_each(|(row, at)| local[row] = at);
            let numbered = self.below[below_at..].iter().zip(padded as u32..);
            numbered.for_each(|(&row, at)| local[row as usize] = at);
            for column in first..end {
                let own = &rows[starts[column] as usize..starts[column + 1] as usize];
                let at = ((column - first) * stride) as u32;
                self.places.extend(own.iter().map(|&row| at + local[row as usize]));
            }
            // rows of the children as local rows of this front
            self.relative.resize(self.below.len(), 0);
            for &child in &children[f] {
                let child = &self.fronts[child as usize];
                for at in child.below_at..child.below_at + child.below {
                    self.relative[at] = local[self.below[at] as usize];
                }
            }
            if let Some(&next) = self.below.get(below_at) {
                // the parent front is not built yet, but first columns are sorted, so look it up
                let parent = firsts.partition_point(|&first| first <= next as usize) - 1;
                parents[f] = parent as u32;
                children[parent].push(f as u32);
            }
            self.fronts.push(Front {
                first,
                columns,
                padded,
                below,
                stride,
                panel: self.factor_length,
                below_at,
                children: (0, 0),
            });
            self.factor_length += columns * stride;
            self.longest = self.longest.max(stride);
        }
        parents
    }

    /// Appends the rows of a front below its own columns, sorted: those of the columns (`own`) and of
    /// its children that `is_new` accepts.
    fn append_below(&mut self, own: &[u32], children: &[u32], mut is_new: impl FnMut(u32) -> bool) {
        let start = self.below.len();
        self.below.extend(own.iter().copied().filter(|&row| is_new(row)));
        for &child in children {
            let child = &self.fronts[child as usize];
            for at in child.below_at..child.below_at + child.below {
                let row = self.below[at];
                if is_new(row) {
                    self.below.push(row);
                }
            }
        }
        self.below[start..].sort_unstable();
    }

    /// Computes the processing order and the stack size that it needs.
    fn order_work(&mut self, parents: &[u32]) {
        let rests: Vec<u32> = self.fronts.iter().map(|f| f.rest() as u32).collect();
        self.sequence = postorder(parents, &rests);
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); parents.len()];
        let mut top = 0;
        for &f in &self.sequence {
            let own = &children[f as usize];
            let at = self.children.len();
            self.children.extend(own);
            let front = &mut self.fronts[f as usize];
            front.children = (at, self.children.len());
            let size = front.rest().pow(2);
            self.stack_length = self.stack_length.max(top + size);
            let waiting: usize = own.iter().map(|&c| self.fronts[c as usize].rest().pow(2)).sum();
            top = top + size - waiting;
            if let Some(list) = children.get_mut(parents[f as usize] as usize) {
                list.push(f);
            }
        }
    }

    /// Floating-point operations: the sum of the squared column counts, including zeros of merged
    /// columns but not padding.
    pub(crate) fn flops(&self) -> f64 {
        let of = |f: &Front| -> f64 {
            (0..f.columns).map(|j| ((f.columns + f.below - j) as f64).powi(2)).sum()
        };
        self.fronts.iter().map(of).sum()
    }
}

/// First columns of the fundamental supernodes (sets of neighbouring columns with one pattern).
fn fundamental(parents: &[u32], counts: &[u32], leading: usize) -> Vec<usize> {
    let begins = |j: usize| {
        let continues = j > 0 && parents[j - 1] as usize == j && counts[j - 1] == counts[j] + 1;
        j == leading || (j < leading && !continues)
    };
    (0..parents.len()).filter(|&j| begins(j)).collect()
}

/// Merges narrow supernodes with the one that follows if this adds few zeros, which gives fewer and
/// larger fronts.
///
/// Uses the rule of CHOLMOD (Chen, Davis, Hager, Rajamanickam 2008), which limits the share of
/// zeros by the number of columns after merging.
fn relaxed(firsts: &[usize], parents: &[u32], counts: &[u32], leading: usize) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::with_capacity(firsts.len());
    // columns, rows and zeros of the last supernode in `kept`
    let (mut columns, mut rows, mut zeros) = (0, 0, 0);
    let mut end = parents.len();
    for &first in firsts.iter().rev() {
        let (own, last) = (end - first, end - 1);
        let below = counts[last] as usize;
        let joined = kept.last().is_some_and(|&next| next == end && end < leading)
            && parents[last] as usize == end;
        let merged_columns = own + columns;
        let merged_zeros = zeros + own * (rows - below.min(rows));
        let entries = merged_columns * (own + rows) - merged_columns * (merged_columns - 1) / 2;
        let share = merged_zeros as f64 / entries.max(1) as f64;
        let few = match merged_columns {
            0..=4 => true,
            5..=16 => share < 0.8,
            17..=48 => share < 0.1,
            _ => share < 0.05,
        };
        if joined && few {
            kept.pop();
            (columns, rows, zeros) = (merged_columns, own + rows, merged_zeros);
        } else {
            (columns, rows, zeros) = (own, own + below, 0);
        }
        kept.push(first);
        end = first;
    }
    kept.reverse();
    kept
}
