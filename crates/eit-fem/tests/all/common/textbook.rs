//! The textbook matrix of the complete electrode model, dense, and its solution. Shares no code with
//! the library.

use eit_mesh::{Electrode, Mesh};
use std::ops::{Add, Div, Mul, Sub};

/// Real, complex or rational numbers.
pub trait Number:
    Clone + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    fn of(x: f64) -> Self;
    /// Larger for better pivots.
    fn size(&self) -> f64;
}

impl Number for f64 {
    fn of(x: f64) -> Self {
        x
    }
    fn size(&self) -> f64 {
        self.abs()
    }
}

/// `[K + M/z, -m/z; -m^T/z, length/z]` of all node and electrode potentials: gradients of hat
/// functions from edge normals, masses of edges. `admittance` is 1/z of each electrode.
pub fn matrix<T: Number>(mesh: &Mesh, sheet: &[T], admittance: &[T]) -> Vec<Vec<T>> {
    let nodes = mesh.surface().nodes();
    let size = nodes.len() + admittance.len();
    let mut a = vec![vec![T::of(0.0); size]; size];
    let mut add = |i: usize, j: usize, value: T| a[i][j] = a[i][j].clone() + value;
    for (triangle, sheet) in mesh.surface().triangles().iter().zip(sheet) {
        let triangle = triangle.map(|n| n as usize);
        let place = |k: usize, c: usize| T::of(nodes[triangle[k % 3]][c]);
        // gradient of hat function k times twice the area: the opposite edge, rotated
        let opposite = |k: usize| [0, 1].map(|c| place(k + 2, c) - place(k + 1, c));
        let ([p, q], [r, s]) = (opposite(0), opposite(1));
        let quadruple = T::of(2.0) * (p * s - q * r);
        for k in 0..3 {
            for l in 0..3 {
                let ([p, q], [r, s]) = (opposite(k), opposite(l));
                add(triangle[k], triangle[l], sheet.clone() * (p * r + q * s) / quadruple.clone());
            }
        }
    }
    for (l, (electrode, admittance)) in mesh.electrodes().iter().zip(admittance).enumerate() {
        let Electrode::Rim(edges) = electrode else { panic!("rim electrodes") };
        let own = nodes.len() + l;
        for edge in edges {
            let [i, j] = edge.map(|n| n as usize);
            // of an edge along an axis this is exact
            let length = (nodes[i][0] - nodes[j][0]).hypot(nodes[i][1] - nodes[j][1]);
            let of = |share: f64| T::of(length) * admittance.clone() / T::of(share);
            for (k, m, share) in [(i, i, 3.0), (j, j, 3.0), (i, j, 6.0), (j, i, 6.0)] {
                add(k, m, of(share));
            }
            for k in [i, j] {
                add(k, own, of(-2.0));
                add(own, k, of(-2.0));
            }
            add(own, own, of(1.0));
        }
    }
    a
}

/// The matrix without its last unknown, which is at zero.
pub fn grounded<T>(mut a: Vec<Vec<T>>) -> Vec<Vec<T>> {
    a.pop();
    a.iter_mut().for_each(|row| _ = row.pop());
    a
}

/// Solves `a x = f` for each row of `f`, by Gaussian elimination with row exchanges; unknowns before
/// `from` are not computed.
pub fn solve<T: Number>(mut a: Vec<Vec<T>>, f: &[Vec<T>], from: usize) -> Vec<Vec<T>> {
    let n = a.len();
    for (i, row) in a.iter_mut().enumerate() {
        row.extend(f.iter().map(|f| f[i].clone()));
    }
    for k in 0..n {
        let best = (k..n).rev().max_by(|&i, &j| a[i][k].size().total_cmp(&a[j][k].size())).unwrap();
        a.swap(k, best);
        let (done, rest) = a.split_at_mut(k + 1);
        for row in rest.iter_mut().filter(|row| row[k].size() > 0.0) {
            let factor = row[k].clone() / done[k][k].clone();
            for j in (k..n + f.len()).filter(|j| done[k][*j].size() > 0.0) {
                row[j] = row[j].clone() - factor.clone() * done[k][j].clone();
            }
        }
    }
    let solved = (n..n + f.len()).map(|column| {
        let mut x = vec![T::of(0.0); n];
        for k in (from..n).rev() {
            let known = (k + 1..n).map(|j| a[k][j].clone() * x[j].clone());
            x[k] = known.fold(a[k][column].clone(), |rest, term| rest - term) / a[k][k].clone();
        }
        x
    });
    solved.collect()
}
