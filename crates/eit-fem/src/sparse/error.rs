//! Errors of sparse factorisations.

/// Error of a sparse factorisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SparseError {
    /// The factor does not fit into memory or exceeds the index range.
    #[error("the factor of {unknowns} unknowns does not fit into memory")]
    OutOfMemory {
        /// Number of unknowns.
        unknowns: usize,
    },
    /// There are no trailing unknowns for right-hand sides.
    #[error(
        "{leading} of {unknowns} unknowns are leading ones without right-hand sides: at least one \
         trailing unknown is needed"
    )]
    NoTrailingUnknowns {
        /// Number of leading unknowns, which have no right-hand sides.
        leading: usize,
        /// Number of unknowns.
        unknowns: usize,
    },
    /// An array has the wrong length.
    #[error("{what}: {found} values given, {wanted} needed")]
    WrongLength {
        /// Name of the array.
        what: &'static str,
        /// Number of values given.
        found: usize,
        /// Number of values needed.
        wanted: usize,
    },
    /// A pivot is zero, not finite, or outside its half plane (for real numbers: negative).
    #[error("the pivot of unknown {unknown} of {unknowns} is not positive")]
    BadPivot {
        /// Position in the elimination order.
        unknown: usize,
        /// Number of unknowns.
        unknowns: usize,
    },
}

/// Returns an error if the lengths differ.
pub(super) fn check_length(
    what: &'static str,
    found: usize,
    wanted: usize,
) -> Result<(), SparseError> {
    if found == wanted { Ok(()) } else { Err(SparseError::WrongLength { what, found, wanted }) }
}
