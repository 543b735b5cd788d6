//! Classical methods for a sequence of frames, on the elements of the mesh.

use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use crate::method::Method;
use crate::skin::Skin;
use eit_inverse::sequence::{AbsoluteGaussNewton, AbsoluteSettings, TimePrior, TimePriorSettings};
use eit_inverse::{OneStepGaussNewton, OneStepSettings, Prior, SequenceSolver};
use eit_mesh::Raster;
use ndarray::{Array2, ArrayView2};

/// Relative distance of the background from a bound of the absolute method: its mapping from unknowns to
/// conductivities needs room on both sides.
const ROOM: f64 = 0.01;

/// Sets up a method on elements; `settings` contain the hyperparameter. `None` for total variation, which
/// works on pixels.
///
/// # Errors
///
/// Those of the method: settings out of range, and a Jacobian without rank.
pub fn method<'a>(
    method: Method,
    linearised: &'a LinearisedSkin,
    prior: &'a dyn Prior,
    settings: OneStepSettings,
) -> Result<Option<Box<dyn SequenceSolver + 'a>>, SkinError> {
    let jacobian = &linearised.jacobian;
    let one_step = settings;
    Ok(Some(match method {
        Method::StTv | Method::Tv => return Ok(None),
        Method::GaussNewton => Box::new(OneStepGaussNewton::new(jacobian, prior, one_step)?),
        Method::TimePrior => {
            let settings = TimePriorSettings { one_step, ..Default::default() };
            Box::new(TimePrior::new(jacobian, prior, &settings)?)
        }
        Method::GaussNewtonAbsolute => {
            let bounds_s = bounds_s(&linearised.skin);
            let settings = AbsoluteSettings { one_step, bounds_s, ..Default::default() };
            let background = linearised.skin.background_s();
            Box::new(AbsoluteGaussNewton::new(
                &linearised.skin.model,
                &background,
                prior,
                settings,
            )?)
        }
    }))
}

/// Converts bounds of the conductivity change to bounds of the conductivity.
fn bounds_s(skin: &Skin) -> Option<[f64; 2]> {
    let (keys, background) = (&skin.settings.reconstruction, skin.conductivity_s);
    if keys.lower_s.is_none() && keys.upper_s.is_none() {
        return None;
    }
    // the widest range that the method allows by default
    let [least, most] = [1e-3 * background, 1e3 * background];
    let lower = keys
        .lower_s
        .map_or(least, |lower| (background + lower).clamp(least, (1.0 - ROOM) * background));
    let upper = keys
        .upper_s
        .map_or(most, |upper| (background + upper).clamp((1.0 + ROOM) * background, most));
    Some([lower, upper])
}

/// Converts a movie on elements to one on masked pixels, both [frame, value].
///
/// # Errors
///
/// Images of another number of elements.
pub fn pixels_of(images: ArrayView2<'_, f64>, raster: &Raster) -> Result<Array2<f64>, SkinError> {
    let pixels = raster.pixel_from_element().multiply_dense(images.t())?;
    Ok(pixels.reversed_axes())
}
