//! Structural similarity of an image to the truth.

use crate::InverseError;
use crate::check::{check_length, check_positive, check_range};
use ndarray::{Array2, ArrayView2};

/// Pixels on each side of a window's centre; windows are 11 x 11.
const REACH: usize = 5;
/// Standard deviation of the window's Gaussian weights, pixels.
const SIGMA: f64 = 1.5;
/// Constants `(K L)^2` that keep the ratio finite, `K1 = 0.01`, `K2 = 0.03`, `L = 1`.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Returns the mean structural similarity (SSIM) of two images `[row, column]` over the pixels of a mask
/// (the skin), -1 to 1, 1 for equal images.
///
/// See [`structural_similarity_map`].
///
/// # Errors
/// As [`structural_similarity_map`].
pub fn structural_similarity(
    image: ArrayView2<'_, f64>,
    truth: ArrayView2<'_, f64>,
    mask: ArrayView2<'_, bool>,
    data_range: Option<f64>,
) -> Result<Option<f64>, InverseError> {
    let Some(map) = structural_similarity_map(image, truth, mask, data_range)? else {
        return Ok(None);
    };
    let inside = map.iter().zip(mask).filter(|(_, inside)| **inside).map(|(x, _)| x);
    let pixels = mask.iter().filter(|inside| **inside).count();
    Ok(Some(inside.sum::<f64>() / pixels as f64))
}

/// Returns the structural similarity (SSIM) around each pixel of a mask, `[row, column]`, NaN outside it.
///
/// ```text
/// SSIM = (2 mx mt + C1) (2 sxt + C2) / ((mx^2 + mt^2 + C1) (sx^2 + st^2 + C2))
/// C1 = (0.01 L)^2,   C2 = (0.03 L)^2
/// ```
///
/// with means `m`, variances `s^2` and covariance `sxt` of image `x` and truth `t`, in a window of 11 x 11
/// pixels with Gaussian weights of 1.5 pixels standard deviation that sum to one.
///
/// Windows contain only pixels of the mask, with weights scaled to sum to one over them. Nothing outside
/// the skin is read (it may be NaN), and pixels at the rim have windows too. If a whole window lies in the
/// mask, this is the published index.
///
/// `data_range` is `L`, in the unit of the images; `None` takes the largest minus the smallest value of the
/// truth in the mask. Give one value for all frames of a sequence to make them comparable. The result is
/// `None` if the mask is empty, or if `data_range` is `None` and the truth is constant.
///
/// Source: Wang, Bovik, Sheikh, Simoncelli, *IEEE Trans. Image Process.* 13 (2004), 600-612.
///
/// # Errors
/// [`InverseError::WrongLength`] if the shapes differ; [`InverseError::OutOfRange`] for a non-finite value
/// in the mask and for a `data_range` that is not finite and above zero.
pub fn structural_similarity_map(
    image: ArrayView2<'_, f64>,
    truth: ArrayView2<'_, f64>,
    mask: ArrayView2<'_, bool>,
    data_range: Option<f64>,
) -> Result<Option<Array2<f64>>, InverseError> {
    for (what, array) in [("image", &image), ("truth", &truth)] {
        check_length(what, array.nrows(), mask.nrows())?;
        check_length(what, array.ncols(), mask.ncols())?;
        for (x, _) in array.iter().zip(mask).filter(|(_, inside)| **inside) {
            check_range("a pixel in the mask", *x, x.is_finite(), "finite")?;
        }
    }
    let Some(range) = data_range.or_else(|| range_in(truth, mask)) else { return Ok(None) };
    check_positive("data_range", range)?;
    if !mask.iter().any(|inside| *inside) {
        return Ok(None);
    }
    let weights = std::array::from_fn(|k| (-0.5 * (k as f64 / SIGMA).powi(2)).exp());
    Ok(Some(Array2::from_shape_fn(mask.dim(), |(row, column)| {
        if mask[(row, column)] {
            let window = window(mask, row, column, &weights);
            let pairs = window.map(|(at, w)| (image[at] / range, truth[at] / range, w));
            index(pairs)
        } else {
            f64::NAN
        }
    })))
}

/// Returns the largest minus the smallest value in the mask; `None` if all are equal or there are none.
fn range_in(truth: ArrayView2<'_, f64>, mask: ArrayView2<'_, bool>) -> Option<f64> {
    let inside = truth.iter().zip(mask).filter(|(_, inside)| **inside).map(|(x, _)| *x);
    let (low, high) =
        inside.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    (low < high).then_some(high - low)
}

/// Returns the pixels of the mask in the window around a pixel, with their weights (not normalised).
fn window<'a>(
    mask: ArrayView2<'a, bool>,
    row: usize,
    column: usize,
    weights: &'a [f64; REACH + 1],
) -> impl Iterator<Item = ((usize, usize), f64)> + Clone {
    let around = |k: usize, end: usize| k.saturating_sub(REACH)..(k + REACH + 1).min(end);
    let (rows, columns) = (around(row, mask.nrows()), around(column, mask.ncols()));
    let places = rows.flat_map(move |r| columns.clone().map(move |c| (r, c)));
    places
        .filter(move |&place| mask[place])
        .map(move |(r, c)| ((r, c), weights[r.abs_diff(row)] * weights[c.abs_diff(column)]))
}

/// Returns the index of one window of `(image / L, truth / L, weight)`.
fn index(pairs: impl Iterator<Item = (f64, f64, f64)> + Clone) -> f64 {
    let (mut image_mean, mut truth_mean, mut total) = (0.0, 0.0, 0.0);
    for (x, t, w) in pairs.clone() {
        image_mean += w * x;
        truth_mean += w * t;
        total += w;
    }
    image_mean /= total;
    truth_mean /= total;
    // computed about the means rather than as differences of squares, since images may have an offset
    let (mut image_variance, mut truth_variance, mut covariance) = (0.0, 0.0, 0.0);
    for (x, t, w) in pairs {
        let (x, t, w) = (x - image_mean, t - truth_mean, w / total);
        image_variance += w * x * x;
        truth_variance += w * t * t;
        covariance += w * x * t;
    }
    let means =
        (2.0 * image_mean * truth_mean + C1) / (image_mean.powi(2) + truth_mean.powi(2) + C1);
    means * (2.0 * covariance + C2) / (image_variance + truth_variance + C2)
}
