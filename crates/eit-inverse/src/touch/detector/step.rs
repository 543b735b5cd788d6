//! What the detector says about a frame.

/// A touch found in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DetectedTouch {
    /// Position on the skin, metres.
    pub position_m: [f64; 3],
    /// Unit normal of the mesh at that position, on the side from which the corners of its triangles run
    /// counter-clockwise; +z on a flat skin.
    pub normal: [f64; 3],
    /// Covariance of the position, square metres, from noise and nuisance parameters, scaled by the
    /// residual chi^2 per row if that exceeds 1.
    pub position_covariance_m2: [[f64; 3]; 3],
    /// Integral of the conductivity change, S m^2, with its sign.
    pub strength_s_m2: f64,
    /// Standard deviation of the strength, S m^2, computed like the covariance of the position.
    pub strength_std_s_m2: f64,
    /// Peak of the conductivity change, siemens, with its sign.
    pub peak_s: f64,
    /// One plus the chi^2 that this touch removes divided by the excess of the residual over the
    /// noise (at least 0.3 per row): the factor by which the residual grows without it, where the
    /// model's error dominates.
    pub worth: f64,
    /// Result of the map learnt from presses at known positions and forces, if there is one.
    pub learnt: Option<LearntTouch>,
}

/// Results of a map learnt from presses for a touch.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LearntTouch {
    /// Force and its standard deviation, newtons, if forces were learnt.
    pub force_n: Option<[f64; 2]>,
    /// Whether the frame is unlike every learnt press. Position and strength then do not come from the map,
    /// and no force is given.
    pub is_unlike: bool,
}

/// How a frame was explained.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct DetectorStep {
    /// Number of rows present.
    pub rows: usize,
    /// Squared length of the whitened frame; without a touch, the expectation of each row is below 1.
    pub chi_square: f64,
    /// Squared length after subtracting what the fabric's memory explains.
    pub chi_square_without: f64,
    /// Squared length of the residual after fitting touches.
    pub chi_square_rest: f64,
    /// The electrode whose gain alone explains the frame far better than touches do.
    pub blamed: Option<usize>,
    /// Whether touches, or the absence of any, explain the frame.
    pub is_explained: bool,
}

impl DetectorStep {
    /// A frame without memory or a faulty electrode, of these squared lengths before and after fitting touches.
    pub(in crate::touch) fn new(
        rows: usize,
        [chi_square, chi_square_rest]: [f64; 2],
        is_explained: bool,
    ) -> Self {
        let (chi_square_without, blamed) = (chi_square, None);
        Self { rows, chi_square, chi_square_without, chi_square_rest, blamed, is_explained }
    }
}

/// Largest residual of an explained frame, over its number of rows. Simulated fabrics leave up to
/// 50 with the touches that were found and up to 7 without any; frames whose voltages change the
/// other way leave 1 000 and more.
pub(super) const MOST_PER_ROW: f64 = 20.0;
/// Largest part of a frame's squared length that an explained frame leaves: strong touches leave more per row, since
/// the model is linear, but up to a quarter of their own frame.
const MOST_OF_FRAME: f64 = 0.3;

/// Whether a residual is small, in total or per row. Other data, such as touches that change the conductivity the other
/// way, is not explained.
pub(super) fn is_explained(rows: usize, whole: f64, rest: f64) -> bool {
    rest <= MOST_PER_ROW * rows.max(1) as f64 || rest <= MOST_OF_FRAME * whole
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame is explained by a small residual relative to the frame or per row; either suffices.
    #[test]
    fn explained_by_part_or_by_row() {
        // noise, memory, a strong touch whose model is off, a faint one; and touches of the other sign
        for (all, rest) in [(50.0, 50.0), (2e3, 7e2), (1e6, 2e5), (2.5e3, 1.9e3)] {
            assert!(is_explained(100, all, rest), "{all} {rest}");
        }
        assert!(!is_explained(100, 4e5, 2e5) && !is_explained(100, 3e4, 3e4));
    }
}
