//! The skin around the values, as plain data.

/// Position of a raster: the outer borders of its pixels, in metres.
///
/// Pixel (row i, column j) covers x from `x_min_m + j w` to `x_min_m + (j + 1) w` and y from
/// `y_max_m - (i + 1) h` to `y_max_m - i h`, with w and h the pixel's sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Left border.
    pub x_min_m: f64,
    /// Right border.
    pub x_max_m: f64,
    /// Lower border.
    pub y_min_m: f64,
    /// Upper border.
    pub y_max_m: f64,
}

/// Where an electrode lies on the rim, and whether to draw it.
#[derive(Clone, Debug)]
pub struct ElectrodeDrawing {
    /// Electrode number, from 1.
    pub number: usize,
    /// Points along the rim that it covers, in metres.
    pub rim_m: Vec<[f64; 2]>,
    /// Whether to draw the arc and the number.
    pub drawn: bool,
}

/// The skin around the values: outline, electrodes and position of the raster.
#[derive(Clone, Debug)]
pub struct SkinDrawing {
    /// Closed curves in metres, the outer one first, then the holes; the last point need not repeat
    /// the first. If empty, images are not clipped, and are blank where they are NaN.
    pub outlines_m: Vec<Vec<[f64; 2]>>,
    /// The electrodes in any order.
    pub electrodes: Vec<ElectrodeDrawing>,
    /// Borders of the raster of the images.
    pub extent: Extent,
}
