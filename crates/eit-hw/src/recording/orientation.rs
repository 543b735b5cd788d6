//! What a frame is in a table of numbers.

/// What one frame is in a table of numbers [row, column].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrameOrientation {
    /// A row: the table is [frame, measurement].
    #[default]
    Rows,
    /// A column: the table is [measurement, frame].
    Columns,
    /// The whole table, [measurement, pattern], taken with the measurements of one pattern after
    /// the other.
    Matrix,
}
