//! Sparse Cholesky with the electrodes eliminated last.
//!
//! Currents enter only at electrodes. With their unknowns at the end of the elimination order,
//! `L y = b` is zero on every node and needs no forward sweep, and the electrode potentials need
//! no sweep at all: they solve the dense trailing block, `L22 L22^T U = I` (at most one row per
//! electrode). So a frame of voltages costs one factorisation; fields inside the skin cost one
//! backward sweep for each independent pattern.
//!
//! Node ordering: approximate minimum degree (Amestoy, Davis, Duff 1996) on the nodes alone.
//! Factorisation: supernodal, by faer, on memory the caller owns.

use crate::FemError;
use crate::assembly::{Adjacency, Assembly};
use crate::scalar::Scalar;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::linalg::triangular_solve;
use faer::prelude::*;
use faer::sparse::linalg::cholesky::{self, supernodal};
use faer::sparse::linalg::{SupernodalThreshold, amd};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Accum, MatMut, MatRef, Par, Side};

/// Elimination order of nodes that keeps the factor sparse: `new_from_old`.
pub(crate) fn order(graph: &Adjacency) -> Result<Vec<u32>, FemError> {
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

impl<T> Factor<T> {
    /// Numbers of matrix values and factor entries, and bytes of scratch memory.
    pub fn sizes(&self) -> (usize, usize, usize) {
        (self.values.len(), self.factor.len(), self.scratch_bytes)
    }
}

/// The symbolic factorisation of one pattern.
#[derive(Debug)]
pub(crate) struct Solver {
    /// Supernodes; the pattern serves real and complex numbers.
    pub symbolic: cholesky::SymbolicCholesky<u32>,
    /// Scratch memory of one factorisation.
    scratch: StackReq,
    /// Unknowns of nodes; the rest are electrodes.
    nodes: usize,
    unknowns: usize,
}

/// Numeric memory of a [`Solver`]: matrix values, factor, scratch. Owned by the caller.
pub(crate) struct Factor<T = f64> {
    /// Values of the lower triangle.
    pub values: Vec<T>,
    /// Values of the supernodes.
    pub factor: Vec<T>,
    memory: MemBuffer,
    scratch_bytes: usize,
    /// Trailing block of the factor, electrodes only.
    trailing: Mat<T>,
    gathered: Vec<T>,
}

impl Solver {
    /// Analyses the pattern; `nodes` unknowns come first, electrodes after them.
    pub fn new(assembly: &Assembly, nodes: usize) -> Result<Self, FemError> {
        let unknowns = assembly.column_starts.len() - 1;
        let full = full_pattern(assembly);
        let pattern = SymbolicSparseColMatRef::<u32>::new_checked(
            unknowns,
            unknowns,
            &full.starts,
            None,
            &full.neighbours,
        );
        let params = cholesky::CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let symbolic = cholesky::factorize_symbolic_cholesky(
            pattern,
            Side::Upper,
            cholesky::SymmetricOrdering::Identity,
            params,
        )
        .map_err(|_| FemError::OutOfMemory { unknowns })?;
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        Ok(Self { symbolic, scratch, nodes, unknowns })
    }

    /// Entries of the factor, zeros inside supernodes included.
    pub fn factor_entries(&self) -> usize {
        self.symbolic.len_val()
    }

    /// Floating point operations of one factorisation: the sum over columns of the squared count.
    pub fn factor_flops(&self) -> f64 {
        let cholesky::SymbolicCholeskyRaw::Supernodal(symbolic) = self.symbolic.raw() else {
            return 0.0;
        };
        (0..symbolic.n_supernodes())
            .map(|s| {
                let node = symbolic.supernode(s);
                let columns = symbolic.supernode_end()[s] as usize - node.start();
                let rows = columns + node.pattern().len();
                (0..columns).map(|j| ((rows - j) as f64).powi(2)).sum::<f64>()
            })
            .sum()
    }

    /// Bytes of scratch memory of one factorisation.
    pub fn scratch_bytes(&self) -> usize {
        self.scratch.unaligned_bytes_required()
    }

    /// Memory for the numbers of [`Solver::factorise`].
    pub fn factor(&self, assembly: &Assembly) -> Result<Factor, FemError> {
        self.factor_with(assembly, self.scratch)
    }

    /// Memory for the numbers of a factorisation that needs `scratch`.
    pub fn factor_with<T: Scalar>(
        &self,
        assembly: &Assembly,
        scratch: StackReq,
    ) -> Result<Factor<T>, FemError> {
        let electrodes = self.unknowns - self.nodes;
        let memory = MemBuffer::try_new(scratch)
            .map_err(|_| FemError::OutOfMemory { unknowns: self.unknowns })?;
        Ok(Factor {
            values: vec![T::from(0.0); assembly.entry_count()],
            factor: vec![T::from(0.0); self.symbolic.len_val()],
            memory,
            scratch_bytes: scratch.unaligned_bytes_required(),
            trailing: Mat::zeros(electrodes, electrodes),
            gathered: Vec::new(),
        })
    }

    /// Factorises the matrix whose values stand in `factor.values`.
    pub fn factorise(&self, assembly: &Assembly, factor: &mut Factor) -> Result<(), FemError> {
        let unknowns = self.unknowns;
        let pattern = SymbolicSparseColMatRef::<u32>::new_checked(
            unknowns,
            unknowns,
            &assembly.column_starts,
            None,
            &assembly.rows,
        );
        let matrix = SparseColMatRef::new(pattern, factor.values.as_slice());
        self.symbolic
            .factorize_numeric_llt(
                &mut factor.factor,
                matrix,
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut factor.memory),
                Default::default(),
            )
            .map_err(|e| {
                let LltError::NonPositivePivot { index } = e;
                FemError::NotPositiveDefinite { unknown: index, unknowns }
            })?;
        self.extract_trailing(factor);
        Ok(())
    }

    /// Values as supernodes.
    pub fn llt<'a, T>(
        &'a self,
        values: &'a [T],
    ) -> Option<supernodal::SupernodalLltRef<'a, u32, T>> {
        match self.symbolic.raw() {
            cholesky::SymbolicCholeskyRaw::Supernodal(s) => {
                Some(supernodal::SupernodalLltRef::new(s, values))
            }
            // never built: the threshold above forces supernodes
            cholesky::SymbolicCholeskyRaw::Simplicial(_) => None,
        }
    }

    /// Copies the electrodes' block out of the factor.
    pub fn extract_trailing<T: Scalar>(&self, factor: &mut Factor<T>) {
        let Some(llt) = self.llt(&factor.factor) else { return };
        let trailing = &mut factor.trailing;
        trailing.fill(T::from(0.0));
        for s in (0..llt.symbolic().n_supernodes()).rev() {
            let node = llt.supernode(s);
            let (start, values) = (node.start(), node.val());
            let columns = values.ncols();
            if start + columns <= self.nodes {
                break;
            }
            for j in self.nodes.saturating_sub(start)..columns {
                let column = start + j - self.nodes;
                for i in j..values.nrows() {
                    let row = match i.checked_sub(columns) {
                        None => start + i,
                        Some(k) => node.pattern()[k] as usize,
                    };
                    trailing[(row - self.nodes, column)] = values[(i, j)];
                }
            }
        }
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
        let (nodes, electrodes) = x.split_at_mut(self.nodes * patterns);
        nodes.fill(T::from(0.0));
        let count = self.unknowns - self.nodes;
        let rows = MatMut::from_row_major_slice_mut(electrodes, count, patterns);
        let lower = factor.trailing.as_ref();
        triangular_solve::solve_lower_triangular_in_place(lower, rows, Par::Seq);
        let Some(llt) = self.llt(&factor.factor) else { return };
        for s in (0..llt.symbolic().n_supernodes()).rev() {
            let node = llt.supernode(s);
            let columns = node.val().ncols();
            let (top, below) = node.val().split_at_row(columns);
            let gathered = &mut factor.gathered;
            gathered.clear();
            for &row in node.pattern() {
                let at = row as usize * patterns;
                gathered.extend_from_slice(&x[at..at + patterns]);
            }
            let at = node.start() * patterns;
            let own = &mut x[at..at + columns * patterns];
            backward_block(top, below, gathered, own, patterns);
        }
    }
}

