//! Sparse Cholesky with the electrodes eliminated last.
//!
//! Currents enter only at electrodes. With their unknowns at the end of the elimination order,
//! `L y = b` is zero on every node and needs no forward sweep, and the electrode potentials need
//! no sweep at all: they solve the dense trailing block, `L22 L22^T U = I` (at most one row per
//! electrode). So a frame of voltages costs one factorisation; fields inside the skin cost one
//! backward sweep for each independent pattern.
//!
//! Node ordering: approximate minimum degree (Amestoy, Davis, Duff 1996) by faer, on the nodes alone;
//! nested dissection where a mesh is large. Factorisation and sweeps: [`crate::cholesky`].

use crate::FemError;
use crate::assembly::{Adjacency, Assembly};
use crate::cholesky::{self, Cholesky, Numbers};
use crate::scalar::Scalar;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::triangular_solve;
use faer::prelude::*;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;
use faer::{MatMut, Par};

/// Elimination order of nodes that keeps the factor sparse: `new_from_old`. `positions_m`: their
/// places, or nothing.
pub(crate) fn order(graph: &Adjacency, positions_m: &[[f64; 3]]) -> Result<Vec<u32>, FemError> {
    cholesky::order(graph, positions_m, minimum_degree)
}

fn minimum_degree(graph: &Adjacency) -> Result<Vec<u32>, FemError> {
    let unknowns = graph.starts.len() - 1;
    let too_large = FemError::OutOfMemory { unknowns };
    let (mut old_from_new, mut new_from_old) = (vec![0u32; unknowns], vec![0u32; unknowns]);
    let pattern = SymbolicSparseColMatRef::<u32>::new_checked(
        unknowns,
        unknowns,
        &graph.starts,
        None,
        &graph.neighbours,
    );
    let scratch = amd::order_maybe_unsorted_scratch::<u32>(unknowns, graph.neighbours.len());
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| too_large.clone())?;
    amd::order_maybe_unsorted(
        &mut old_from_new,
        &mut new_from_old,
        pattern,
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .map_err(|_| too_large)?;
    Ok(new_from_old)
}

/// The symbolic factorisation of one pattern.
#[derive(Debug)]
pub(crate) struct Solver {
    cholesky: Cholesky,
    /// Unknowns of nodes; the rest are electrodes.
    nodes: usize,
    unknowns: usize,
}

/// Numeric memory of a [`Solver`]: matrix values, factor, scratch. Owned by the caller.
pub(crate) struct Factor<T = f64> {
    /// Values of the lower triangle.
    pub values: Vec<T>,
    numbers: Numbers<T>,
    /// Trailing block of the factor, electrodes only.
    trailing: Mat<T>,
}

impl<T: Scalar> Factor<T> {
    /// Numbers of matrix values, factor entries and entries of scratch memory.
    pub fn sizes(&self) -> (usize, usize, usize) {
        let (factor, stack) = self.numbers.sizes();
        (self.values.len(), factor, stack)
    }
}

impl Solver {
    /// Analyses the pattern; `nodes` unknowns come first, electrodes after them.
    pub fn new(assembly: &Assembly, nodes: usize) -> Self {
        let unknowns = assembly.column_starts.len() - 1;
        let cholesky = Cholesky::new(&assembly.column_starts, &assembly.rows, nodes);
        Self { cholesky, nodes, unknowns }
    }

    /// Values of the factor, zeros inside fronts and padding included.
    pub fn factor_entries(&self) -> usize {
        self.cholesky.factor_entries()
    }

    /// Floating point operations of one factorisation: the sum over columns of the squared count.
    pub fn factor_flops(&self) -> f64 {
        self.cholesky.flops()
    }

    /// Values of scratch memory of one factorisation.
    pub fn scratch_entries(&self) -> usize {
        self.cholesky.stack_entries()
    }

    /// Memory for the numbers.
    pub fn factor<T: Scalar>(&self, assembly: &Assembly) -> Result<Factor<T>, FemError> {
        let electrodes = self.unknowns - self.nodes;
        Ok(Factor {
            values: vec![T::from(0.0); assembly.entry_count()],
            numbers: self.cholesky.numbers()?,
            trailing: Mat::zeros(electrodes, electrodes),
        })
    }

    /// Factorises the matrix whose values stand in `factor.values`. A pivot that is not in the half
    /// plane around `direction` (real numbers: above zero) is the error: its unknown.
    pub fn factorise<T: Scalar>(&self, factor: &mut Factor<T>, direction: T) -> Result<(), usize> {
        let Factor { values, numbers, trailing } = factor;
        self.cholesky.factorise(values, numbers, direction)?;
        self.cholesky.trailing(numbers, |i, j, value| trailing[(i, j)] = value);
        Ok(())
    }

    /// Largest `(|L| |L^T|)_ii / |a_ii|`: one for positive definite real matrices. The backward
    /// error of a solve without pivoting is at most this, times roundings (Higham, "Accuracy and
    /// Stability of Numerical Algorithms", 2nd ed., theorem 9.3).
    #[cfg(feature = "complex")]
    pub fn growth<T: Scalar>(&self, factor: &Factor<T>) -> f64 {
        self.cholesky.growth(&factor.values, &factor.numbers)
    }

    /// Electrode potentials for electrode currents, in place: `[electrode but ground, pattern]`.
    pub fn solve_electrodes<T: Scalar>(&self, factor: &Factor<T>, mut currents: MatMut<'_, T>) {
        let lower = factor.trailing.as_ref();
        triangular_solve::solve_lower_triangular_in_place(lower, currents.rb_mut(), Par::Seq);
        triangular_solve::solve_upper_triangular_in_place(
            lower.transpose(),
            currents.rb_mut(),
            Par::Seq,
        );
    }

    /// Potentials of all unknowns for electrode currents.
    ///
    /// `x` is [unknown, pattern], row-major with `patterns` columns, so that a gather of unknowns
    /// copies whole rows; on entry its electrode rows hold the currents, on exit all rows hold
    /// potentials. Cost: 2 flops per factor entry and pattern.
    pub fn solve_fields<T: Scalar>(&self, factor: &mut Factor<T>, x: &mut [T], patterns: usize) {
        let electrodes = &mut x[self.nodes * patterns..];
        let count = self.unknowns - self.nodes;
        let rows = MatMut::from_row_major_slice_mut(electrodes, count, patterns);
        let lower = factor.trailing.as_ref();
        triangular_solve::solve_lower_triangular_in_place(lower, rows, Par::Seq);
        self.cholesky.solve_back(&mut factor.numbers, x, patterns);
    }
}
