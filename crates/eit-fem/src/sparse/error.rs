//! What can be wrong with a sparse factorisation.

/// What can be wrong with a sparse factorisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SparseError {
    /// The factor does not fit into memory or index range.
    #[error("the factor of {unknowns} unknowns does not fit into memory")]
    OutOfMemory {
        /// Number of unknowns.
        unknowns: usize,
    },
    /// No unknown is left for the right-hand sides.
    #[error(
        "{leading} of {unknowns} unknowns come before those with right-hand sides: at least one must \
         be left"
    )]
    NoTrailingUnknowns {
        /// Unknowns without right-hand side.
        leading: usize,
        /// Number of unknowns.
        unknowns: usize,
    },
    /// An array has the wrong length.
    #[error("{what}: {found} values given, {wanted} needed")]
    WrongLength {
        /// Which array.
        what: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        wanted: usize,
    },
    /// The factorisation met a pivot that is zero, not finite, or out of its half plane (real numbers:
    /// negative).
    #[error("the pivot of unknown {unknown} of {unknowns} is not positive")]
    BadPivot {
        /// Position in the elimination order.
        unknown: usize,
        /// Number of unknowns.
        unknowns: usize,
    },
}

/// Passes where the lengths are equal.
pub(super) fn check_length(
    what: &'static str,
    found: usize,
    wanted: usize,
) -> Result<(), SparseError> {
    if found == wanted { Ok(()) } else { Err(SparseError::WrongLength { what, found, wanted }) }
}
