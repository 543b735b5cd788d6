//! Tests of factor and sweeps against the original matrix.

use super::*;
use crate::sparse::graph::Adjacency;
use crate::sparse::ordering;
use proptest::prelude::*;

/// A positive definite matrix.
struct Matrix {
    pattern: Pattern,
    values: Vec<f64>,
}

/// Builds a positive definite matrix from links, via a dense one.
fn matrix(count: usize, links: &[(usize, usize, f64)]) -> Matrix {
    let mut dense = vec![vec![0.0; count]; count];
    for &(i, j, weight) in links.iter().filter(|l| l.0 != l.1) {
        dense[i.max(j)][i.min(j)] -= weight;
        dense[i][i] += weight;
        dense[j][j] += weight;
    }
    (0..count).for_each(|i| dense[i][i] += 0.1);
    let (mut pairs, mut values) = (Vec::new(), Vec::new());
    for j in 0..count {
        for (i, row) in dense.iter().enumerate().skip(j) {
            if row[j] != 0.0 {
                pairs.push([i as u32, j as u32]);
                values.push(row[j]);
            }
        }
    }
    Matrix { pattern: Pattern::new(count, pairs.into_iter()), values }
}

/// Largest `|A x - b|_i / (sqrt(a_ii) sum_j sqrt(a_jj) |x_j| + |b_i|)` for `L L^T x = b` with `b`
/// in the last unknowns. Cholesky's method has `|dA| <= gamma |L| |L^T|`, and `(|L| |L^T|)_ij` is
/// at most `sqrt(a_ii a_jj)` (Higham, Accuracy and Stability, theorem 10.3).
fn backward_error(matrix: &Matrix, nodes: usize, patterns: usize) -> f64 {
    let Matrix { pattern, values } = matrix;
    let (starts, rows, count) = (pattern.column_starts(), pattern.rows(), pattern.unknowns());
    let cholesky = Multifrontal::new(pattern, nodes);
    let mut numbers: Numbers = cholesky.numbers().unwrap();
    // values left by an earlier run must not matter
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
        // the first entry of a column is the diagonal
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
    #![proptest_config(fixtures::cases(256))]

    /// Any pattern, even without links, and any size of the last front.
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
        // gamma for at most 70 terms and the division
        prop_assert!(error < 72.0 * f64::EPSILON, "{error:e}");
    }
}

/// A grid like the models' meshes: fronts of many widths and several levels of children.
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
    let order = ordering::fill_reducing(&graph, &[]).unwrap();
    let mut links: Vec<(usize, usize, f64)> =
        links.iter().map(|l| (order[l.0] as usize, order[l.1] as usize, l.2)).collect();
    // an electrode on every side
    for k in 0..side {
        let ends = [k, k * side, (side - 1) * side + k, k * side + side - 1];
        let electrodes = ends.iter().zip(side * side..);
        links.extend(electrodes.map(|(&n, e)| (order[n] as usize, e, 0.5)));
    }
    let matrix = matrix(side * side + 4, &links);
    let cholesky = Multifrontal::new(&matrix.pattern, side * side);
    let widest = cholesky.symbolic.fronts.iter().map(|f| f.columns).max();
    assert!(widest > Some(16), "{widest:?}");
    let error = backward_error(&matrix, side * side, 15);
    // the longest sum has as many terms as the widest front has rows
    assert!(error < 72.0 * f64::EPSILON, "{error:e}");
}

#[test]
fn names_the_unknown_whose_pivot_fails() {
    let Matrix { pattern, mut values } = matrix(9, &[(0, 1, 1.0), (1, 2, 1.0), (2, 8, 1.0)]);
    let cholesky = Multifrontal::new(&pattern, 8);
    let mut numbers: Numbers = cholesky.numbers().unwrap();
    for (bad, unknown) in [(-1.0, 5), (f64::NAN, 5), (f64::INFINITY, 5), (0.0, 0), (-3.0, 8)] {
        let at = pattern.column_starts()[unknown] as usize;
        let kept = values[at];
        values[at] = bad;
        assert_eq!(cholesky.factorise(&values, &mut numbers, 1.0), Err(unknown));
        values[at] = kept;
        assert_eq!(cholesky.factorise(&values, &mut numbers, 1.0), Ok(()));
    }
}
