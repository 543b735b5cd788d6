//! Sparse Cholesky factorisation of one pattern again and again: multifrontal, on memory that the
//! caller owns.
//!
//! Columns with one pattern are eliminated together in a dense front (Duff and Reid 1983; Liu 1992):
//! matrix entries and what the children left are added up, the front's columns are eliminated, the
//! rest waits on a stack for the parent. All places are known from the pattern ([`symbolic`]), so
//! that a factorisation is additions to known places and dense tiles ([`front`]), and allocates
//! nothing. Meshes of the plane have small fronts (at 2 000 nodes 540 of them, in the mean four
//! columns and eleven rows below), where a general dense library spends more time on calls than on
//! arithmetic.
//!
//! Floor: one fused operation per two flops. At 20 000 nodes (79 MFLOP) a factorisation reaches 9 of
//! the 33 GFLOP/s of a dense product on the same core, at 2 000 (2.3 MFLOP) 7. The rest goes into
//! additions to scattered places (one for each value that a child leaves: 1.3 million at 20 000
//! nodes), the zeros of panels, and short tiles.
//!
//! The unknowns from `nodes` on are one front, the last: its factor is the trailing block.
//!
//! Numbers are real or complex; complex matrices are symmetric, not Hermitian: nothing is conjugated.
//!
//! Rounding is that of Cholesky's method in any order of its sums; the result is the same for any
//! number of threads, and may differ in the last bits between machines with and without fused
//! multiplication and addition.

mod dissection;
mod front;
mod symbolic;

use crate::FemError;
use crate::assembly::Adjacency;
use crate::scalar::Scalar;
use pulp::{Arch, Simd, WithSimd};
use symbolic::{LANES, Symbolic};

/// Nodes from which on nested dissection is tried: below, minimum degree needs less.
const LARGE: usize = 4_000;

/// Elimination order of nodes, `new_from_old`: by `minimum_degree`, or by nested dissection with it
/// where the mesh is large, its nodes have places and that takes less work.
pub(crate) fn order<E>(
    graph: &Adjacency,
    positions_m: &[[f64; 3]],
    minimum_degree: impl Fn(&Adjacency) -> Result<Vec<u32>, E>,
) -> Result<Vec<u32>, E> {
    let (whole, flops) = symbolic::postordered(graph, &minimum_degree(graph)?);
    let count = graph.starts.len() - 1;
    if count < LARGE || positions_m.len() != count {
        return Ok(whole);
    }
    let dissected = dissection::order(graph, positions_m, minimum_degree)?;
    let (dissected, dissected_flops) = symbolic::postordered(graph, &dissected);
    Ok(if dissected_flops < flops { dissected } else { whole })
}

/// The symbolic factorisation of one pattern.
#[derive(Debug)]
pub(crate) struct Cholesky {
    symbolic: Symbolic,
    starts: Vec<u32>,
    nodes: usize,
    arch: Arch,
}

/// Numbers of a factorisation, owned by the caller.
pub(crate) struct Numbers<T = f64> {
    factor: Vec<T>,
    stack: Vec<T>,
    /// Local rows of one front in a sweep.
    rows: Vec<T>,
}

impl<T> Numbers<T> {
    /// Lengths of factor and stack: what a factorisation relies on.
    pub fn sizes(&self) -> (usize, usize) {
        (self.factor.len(), self.stack.len())
    }
}

impl Cholesky {
    /// Analyses a lower triangle by columns (`starts`, `rows`, ascending).
    pub fn new(starts: &[u32], rows: &[u32], nodes: usize) -> Self {
        let symbolic = Symbolic::new(starts, rows, nodes);
        Self { symbolic, starts: starts.to_vec(), nodes, arch: Arch::new() }
    }

    /// Values of the factor, zeros inside fronts and padding included.
    pub fn factor_entries(&self) -> usize {
        self.symbolic.factor_length
    }

    /// Floating point operations of one factorisation.
    pub fn flops(&self) -> f64 {
        self.symbolic.flops()
    }

