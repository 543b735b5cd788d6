//! Pictures of a skin: conductivity images as a contact sheet ([`sheet`]) or a GIF
//! ([`animation`]), meshes ([`mesh`]) and curves ([`plot`]).
//!
//! Everything here takes plain data and returns a [`Canvas`] or writes to an [`std::io::Write`];
//! the same input gives the same bytes. Lengths on the page are in *points*: a canvas of zoom 2
//! has two pixels to a point.

mod animation;
mod canvas;
mod colormap;
#[cfg(test)]
mod fixture;
mod mesh;
mod numbers;
mod page;
mod panel;
mod plot;
mod scale;
mod sheet;
mod text;
mod tracks;

pub(crate) use animation::write_gif;
pub(crate) use canvas::Canvas;
pub(crate) use colormap::ColorMap;
pub(crate) use mesh::{MeshDrawing, draw_mesh};
pub(crate) use plot::{Plot, Series, draw_plot};
pub(crate) use sheet::draw_sheet;
pub(crate) use tracks::{Track, TracksPanel, draw_tracks};

/// Where a raster lies: the outer borders of its pixels, in metres.
///
/// Pixel (row i, column j) covers x from `x_min_m + j w` to `x_min_m + (j + 1) w` and y from
/// `y_max_m - (i + 1) h` to `y_max_m - i h`, with w and h the pixel's sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extent {
    /// Left border.
    pub x_min_m: f64,
    /// Right border.
    pub x_max_m: f64,
    /// Lower border.
    pub y_min_m: f64,
    /// Upper border.
    pub y_max_m: f64,
}

/// One electrode as it is drawn.
#[derive(Clone, Debug)]
pub(crate) struct ElectrodeDrawing {
    /// Its number as people count, from 1.
    pub number: usize,
    /// Points along the rim that it covers, in metres.
    pub rim_m: Vec<[f64; 2]>,
    /// False leaves both the arc and the number out.
    pub drawn: bool,
}

/// The skin around the values: outline, electrodes and the raster's place.
#[derive(Clone, Debug)]
pub(crate) struct SkinDrawing {
    /// Closed curves in metres, first the outer one, then the holes; the last point need not
    /// repeat the first. Empty: images are not clipped, and blank where they are NaN.
    pub outlines_m: Vec<Vec<[f64; 2]>>,
    /// The electrodes in any order.
    pub electrodes: Vec<ElectrodeDrawing>,
    /// Borders of the raster that the images are on.
    pub extent: Extent,
}

/// What stands under each image.
#[derive(Clone, Debug, Default)]
pub(crate) enum FrameLabels {
    /// "frame 12", counting from 0 as the array does.
    #[default]
    Number,
    /// "frame 12 · 1.20 s", with the frame's time at this rate in hertz; frame 0 is at 0 s.
    Time {
        /// Frames per second of the data.
        rate_hz: f64,
    },
    /// One text per frame, such as the name of the method.
    Text(Vec<String>),
}

/// How the values are shown and what is written around them.
#[derive(Clone, Debug)]
pub(crate) struct PictureSettings {
    /// Headline; may be empty.
    pub title: String,
    /// Small print below: method, hyperparameter. What was left out or clipped is added to it.
    pub footnote: String,
    /// Symbol over the colour bar.
    pub quantity: String,
    /// Unit of the values without prefix; the bar adds one (µS).
    pub unit: String,
    /// Colours.
    pub map: ColorMap,
    /// Values at the two ends of the bar, made symmetric for a diverging map. Left out: all
    /// finite values fit, without percentiles.
    pub range: Option<[f64; 2]>,
    /// What stands under each image.
    pub labels: FrameLabels,
    /// Places that are marked in each frame, metres; empty, or one list for each frame.
    pub marks_m: Vec<Vec<[f64; 2]>>,
    /// Images to a row of a sheet (left out: near the shape of a page); in an animation, images
    /// side by side, which are taken in groups of so many.
    pub columns: Option<usize>,
    /// Bilinear between pixel centres, which also fills half a pixel of NaN at the rim of the
    /// skin and of holes in the data; false shows each pixel as the square it is.
    pub smooth: bool,
    /// Pixels to a point (1 to 4); an animation always has 1.
    pub zoom: usize,
}

impl Default for PictureSettings {
    /// Changes of conductivity in siemens on the diverging map.
    fn default() -> Self {
        Self {
            title: String::new(),
            footnote: String::new(),
            quantity: "Δσ".to_owned(),
            unit: "S".to_owned(),
            map: ColorMap::CoolWarm,
            range: None,
            labels: FrameLabels::Number,
            marks_m: Vec::new(),
            columns: None,
            smooth: true,
            zoom: 2,
        }
    }
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum PictureError {
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
    /// A coordinate of the skin that is not a number.
    #[error("{what} {index} has the coordinates ({x_m}, {y_m}) m; they must be finite")]
    Coordinates {
        /// Which list the point is in.
        what: &'static str,
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
