//! The one error type of this crate.

/// What can be wrong with a stack of images.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DenoiseError {
    /// Images and mask have different sizes.
    #[error(
        "the images have {} rows and {} columns, but the mask has {} and {}: draw both on one raster",
        images[0], images[1], mask[0], mask[1]
    )]
    ShapeMismatch {
        /// Rows and columns of each image.
        images: [usize; 2],
        /// Rows and columns of the mask.
        mask: [usize; 2],
    },
    /// No pixel lies inside the mask.
    #[error(
        "the mask of {rows} rows and {columns} columns has no pixel inside the skin: use more pixels"
    )]
    EmptyMask {
        /// Rows of the mask.
        rows: usize,
        /// Columns of the mask.
        columns: usize,
    },
    /// A pixel inside the mask is NaN or infinite.
    #[error(
        "frame {frame} holds {value} at row {row}, column {column}, inside the skin: leave the frame \
         out or mend the reconstruction"
    )]
    NonFinitePixel {
        /// Frame index.
        frame: usize,
        /// Row index, 0 at the top.
        row: usize,
        /// Column index.
        column: usize,
        /// The value.
        value: f64,
    },
    /// A frame that is not in the stack.
    #[error("frame {frame} was asked for, but the stack has {frames}, counted from 0")]
    UnknownFrame {
        /// Index asked for.
        frame: usize,
        /// Frames there are.
        frames: usize,
    },
}
