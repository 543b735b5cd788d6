//! `reconstruction.frame_time_s`: what the scene leaves open is chosen for the time of a frame.

use super::{BOUNDED, Measured, STREAM, Table, best, nearest};
use crate::error::SkinError;
use crate::method::Method;
use crate::pipeline::{DEFAULT_PIXELS, Setup};
use crate::scene::{Hyperparameter, Rule, Scene};

/// Times that a frame may take that reports and plans tell of, seconds.
pub const BUDGETS_S: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// Settings that the scene leaves open, chosen for the least error within its `frame_time_s`; the
/// scene as it is without that key. `live`: only what gives an image before the next frame comes.
///
/// The table's own times count, so that a scene is the same on every machine.
pub fn in_time(
    scene: Scene,
    setup: &Setup,
    (frames, live): (Option<usize>, bool),
    voltages: &[f64],
) -> Result<Scene, SkinError> {
    let Some(budget_s) = scene.reconstruction.frame_time_s else { return Ok(scene) };
    let nearest = nearest(&scene, setup, frames, voltages);
    let table = Table::load()?;
    let rows = table.of_scene(nearest.scene).filter(|row| suits(&scene, row));
    let Some((row, method)) = best(rows, (budget_s, live)).and_then(|r| Some((r, method(r)?)))
    else {
        return Err(SkinError::input(format!(
            "reconstruction.frame_time_s is {budget_s}: nothing that the scene allows was so fast \
             on {} ({}), the built-in scene most like this one",
            nearest.scene, nearest.why
        ))
        .within(&scene.place));
    };
    let mut made = scene.clone();
    let keys = &mut made.reconstruction;
    if keys.method.is_none() {
        keys.method = Some(method.name().to_owned());
        keys.chosen_in_time = true;
    }
    if row.rule == "gcv" && keys.hyperparameter.is_none() {
        keys.hyperparameter = Some(Hyperparameter::Rule(Rule::Gcv));
    }
    keys.pixels = keys.pixels.or(row.pixels);
    if method.is_tv() {
        keys.target_gap = keys.target_gap.or(row.target_gap);
    }
    Ok(made)
}

/// What a scene file would call it; `None` for what it cannot say (a net, a peer).
fn method(row: &Measured) -> Option<Method> {
    let name = row.solver.trim_end_matches(STREAM).trim_end_matches(BOUNDED);
    Method::ALL.into_iter().find(|method| method.name() == name)
}

/// Whether a scene may be reconstructed as a row was: what the scene states comes first, total
/// variation needs the noise, and a bound belongs to scenes that state it.
pub fn suits(scene: &Scene, row: &Measured) -> bool {
    let Some(method) = method(row) else { return false };
    let keys = &scene.reconstruction;
    let bounded = keys.lower_s.is_some_and(|lower| lower >= 0.0);
    let of_method = match method.is_tv() {
        true => {
            let noise = scene.noise.additive_v.is_some() || scene.noise.quiet_frames.is_some();
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
        // numbers and curves were not measured
        Some(_) => false,
        None => true,
    };
    // a net belongs to its number of pixels
    let wanted = keys.pixels.or(scene.denoise.as_ref().map(|_| DEFAULT_PIXELS));
    let pixels = wanted.is_none_or(|n| row.pixels.is_none_or(|own| own == n));
    let gap = keys.target_gap.is_none_or(|gap| row.target_gap == Some(gap));
    let stated = keys.method.as_deref().is_none_or(|name| name == method.name());
    stated && of_method && (method.is_tv() || rule) && pixels && gap
}
