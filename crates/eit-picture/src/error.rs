//! Errors of this crate.

use crate::Extent;

/// What a point of a drawing belongs to.
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

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// No image, or images without pixels.
    #[error(
        "nothing to draw: the images are [{frames}, {rows}, {columns}]; give at least one pixel"
    )]
    Empty {
        /// Images given.
        frames: usize,
        /// Rows of each.
        rows: usize,
        /// Columns of each.
        columns: usize,
    },
    /// A curve without points, or none that the axes can show.
    #[error(
        "nothing to draw: none of the {series} series has a finite point that the axes can show"
    )]
    NoPoints {
        /// Series given.
        series: usize,
    },
    /// plotters could not draw.
    #[error("cannot draw the plot: {message}")]
    Plot {
        /// What plotters says.
        message: String,
    },
    /// A coordinate of the skin that is not a number.
    #[error("{what} {index} has the coordinates ({x_m}, {y_m}) m; they must be finite")]
    Coordinates {
        /// Which list the point is in.
        what: PointOf,
        /// Which of the list, from 0.
        index: usize,
        /// The point.
        x_m: f64,
        /// The point.
        y_m: f64,
    },
    /// A raster without area.
    #[error(
        "the skin spans x {} to {} m and y {} to {} m, seen from above: it must have width and \
         height there",
        .0.x_min_m, .0.x_max_m, .0.y_min_m, .0.y_max_m
    )]
    Extent(Extent),
    /// Labels do not fit the frames.
    #[error("{labels} labels for {frames} frames; give one for each frame")]
    LabelCount {
        /// Labels given.
        labels: usize,
        /// Frames given.
        frames: usize,
    },
    /// Values do not fit the mesh.
    #[error("{values} values for {triangles} triangles; give one for each triangle")]
    ValueCount {
        /// Values given.
        values: usize,
        /// Triangles given.
        triangles: usize,
    },
    /// A triangle names a node that there is not.
    #[error("triangle {triangle} names node {node}, but there are {nodes} nodes, counted from 0")]
    NodeIndex {
        /// Triangle, from 0.
        triangle: usize,
        /// Node it names.
        node: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// A range of values without width.
    #[error("the range of the colour bar [{low}, {high}] must be finite and rising")]
    Range {
        /// Value at the lower end.
        low: f64,
        /// Value at the upper end.
        high: f64,
    },
    /// A frame rate that is none.
    #[error("the frame rate {rate_hz} Hz must be finite and above 0")]
    FrameRate {
        /// Rate given.
        rate_hz: f64,
    },
    /// The built-in font does not load.
    #[error("the built-in font does not load; the program file is damaged")]
    Font,
    /// The PNG could not be written.
    #[error("cannot write the PNG: {0}")]
    Png(#[from] image::ImageError),
    /// The GIF could not be written.
    #[error("cannot write the GIF: {0}")]
    Gif(#[from] gif::EncodingError),
}
