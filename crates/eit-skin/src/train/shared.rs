//! What the sequences of a learning base share.

use crate::denoise::DrawnTouches;
use crate::denoise::{Chain, Chained};
use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
use crate::touches::touches;
use eit_denoise::{DiscSymmetry, MeasurementOrder, ShardData, ShardTouches};
use ndarray::Array1;

/// Shared by all sequences: the skin on which they are reconstructed, and its symmetries.
#[derive(Debug)]
pub(crate) struct Shared {
    /// Reconstructs the images.
    pub chain: Chain,
    pub seed: u64,
    /// Symmetries of the skin; empty if only the identity is known.
    pub symmetries: Vec<TurnedOrder>,
}

/// A symmetry of the skin, with its permutation of the measurements.
#[derive(Debug)]
pub(crate) struct TurnedOrder {
    pub symmetry: DiscSymmetry,
    pub order: MeasurementOrder,
}

impl Shared {
    /// Returns the linear map of a symmetry.
    pub(crate) fn matrix(&self, symmetry: DiscSymmetry) -> [[f64; 2]; 2] {
        let skin = &self.chain.linearised.skin;
        let count = skin.mesh.electrodes().len() as u32;
        let (first, clockwise) =
            skin.symmetry.map_or((0.0, false), |disc| (disc.first_angle_rad, disc.is_clockwise));
        symmetry.matrix(count, first, clockwise)
    }

    /// Returns the differences of frames from their reference, with their noise; `None` if the noise is
    /// unknown.
    pub(crate) fn data(&self, made: &Chained) -> Result<Option<ShardData>, SkinError> {
        let fitted = &made.fitted;
        let frames = &fitted.frames;
        let Some(noise) = fitted.noise()? else { return Ok(None) };
        let std = noise.std.iter().zip(&frames.used);
        let noise_std: Array1<f32> =
            std.map(|(std, used)| if *used { *std as f32 } else { f32::INFINITY }).collect();
        let mut differences = fitted.differences().mapv(|v| v as f32);
        differences.zip_mut_with(&frames.good, |value, good| {
            if !good {
                *value = f32::NAN;
            }
        });
        Ok(Some(ShardData { differences, noise_std }))
    }
}

/// Returns the touches that are detected in the frames of a sequence, their strengths multiplied by `sign`; `None` if
/// the noise is unknown.
pub(super) fn touches_of(made: &Chained, sign: f64) -> Result<Option<ShardTouches>, SkinError> {
    let Some(found) = touches(&made.fitted, &mut Progress::silent())? else { return Ok(None) };
    let frames = DrawnTouches::of_frames(&found, made.fitted.image_per_strength());
    let most = frames.iter().map(|frame| frame.touches.len()).max().unwrap_or(0);
    let mut touches = ShardTouches::from_elem((frames.len(), most, 3), f32::NAN);
    for (mut of_frame, drawn) in touches.outer_iter_mut().zip(&frames) {
        for (mut row, touch) in of_frame.outer_iter_mut().zip(&drawn.touches) {
            let [x, y] = touch.position_m;
            let numbers = [x, y, sign * touch.intensity_s_m2];
            row.iter_mut().zip(numbers).for_each(|(to, from)| *to = from as f32);
        }
    }
    Ok(Some(touches))
}

/// Rotations and reflections that skin and protocol share; empty if only the identity is known.
pub(super) fn symmetries(skin: &Skin) -> Result<Vec<TurnedOrder>, SkinError> {
    let (Some(quadruples), Some(_)) = (skin.protocol.quadruples(), skin.symmetry) else {
        return Ok(Vec::new());
    };
    let orders = MeasurementOrder::of_disc(quadruples, skin.mesh.electrodes().len() as u32)?;
    Ok(orders.into_iter().map(|(symmetry, order)| TurnedOrder { symmetry, order }).collect())
}
