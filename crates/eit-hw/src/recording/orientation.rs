//! Orientation of frames in a table of numbers.

/// What forms one frame in a table of numbers [row, column].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum FrameOrientation {
    /// A row: the table is [frame, measurement].
    #[default]
    Rows,
    /// A column: the table is [measurement, frame].
    Columns,
    /// The whole table, [measurement, pattern], read pattern by pattern.
    Matrix,
}
