//! `reconstruction.frame_time_s`: chooses the open settings for a given time per frame.

use super::{BOUNDED, Budget, Measured, STREAM, Table, best, nearest};
use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use crate::method::Method;
use crate::scene::{DEFAULT_PIXELS, Hyperparameter, ReconstructionSettings, Rule, StageSettings};
use crate::skin::Skin;

/// Frame times that reports and plans list, seconds.
pub const BUDGETS_S: [f64; 3] = [1e-2, 1e-3, 1e-4];

impl LinearisedSkin {
    /// Chooses the settings left open for the smallest error within `frame_time_s`; without that key the skin
    /// is unchanged. `is_live` restricts the choice to solvers that return an image before the next frame
    /// arrives.
    ///
    /// Times are those of the table, so the choice is the same on every machine.
    ///
    /// # Errors
    ///
    /// No solver that the settings allow is fast enough.
    pub fn in_frame_time(self, frames: Option<usize>, is_live: bool) -> Result<Self, SkinError> {
        let voltages = self.voltages.to_vec();
        let settings = in_frame_time(&self.skin, frames, is_live, &voltages)?;
        Ok(self.with_reconstruction(settings))
    }
}

/// Like [`LinearisedSkin::in_frame_time`], for a skin whose untouched voltages are known.
pub(crate) fn in_frame_time(
    skin: &Skin,
    frames: Option<usize>,
    is_live: bool,
    voltages: &[f64],
) -> Result<ReconstructionSettings, SkinError> {
    let mut keys = skin.settings.reconstruction.clone();
    let Some(time_s) = keys.frame_time_s else { return Ok(keys) };
    let nearest = nearest(skin, frames, voltages);
    let table = Table::load()?;
    let rows = table.of_scene(nearest.scene).filter(|row| suits(&skin.settings, row));
    let budget = Budget { time_s, is_live };
    let Some((row, method)) = best(rows, budget).and_then(|r| Some((r, method(r)?))) else {
        return Err(SkinError::input(format!(
            "reconstruction.frame_time_s is {time_s}: nothing that the scene allows was fast enough \
             on {} ({}), the built-in scene most like this one",
            nearest.scene, nearest.why
        ))
        .within(&skin.place));
    };
    if keys.method.is_none() {
        keys.method = Some(method.name().to_owned());
        keys.is_chosen_in_time = true;
    }
    if row.rule == "gcv" && keys.hyperparameter.is_none() {
        keys.hyperparameter = Some(Hyperparameter::Rule(Rule::Gcv));
    }
    keys.pixels = keys.pixels.or(row.pixels);
    if method.is_tv() {
        keys.target_gap = keys.target_gap.or(row.target_gap);
    }
    Ok(keys)
}

/// The method as named in a scene file; `None` if it has no such name (a net, a peer).
fn method(row: &Measured) -> Option<Method> {
    let name = row.solver.trim_end_matches(STREAM).trim_end_matches(BOUNDED);
    Method::ALL.into_iter().find(|method| method.name() == name)
}

/// Returns whether the scene's settings allow a row: stated settings take precedence, total variation needs
/// the noise, and a bound applies only to scenes that state it.
pub(crate) fn suits(settings: &StageSettings, row: &Measured) -> bool {
    let Some(method) = method(row) else { return false };
    let keys = &settings.reconstruction;
    let bounded = keys.lower_s.is_some_and(|lower| lower >= 0.0);
    let of_method = match method.is_tv() {
        true => {
            let noise =
                settings.noise.additive_v.is_some() || settings.noise.quiet_frames.is_some();
            noise
                && bounded == row.solver.contains(BOUNDED)
                && keys.keys_of_gauss_newton().next().is_none()
        }
        false => {
            let reads_bounds = method == Method::GaussNewtonAbsolute;
            keys.keys_of_tv().next().is_none() && (reads_bounds || keys.bounds().next().is_none())
        }
    };
    let rule = match keys.hyperparameter {
        Some(Hyperparameter::Rule(Rule::Gcv)) => row.rule == "gcv",
        Some(Hyperparameter::Rule(Rule::NoiseFigure)) => row.rule == "noise-figure",
        // fixed numbers and L-curves were not measured
        Some(_) => false,
        None => true,
    };
    // a net is trained for one number of pixels
    let wanted = keys.pixels.or(settings.denoise.as_ref().map(|_| DEFAULT_PIXELS));
    let pixels = wanted.is_none_or(|n| row.pixels.is_none_or(|own| own == n));
    let gap = keys.target_gap.is_none_or(|gap| row.target_gap == Some(gap));
    let stated = keys.method.as_deref().is_none_or(|name| name == method.name());
    stated && of_method && (method.is_tv() || rule) && pixels && gap
}