    /// Values on the stack of one factorisation.
    pub fn stack_entries(&self) -> usize {
        self.symbolic.stack_length
    }

    /// Memory for the numbers.
    ///
    /// # Errors
    /// [`FemError::OutOfMemory`].
    pub fn numbers<T: Scalar>(&self) -> Result<Numbers<T>, FemError> {
        let unknowns = self.starts.len() - 1;
        let zeros = |length: usize| -> Result<Vec<T>, FemError> {
            let mut values = Vec::new();
            let reserved = values.try_reserve_exact(length);
            reserved.map_err(|_| FemError::OutOfMemory { unknowns })?;
            values.resize(length, T::from(0.0));
            Ok(values)
        };
        Ok(Numbers {
            factor: zeros(self.symbolic.factor_length)?,
            stack: zeros(self.symbolic.stack_length)?,
            rows: Vec::new(),
        })
    }

    /// `A = L L^T` of the matrix with these values, without conjugates and without pivoting; the
    /// unknown whose pivot is not finite or not in the half plane around `direction` (real numbers:
    /// above zero) is the error.
    pub fn factorise<T: Scalar>(
        &self,
        values: &[T],
        numbers: &mut Numbers<T>,
        direction: T,
    ) -> Result<(), usize> {
        self.arch.dispatch(Factorise { cholesky: self, values, numbers, direction })
    }

    /// Largest `(|L| |L^T|)_ii / |a_ii|`.
    #[cfg(feature = "complex")]
    pub fn growth<T: Scalar>(&self, values: &[T], numbers: &Numbers<T>) -> f64 {
        let mut sums = vec![0.0; self.starts.len() - 1];
        for front in &self.symbolic.fronts {
            let below = &self.symbolic.below[front.below_at..][..front.below];
            let panel = &numbers.factor[front.panel..][..front.columns * front.stride];
            for (j, column) in panel.chunks_exact(front.stride).enumerate() {
                for i in j..front.columns {
                    sums[front.first + i] += column[i].modulus().powi(2);
                }
                for (&row, l) in below.iter().zip(&column[front.padded..]) {
                    sums[row as usize] += l.modulus().powi(2);
                }
            }
        }
        // rows ascend within a column of the lower triangle: its first entry is the diagonal
        let diagonal = self.starts.iter().map(|&k| k as usize);
        let ratios = sums.iter().zip(diagonal).map(|(sum, k)| sum / values[k].modulus());
        ratios.fold(0.0, f64::max)
    }

    /// The factor of the unknowns from `nodes` on: calls with (row, column, value), counted from
    /// there.
    pub fn trailing<T: Scalar>(&self, numbers: &Numbers<T>, mut take: impl FnMut(usize, usize, T)) {
        let Some(front) = self.symbolic.fronts.last() else { return };
        let panel = &numbers.factor[front.panel..][..front.columns * front.stride];
        for (j, column) in panel.chunks_exact(front.stride).enumerate() {
            (j..front.columns).for_each(|i| take(i, j, column[i]));
        }
    }

    /// `L^T x = y` in place, `x` [unknown, right-hand side] with `count` columns, where `y` is zero
    /// for the unknowns before `nodes`. Memory for rows grows at the first call.
    pub fn solve_back<T: Scalar>(&self, numbers: &mut Numbers<T>, x: &mut [T], count: usize) {
        let lanes = count.next_multiple_of(LANES);
        let length = self.symbolic.longest * lanes;
        if numbers.rows.len() < length {
            numbers.rows.resize(length, T::from(0.0));
        }
        x[..self.nodes * count].fill(T::from(0.0));
        self.arch.dispatch(SolveBack { cholesky: self, numbers, x, count, lanes });
    }
}

struct Factorise<'a, T> {
    cholesky: &'a Cholesky,
    values: &'a [T],
    numbers: &'a mut Numbers<T>,
    direction: T,
}

