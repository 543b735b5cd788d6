//! The error type of this crate.

use crate::Extent;

/// The list that a coordinate belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PointOf {
    /// An outline of the skin.
    Outline,
    /// The curve of an electrode.
    Electrode,
    /// The nodes of a mesh.
    Node,
}

impl std::fmt::Display for PointOf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Outline => "outline",
            Self::Electrode => "electrode",
            Self::Node => "node",
        })
    }
}

/// A picture that cannot be drawn or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// No image was given, or images without pixels.
    #[error(
        "nothing to draw: the images are [{frames}, {rows}, {columns}]; give at least one pixel"
    )]
    Empty {
        /// Number of images.
        frames: usize,
        /// Rows per image.
        rows: usize,
        /// Columns per image.
        columns: usize,
    },
    /// No series has a point that the axes can show.
    #[error(
        "nothing to draw: none of the {series} series has a finite point that the axes can show"
    )]
    NoPoints {
        /// Number of series.
        series: usize,
    },
    /// plotters failed to draw.
    #[error("cannot draw the plot: {message}")]
    Plot {
        /// The message from plotters.
        message: String,
    },
    /// A coordinate of the skin is not finite.
    #[error("{what} {index} has the coordinates ({x_m}, {y_m}) m; they must be finite")]
    Coordinates {
        /// The list that contains the point.
        what: PointOf,
        /// Index in that list, from 0.
        index: usize,
        /// x coordinate, metres.
        x_m: f64,
        /// y coordinate, metres.
        y_m: f64,
    },
    /// The raster has no area.
    #[error(
        "the skin spans x {} to {} m and y {} to {} m, seen from above: both ranges must be non-empty",
        .0.x_min_m, .0.x_max_m, .0.y_min_m, .0.y_max_m
    )]
    Extent(Extent),
    /// The number of labels does not match the number of frames.
    #[error("{labels} labels for {frames} frames; give one for each frame")]
    LabelCount {
        /// Number of labels.
        labels: usize,
        /// Number of frames.
        frames: usize,
    },
    /// The number of values does not match the mesh.
    #[error("{values} values for {triangles} triangles; give one for each triangle")]
    ValueCount {
        /// Number of values.
        values: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// A triangle refers to a node that does not exist.
    #[error(
        "triangle {triangle} refers to node {node}, but there are {nodes} nodes, counted from 0"
    )]
    NodeIndex {
        /// Triangle index, from 0.
        triangle: usize,
        /// Node index that was not found.
        node: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// The range of values is empty.
    #[error("the range of the colour bar [{low}, {high}] must be finite and increasing")]
    Range {
        /// Value at the lower end.
        low: f64,
        /// Value at the upper end.
        high: f64,
    },
    /// The frame rate is not positive and finite.
    #[error("the frame rate {rate_hz} Hz must be finite and above 0")]
    FrameRate {
        /// Rate given.
        rate_hz: f64,
    },
    /// The built-in font cannot be loaded.
    #[error("the built-in font cannot be loaded; the program file is damaged")]
    Font,
    /// The PNG could not be written.
    #[error("cannot write the PNG: {0}")]
    Png(#[from] png::EncodingError),
    /// The GIF could not be written.
    #[error("cannot write the GIF: {0}")]
    Gif(#[from] gif::EncodingError),
}
