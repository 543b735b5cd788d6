//! faer's sparse Cholesky factorisation of a model's matrix, for comparison with ours.

use crate::Result;
use eit_fem::SystemMatrix;
use eit_fem::sparse::Pattern;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par, Side, Spec};

/// Number of columns that scratch memory allows: one for each independent pattern of 16 electrodes.
pub const COLUMNS: usize = 15;

/// The elimination order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// faer's approximate minimum degree order.
    Own,
    /// The order of the unknowns in the model.
    Given,
}

/// A factorisation with all its memory; like ours, it allocates nothing after the set-up.
pub struct FaerCholesky {
    pattern: SymbolicSparseColMat<u32>,
    symbolic: SymbolicCholesky<u32>,
    factor: Vec<f64>,
    memory: MemBuffer,
}

impl FaerCholesky {
    /// Analyses the sparsity pattern of a matrix.
    ///
    /// # Errors
    /// Insufficient memory.
    pub fn new(matrix: &SystemMatrix, order: Order) -> Result<Self> {
        let pattern = lower_triangle(&matrix.pattern);
        // not `SymmetricOrdering::Identity`: with it, the simplicial factorisation of faer 0.24
        // reads the triangle that is not stored
        let unknowns = matrix.pattern.unknowns();
        let (forward, inverse): (Vec<u32>, Vec<u32>) = (0..unknowns as u32).map(|k| (k, k)).unzip();
        let order = match order {
            Order::Own => SymmetricOrdering::Amd,
            Order::Given => {
                SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, unknowns))
            }
        };
        let settings = CholeskySymbolicParams::default();
        let symbolic = factorize_symbolic_cholesky(pattern.as_ref(), Side::Lower, order, settings)?;
        let factorise = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        let solve = symbolic.solve_in_place_scratch::<f64>(COLUMNS, Par::Seq);
        let memory = MemBuffer::try_new(factorise.or(solve)).map_err(|_| "out of memory")?;
        Ok(Self { factor: vec![0.0; symbolic.len_val()], pattern, symbolic, memory })
    }

    /// Whether faer chose a supernodal factorisation.
    pub fn is_supernodal(&self) -> bool {
        matches!(self.symbolic.raw(), SymbolicCholeskyRaw::Supernodal(_))
    }

    /// Number of entries in the factor.
    pub fn factor_entries(&self) -> usize {
        self.factor.len()
    }

    /// Factorises the matrix with these values, one per entry of the pattern.
    ///
    /// # Errors
    /// A pivot that is not positive.
    pub fn factorise(&mut self, values: &[f64]) -> Result<()> {
        let matrix = SparseColMatRef::new(self.pattern.as_ref(), values);
        let stack = MemStack::new(&mut self.memory);
        self.symbolic
            .factorize_numeric_llt(
                &mut self.factor,
                matrix,
                Side::Lower,
                faer::linalg::cholesky::llt::factor::LltRegularization::default(),
                Par::Seq,
                stack,
                Spec::default(),
            )
            .map_err(|error| format!("{error:?}"))?;
        Ok(())
    }

    /// Solves in place, `[unknown, column]`, for at most [`COLUMNS`] columns.
    pub fn solve(&mut self, x: MatMut<'_, f64>) {
        let stack = MemStack::new(&mut self.memory);
        let factor = LltRef::new(&self.symbolic, &self.factor);
        factor.solve_in_place_with_conj(Conj::No, x, Par::Seq, stack);
    }
}

fn lower_triangle(pattern: &Pattern) -> SymbolicSparseColMat<u32> {
    let unknowns = pattern.unknowns();
    let starts = pattern.column_starts().to_vec();
    SymbolicSparseColMat::new_checked(unknowns, unknowns, starts, None, pattern.rows().to_vec())
}