impl<T: Scalar> WithSimd for Factorise<'_, T> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { cholesky: Cholesky { symbolic, starts, .. }, values, numbers, direction } = self;
        let Numbers { factor, stack, .. } = numbers;
        let mut top = 0;
        for &f in &symbolic.sequence {
            let node = &symbolic.fronts[f as usize];
            let stride = node.stride;
            let panel = &mut factor[node.panel..][..node.columns * stride];
            panel.fill(T::from(0.0));
            let from = starts[node.first] as usize;
            let to = starts[node.first + node.columns] as usize;
            for (&place, &value) in symbolic.places[from..to].iter().zip(&values[from..to]) {
                panel[place as usize] = value;
            }
            let (waiting, free) = stack.split_at_mut(top);
            let side = node.rest();
            let rest = &mut free[..side * side];
            let mut base = top;
            let children = &symbolic.children[node.children.0..node.children.1];
            if !children.is_empty() {
                front::clear(rest, side);
            }
            for &child in children.iter().rev() {
                let child = &symbolic.fronts[child as usize];
                let child_side = child.rest();
                base -= child_side * child_side;
                let places = &symbolic.relative[child.below_at..][..child.below];
                let left = &waiting[base..][..child_side * child_side];
                let (panel, rest) = ((&mut *panel, stride), (&mut *rest, node.padded));
                front::add_child(left, child_side, places, panel, rest);
            }
            front::eliminate(panel, node.columns, stride, direction)
                .map_err(|column| node.first + column)?;
            if children.is_empty() {
                front::subtract::<T, true>(panel, node.padded, stride, rest);
            } else {
                front::subtract::<T, false>(panel, node.padded, stride, rest);
            }
            if base < top {
                stack.copy_within(top..top + side * side, base);
            }
            top = base + side * side;
        }
        Ok(())
    }
}

struct SolveBack<'a, T> {
    cholesky: &'a Cholesky,
    numbers: &'a mut Numbers<T>,
    x: &'a mut [T],
    count: usize,
    lanes: usize,
}

impl<T: Scalar> WithSimd for SolveBack<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { cholesky: Cholesky { symbolic, .. }, numbers, x, count, lanes } = self;
        let Numbers { factor, rows, .. } = numbers;
        for node in symbolic.fronts.iter().rev() {
            let (columns, stride) = (node.columns, node.stride);
            let rows = &mut rows[..stride * lanes];
            let own = &x[node.first * count..][..columns * count];
            copy_rows(own, count, rows, lanes);
            let below = &symbolic.below[node.below_at..][..node.below];
            // a padding row times zero must be zero, whatever an earlier solve left there
            rows[columns * lanes..node.padded * lanes].fill(T::from(0.0));
            rows[(node.padded + node.below) * lanes..].fill(T::from(0.0));
            let local = rows[node.padded * lanes..].chunks_exact_mut(lanes);
            for (row, &unknown) in local.zip(below) {
                row[..count].copy_from_slice(&x[unknown as usize * count..][..count]);
            }
            let panel = &factor[node.panel..][..columns * stride];
            front::sweep_back(panel, columns, stride, rows, lanes);
            let own = &mut x[node.first * count..][..columns * count];
            copy_rows(rows, lanes, own, count);
        }
    }
}

