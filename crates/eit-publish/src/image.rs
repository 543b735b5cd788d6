//! Images that sinks show.

use eit_skin::ndarray::ArrayView2;

/// An image `[row, column]` in siemens: row 0 at the top, NaN outside the skin.
#[derive(Debug, Clone, Copy)]
pub struct SkinImage<'a> {
    /// Change of conductivity.
    pub change_s: ArrayView2<'a, f64>,
    /// Image before the U-net, if there is one, siemens.
    pub before_net_s: Option<ArrayView2<'a, f64>>,
    /// Conductivity change of the faintest detectable touch, siemens; 0 if unknown. Weaker images show noise.
    pub faintest_s: f64,
    /// Certified bound on the relative distance of the image to its optimum, if known.
    pub gap: Option<f64>,
}

impl<'a> From<ArrayView2<'a, f64>> for SkinImage<'a> {
    fn from(change_s: ArrayView2<'a, f64>) -> Self {
        Self { change_s, before_net_s: None, faintest_s: 0.0, gap: None }
    }
}

/// Fraction of the pixels that may exceed the end of the colour scale.
#[cfg(feature = "web")]
const BEYOND: f64 = 0.002;

/// Largest magnitude without the largest 0.2 % of the pixels, so that a single hot pixel does not
/// make every touch pale.
#[cfg(feature = "web")]
pub(crate) fn robust_largest(image: ArrayView2<'_, f64>) -> f64 {
    let finite = image.iter().filter(|value| value.is_finite());
    let mut sizes: Vec<f64> = finite.map(|value| value.abs()).collect();
    let Some(last) = sizes.len().checked_sub(1) else { return 0.0 };
    let beyond = (BEYOND * sizes.len() as f64) as usize;
    *sizes.select_nth_unstable_by(last - beyond, f64::total_cmp).1
}

#[cfg(all(test, feature = "web"))]
mod tests {
    use super::*;
    use eit_skin::ndarray::Array2;

    #[test]
    fn a_hot_pixel_does_not_set_the_scale_and_a_touch_does() {
        let mut image = Array2::from_elem((64, 64), f64::NAN);
        assert_eq!(robust_largest(image.view()), 0.0);
        image.fill(1e-9);
        (20..26).for_each(|row| (30..36).for_each(|column| image[[row, column]] = -2e-6));
        image[[0, 0]] = 1.0;
        assert_eq!(robust_largest(image.view()), 2e-6);
        // a few pixels are all there is: none is left out
        let few =
            Array2::from_shape_vec((1, 3), vec![1.0, -3.0, f64::INFINITY]).unwrap_or_default();
        assert_eq!(robust_largest(few.view()), 3.0);
    }
}
