//! Cost of the U-net per frame.

use super::stage::Stage;
use crate::error::SkinError;
use crate::skin::Skin;

/// Operations per second of the small convolutions, and of the products of the check, fitted like those of
/// the other stages.
const NET_FLOPS_PER_S: f64 = 3.5e10;
const CHECK_FLOPS_PER_S: f64 = 1e10;

/// U-net and check; none without `[denoise]`.
#[cfg(feature = "denoise")]
pub(crate) fn of(skin: &Skin) -> Result<Vec<Stage>, SkinError> {
    let Some(net) = skin.net()? else { return Ok(Vec::new()) };
    let pixels = skin.pixels();
    let measurements = skin.protocol.measurements();
    let share = super::stages::skin_share(skin);
    let shape = net.shape();
    let flops = 2.0 * shape.multiply_adds(pixels, pixels);
    let inside = share * (pixels * pixels) as f64;
    let check = 2.0 * measurements as f64 * inside;
    let others = (shape.images - 1) as f64;
    // two factors, of at most half the measurements' rank where data are reciprocal
    let one_step = others * (measurements as f64) * (measurements as f64 + inside);
    let inputs = (others > 0.0).then(|| Stage {
        name: "inputs of the U-net",
        size: format!("{others} one-step images, [{measurements}, {inside:.0}]"),
        flops: one_step,
        bytes: 4.0 * one_step,
        time_s: one_step / CHECK_FLOPS_PER_S,
        why: "a frame: these weights see further images of its measurements".to_owned(),
    });
    let stages = [
        Stage {
            name: "U-net",
            size: format!("{} weights, {pixels} x {pixels} pixels", shape.parameters()),
            flops,
            bytes: 4.0 * shape.parameters() as f64,
            time_s: flops / NET_FLOPS_PER_S,
            why: "per frame: the scene has [denoise]".to_owned(),
        },
        Stage {
            name: "check",
            size: format!("[{measurements}, {inside:.0}]"),
            flops: check,
            bytes: 4.0 * measurements as f64 * inside,
            time_s: check / CHECK_FLOPS_PER_S,
            why: "per frame: checks that the U-net's image explains the measurements".to_owned(),
        },
    ];
    Ok(inputs.into_iter().chain(stages).collect())
}

/// No stages without the feature.
#[cfg(not(feature = "denoise"))]
pub(crate) fn of(_: &Skin) -> Result<Vec<Stage>, SkinError> {
    Ok(Vec::new())
}
