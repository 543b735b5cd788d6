//! Symmetries of the electrodes as permutations of the measurements.

use crate::DenoiseError;
use std::collections::HashMap;

/// Order and signs of the measurements of a rotated or reflected skin.
///
/// Turns a frame of a touched skin into the frame of the rotated touch, with the instrument's noise
/// and errors, without another simulation or measurement. The skin must have the symmetry: `count` equal
/// electrodes at equal distances on a disc have `count` rotations and as many reflections.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasurementOrder {
    /// The old measurement and its sign for each new measurement.
    from: Vec<(usize, f64)>,
}

impl MeasurementOrder {
    /// Computes the order after every electrode `l` has moved to the place of `new_electrode[l]`, 0-based.
    /// `quadruples` `[a, b, m, n]` are those of the protocol. Swapping the electrodes of a pair changes the
    /// sign, swapping the two pairs (reciprocity) does not.
    ///
    /// Returns `None` if the protocol does not have the symmetry: some quadruple has no counterpart.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`] if `new_electrode` is not a permutation or a quadruple names an
    /// electrode beyond it.
    pub fn new(
        quadruples: &[[u32; 4]],
        new_electrode: &[u32],
    ) -> Result<Option<Self>, DenoiseError> {
        let count = new_electrode.len();
        let mut old_electrode = vec![u32::MAX; count];
        for (old, &new) in new_electrode.iter().enumerate() {
            match old_electrode.get_mut(new as usize) {
                Some(place) if *place == u32::MAX => *place = old as u32,
                _ => {
                    let (quantity, must) = ("new_electrode", "a permutation of the electrodes");
                    return Err(DenoiseError::OutOfRange { quantity, value: f64::from(new), must });
                }
            }
        }
        let mut known = HashMap::new();
        for (i, quadruple) in quadruples.iter().enumerate() {
            for &l in quadruple {
                let (is_known, must) = ((l as usize) < count, "below the number of electrodes");
                DenoiseError::check_range(is_known, "electrode", f64::from(l), must)?;
            }
            known.insert(*quadruple, i);
        }
        let counterpart = |quadruple: &[u32; 4]| {
            let [a, b, m, n] = quadruple.map(|l| old_electrode[l as usize]);
            let ways = [
                ([a, b, m, n], 1.0),
                ([b, a, n, m], 1.0),
                ([b, a, m, n], -1.0),
                ([a, b, n, m], -1.0),
                ([m, n, a, b], 1.0),
                ([n, m, b, a], 1.0),
                ([n, m, a, b], -1.0),
                ([m, n, b, a], -1.0),
            ];
            ways.into_iter().find_map(|(way, sign)| known.get(&way).map(|&i| (i, sign)))
        };
        let from: Option<Vec<_>> = quadruples.iter().map(counterpart).collect();
        Ok(from.map(|from| Self { from }))
    }

    /// Returns the symmetries of `count` equal electrodes at equal distances around a disc that the
    /// protocol has too: rotations by `steps` electrodes, alone or after a reflection (electrode `l` to
    /// `-l`). The first is the identity.
    ///
    /// # Errors
    /// Those of [`MeasurementOrder::new`].
    pub fn of_disc(
        quadruples: &[[u32; 4]],
        count: u32,
    ) -> Result<Vec<(DiscSymmetry, Self)>, DenoiseError> {
        let mut found = Vec::new();
        for mirrored in [false, true] {
            for steps in 0..count {
                let symmetry = DiscSymmetry { steps, mirrored };
                let new: Vec<u32> = (0..count).map(|l| symmetry.new_electrode(l, count)).collect();
                found.extend(Self::new(quadruples, &new)?.map(|order| (symmetry, order)));
            }
        }
        Ok(found)
    }

    /// Writes the frame of the rotated or reflected skin; both frames have the length of the protocol.
    ///
    /// # Errors
    /// [`DenoiseError::WrongLength`].
    pub fn apply_into(&self, frame: &[f64], out: &mut [f64]) -> Result<(), DenoiseError> {
        DenoiseError::check_length("measurements", frame.len(), self.from.len())?;
        DenoiseError::check_length("measurements", out.len(), self.from.len())?;
        for (out, &(old, sign)) in out.iter_mut().zip(&self.from) {
            *out = sign * frame[old];
        }
        Ok(())
    }
}

/// A symmetry of a disc with equally spaced electrodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DiscSymmetry {
    /// Rotation in electrodes, in the direction of their numbers.
    pub steps: u32,
    /// Whether a reflection at the axis through electrode 0 comes first.
    pub mirrored: bool,
}

impl DiscSymmetry {
    /// Returns the new number of electrode `l` of `count`.
    pub fn new_electrode(self, l: u32, count: u32) -> u32 {
        let l = if self.mirrored { (count - l) % count } else { l };
        (l + self.steps) % count
    }

    /// Returns the linear map of places as rows of a 2 x 2 matrix, for electrode 0 at `first_angle`
    /// (radians counter-clockwise from +x) and electrodes numbered counter-clockwise or clockwise. It
    /// rotates about the origin.
    pub fn matrix(self, count: u32, first_angle: f64, clockwise: bool) -> [[f64; 2]; 2] {
        let turn = std::f64::consts::TAU * f64::from(self.steps) / f64::from(count);
        let turn = if clockwise { -turn } else { turn };
        if self.mirrored {
            // angle first + t goes to first - t + turn
            let (sin, cos) = (2.0 * first_angle + turn).sin_cos();
            [[cos, sin], [sin, -cos]]
        } else {
            let (sin, cos) = turn.sin_cos();
            [[cos, -sin], [sin, cos]]
        }
    }
}
