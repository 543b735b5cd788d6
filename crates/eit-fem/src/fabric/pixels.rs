//! Means of functions over pixels.

use eit_mesh::Raster;

/// Computes the mean of a function over each masked pixel, from 4 x 4 points.
pub(super) fn pixel_means_into(raster: &Raster, at: impl Fn([f64; 2]) -> f64, means: &mut [f64]) {
    for (mean, &[row, column]) in means.iter_mut().zip(raster.masked_pixels()) {
        *mean = pixel_mean(raster.centre_m(row, column), raster.pixel_m(), &at);
    }
}

/// Computes the mean of a function over a pixel, from 4 x 4 points.
pub(super) fn pixel_mean([x, y]: [f64; 2], pixel_m: f64, at: impl Fn([f64; 2]) -> f64) -> f64 {
    let offsets = [-0.375, -0.125, 0.125, 0.375].map(|part| part * pixel_m);
    let points = offsets.iter().flat_map(|dx| offsets.map(|dy| [x + dx, y + dy]));
    points.map(at).sum::<f64>() / 16.0
}
