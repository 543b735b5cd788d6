//! The skin around the values, as plain data.

/// Where a raster lies: the outer borders of its pixels, in metres.
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

/// One electrode as it is drawn.
#[derive(Clone, Debug)]
pub struct ElectrodeDrawing {
    /// Its number as people count, from 1.
    pub number: usize,
    /// Points along the rim that it covers, in metres.
    pub rim_m: Vec<[f64; 2]>,
    /// False leaves both the arc and the number out.
    pub drawn: bool,
}

/// The skin around the values: outline, electrodes and the raster's place.
#[derive(Clone, Debug)]
pub struct SkinDrawing {
    /// Closed curves in metres, first the outer one, then the holes; the last point need not
    /// repeat the first. Empty: images are not clipped, and blank where they are NaN.
    pub outlines_m: Vec<Vec<[f64; 2]>>,
    /// The electrodes in any order.
    pub electrodes: Vec<ElectrodeDrawing>,
    /// Borders of the raster that the images are on.
    pub extent: Extent,
}