/// `own = top^-T (own - below^T gathered)`, all row-major with `patterns` columns.
fn backward_block<T: Scalar>(
    top: MatRef<'_, T>,
    below: MatRef<'_, T>,
    gathered: &[T],
    own: &mut [T],
    patterns: usize,
) {
    let columns = top.ncols();
    let mut own = MatMut::from_row_major_slice_mut(own, columns, patterns);
    let gathered = MatRef::from_row_major_slice(gathered, below.nrows(), patterns);
    faer::linalg::matmul::matmul(
        own.rb_mut(),
        Accum::Add,
        below.transpose(),
        gathered,
        T::from(-1.0),
        Par::Seq,
    );
    triangular_solve::solve_upper_triangular_in_place(top.transpose(), own, Par::Seq);
}

/// Both triangles of the pattern: the symbolic analysis reads the upper one.
fn full_pattern(assembly: &Assembly) -> Adjacency {
    let unknowns = assembly.column_starts.len() - 1;
    let mut links = Vec::with_capacity(2 * assembly.rows.len());
    for column in 0..unknowns {
        let range = assembly.column_starts[column]..assembly.column_starts[column + 1];
        for &row in &assembly.rows[range.start as usize..range.end as usize] {
            links.push((column as u32, row));
            links.push((row, column as u32));
        }
    }
    links.sort_unstable();
    links.dedup();
    let mut starts = vec![0u32; unknowns + 1];
    links.iter().for_each(|l| starts[l.0 as usize + 1] += 1);
    (0..unknowns).for_each(|k| starts[k + 1] += starts[k]);
    Adjacency { starts, neighbours: links.into_iter().map(|l| l.1).collect() }
}