/// Copies rows of one width to rows of another, as much as fits both.
#[inline(always)]
fn copy_rows<T: Scalar>(from: &[T], from_width: usize, to: &mut [T], to_width: usize) {
    let width = from_width.min(to_width);
    for (to, from) in to.chunks_exact_mut(to_width).zip(from.chunks_exact(from_width)) {
        to[..width].copy_from_slice(&from[..width]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Lower triangle by columns of a positive definite matrix on the links, dense beside it.
    fn matrix(count: usize, links: &[(usize, usize, f64)]) -> (Vec<u32>, Vec<u32>, Vec<f64>) {
        let mut dense = vec![vec![0.0; count]; count];
        for &(i, j, weight) in links.iter().filter(|l| l.0 != l.1) {
            dense[i.max(j)][i.min(j)] -= weight;
            dense[i][i] += weight;
            dense[j][j] += weight;
        }
        (0..count).for_each(|i| dense[i][i] += 0.1);
        let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for j in 0..count {
            for (i, row) in dense.iter().enumerate().skip(j) {
                if row[j] != 0.0 {
                    rows.push(i as u32);
                    values.push(row[j]);
                }
            }
            starts.push(rows.len() as u32);
        }
        (starts, rows, values)
    }

    /// `|A x - b|_i` over `sqrt(a_ii) sum_j sqrt(a_jj) |x_j| + |b_i|`, at most, for `L L^T x = b` with
    /// `b` in the last unknowns: Cholesky's method has `|dA| <= gamma |L| |L^T|`, and
    /// `(|L| |L^T|)_ij` is at most `sqrt(a_ii a_jj)` (Higham, Accuracy and Stability, theorem 10.3).
    fn backward_error(
        (starts, rows, values): &(Vec<u32>, Vec<u32>, Vec<f64>),
        nodes: usize,
        patterns: usize,
    ) -> f64 {
        let count = starts.len() - 1;
        let cholesky = Cholesky::new(starts, rows, nodes);
        let mut numbers: Numbers = cholesky.numbers().unwrap();
        // what an earlier run left must not matter
        numbers.factor.fill(f64::NAN);
        numbers.stack.fill(f64::NAN);
        cholesky.factorise(values, &mut numbers, 1.0).unwrap();
        let trailing = count - nodes;
        let mut lower = vec![vec![0.0; trailing]; trailing];
        cholesky.trailing(&numbers, |i, j, value| lower[i][j] = value);
        let mut x = vec![f64::NAN; count * patterns];
        let currents = |p: usize, k: usize| ((3 * p + 5 * k) % 7) as f64 - 3.0;
        for p in 0..patterns {
            let mut y: Vec<f64> = (0..trailing).map(|k| currents(p, k)).collect();
            for k in 0..trailing {
                let sum: f64 = (0..k).map(|j| lower[k][j] * y[j]).sum();
                y[k] = (y[k] - sum) / lower[k][k];
                x[(nodes + k) * patterns + p] = y[k];
            }
        }
        numbers.rows = vec![f64::NAN; cholesky.symbolic.longest * patterns.next_multiple_of(LANES)];
        cholesky.solve_back(&mut numbers, &mut x, patterns);
        let mut worst = 0.0_f64;
        for p in 0..patterns {
            let mut product = vec![0.0; count];
            for j in 0..count {
                for at in starts[j] as usize..starts[j + 1] as usize {
                    let (i, value) = (rows[at] as usize, values[at]);
                    let ends = if i == j { &[(i, j)][..] } else { &[(i, j), (j, i)] };
                    for &(to, from) in ends {
                        product[to] += value * x[from * patterns + p];
                    }
                }
            }
            // the diagonal is the first entry of a column
            let root = |i: usize| values[starts[i] as usize].sqrt();
            let sum: f64 = (0..count).map(|j| root(j) * x[j * patterns + p].abs()).sum();
            for (i, product) in product.iter().enumerate() {
                let b = if i < nodes { 0.0 } else { currents(p, i - nodes) };
                let size = root(i) * sum + b.abs();
                worst = worst.max((product - b).abs() / size.max(f64::MIN_POSITIVE));
            }
        }
        worst
    }

    proptest! {
        /// Any pattern, also without links at all, any place of the last front.
        #[test]
        fn solves_random_patterns(
            count in 2usize..70,
            links in proptest::collection::vec((0usize..1000, 0usize..1000, 0.1f64..10.0), 0..200),
            share in 0.0f64..1.0,
            patterns in 1usize..18,
        ) {
            let links: Vec<_> = links.iter().map(|l| (l.0 % count, l.1 % count, l.2)).collect();
            let nodes = ((count - 1) as f64 * share) as usize;
            let error = backward_error(&matrix(count, &links), nodes, patterns);
            // gamma of at most 70 terms and the division
            prop_assert!(error < 72.0 * f64::EPSILON, "{error:e}");
        }
    }

    /// A mesh as the models have them: fronts of all widths, several levels of children.
    #[test]
    fn solves_a_grid_in_its_postorder() {
        let side = 40;
        let mut links = Vec::new();
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            let at = |i: usize, j: usize| i * side + j;
            [(i + 1, j), (i, j + 1), (i + 1, j + 1)]
                .into_iter()
                .filter(|(k, l)| *k < side && *l < side)
                .for_each(|(k, l)| links.push((at(i, j), at(k, l), 1.0 + (i % 3) as f64)));
        }
        let both = links.iter().flat_map(|l| [(l.0 as u32, l.1 as u32), (l.1 as u32, l.0 as u32)]);
        let graph = Adjacency::from_links(side * side, both.collect());
        let order = crate::solver::order(&graph, &[]).unwrap();
        let mut links: Vec<(usize, usize, f64)> =
            links.iter().map(|l| (order[l.0] as usize, order[l.1] as usize, l.2)).collect();
        // an electrode on every side
        for k in 0..side {
            let ends = [k, k * side, (side - 1) * side + k, k * side + side - 1];
            let electrodes = ends.iter().zip(side * side..);
            links.extend(electrodes.map(|(&n, e)| (order[n] as usize, e, 0.5)));
        }
        let matrix = matrix(side * side + 4, &links);
        let cholesky = Cholesky::new(&matrix.0, &matrix.1, side * side);
        let widest = cholesky.symbolic.fronts.iter().map(|f| f.columns).max();
        assert!(widest > Some(16), "{widest:?}");
        let error = backward_error(&matrix, side * side, 15);
        // the longest sum: rows of the widest front
        assert!(error < 72.0 * f64::EPSILON, "{error:e}");
    }

    /// A square grid of 200 x 200 nodes: dissection must number every node once, and take less work
    /// than minimum degree (which is why it is there).
    #[test]
    fn large_meshes_are_dissected() {
        let side = 200;
        let at = |i: usize, j: usize| (i * side + j) as u32;
        let mut links = Vec::new();
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            let next = [(i + 1, j), (i, j + 1), (i + 1, j + 1)].into_iter();
            for (k, l) in next.filter(|(k, l)| *k < side && *l < side) {
                links.extend([(at(i, j), at(k, l)), (at(k, l), at(i, j))]);
            }
        }
        let graph = Adjacency::from_links(side * side, links);
        let places = (0..side).flat_map(|i| (0..side).map(move |j| [i as f64, 0.1, j as f64]));
        let places: Vec<[f64; 3]> = places.collect();
        let flops = |order: &[u32]| {
            let mut sorted = order.to_vec();
            sorted.sort_unstable();
            assert!(sorted.iter().zip(0..).all(|(a, b)| *a == b));
            symbolic::postordered(&graph, order).1
        };
        let dissected = crate::solver::order(&graph, &places).unwrap();
        let whole = crate::solver::order(&graph, &[]).unwrap();
        assert!(flops(&dissected) < flops(&whole), "{} {}", flops(&dissected), flops(&whole));
        // all nodes in one place: nothing to cut along, still an order
        let order = crate::solver::order(&graph, &vec![[0.5; 3]; side * side]).unwrap();
        flops(&order);
    }

    #[test]
    fn names_the_unknown_whose_pivot_fails() {
        let (starts, rows, mut values) = matrix(9, &[(0, 1, 1.0), (1, 2, 1.0), (2, 8, 1.0)]);
        let cholesky = Cholesky::new(&starts, &rows, 8);
        let mut numbers: Numbers = cholesky.numbers().unwrap();
        for (bad, unknown) in [(-1.0, 5), (f64::NAN, 5), (f64::INFINITY, 5), (0.0, 0), (-3.0, 8)] {
            let (at, kept) = (starts[unknown] as usize, values[starts[unknown] as usize]);
            values[at] = bad;
            assert_eq!(cholesky.factorise(&values, &mut numbers, 1.0), Err(unknown));
            values[at] = kept;
            assert_eq!(cholesky.factorise(&values, &mut numbers, 1.0), Ok(()));
        }
    }
}
