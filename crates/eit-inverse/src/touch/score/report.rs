//! Touches as they are reported.

use super::model::Model;
use super::settings::{MOST_TOUCHES, ScoreSettings};
use super::state::{TouchState, Touches};
use crate::touch::detector::Places;
use crate::touch::skin::in_space;
use crate::touch::{DetectorStep, Touch, TouchState as Stage};
use eit_mesh::Surface;

/// Largest standard deviation of the position of a valid touch, metres, along its worst direction: half a finger's width.
const MOST_STD_M: f64 = 9e-3;
/// Largest chi^2 per row of a frame whose touches are valid: three standard deviations of every row.
const MOST_PER_ROW: f64 = 9.0;

/// Whether a frame is explained: its residual is what the covariance expects.
pub(super) fn is_explained(rows: usize, rest: f64) -> bool {
    rows > 0 && rest <= MOST_PER_ROW * rows as f64
}

/// The touches of the last frame.
#[derive(Debug, Clone)]
pub(super) struct Report {
    skin: Places,
    touches: Vec<Touch>,
    before: Vec<Touch>,
}

impl Report {
    pub(super) fn new(surface: &Surface) -> Self {
        Self {
            // as close as the mesh allows: only to find the triangles around a point
            skin: Places::new(surface, 0.0),
            touches: Vec::with_capacity(2 * MOST_TOUCHES),
            before: Vec::with_capacity(2 * MOST_TOUCHES),
        }
    }

    pub(super) fn touches(&self) -> &[Touch] {
        &self.touches
    }

    /// Takes the state of a frame.
    pub(super) fn push(
        &mut self,
        model: &Model,
        settings: &ScoreSettings,
        touches: &Touches,
        step: &DetectorStep,
        is_whole: bool,
        dt_s: f64,
    ) {
        std::mem::swap(&mut self.touches, &mut self.before);
        self.touches.clear();
        let per_row = step.chi_square_rest / step.rows.max(1) as f64;
        let is_explained = step.is_explained;
        for state in touches.iter() {
            let Some(id) = state.id else { continue };
            let before = self.before.iter().find(|t| t.id == id && t.state != Stage::End);
            let mut touch = self.report(id, state, model, settings, per_row.max(1.0));
            if let Some(before) = before {
                touch.state = Stage::Hold;
                touch.age_frames = before.age_frames + 1;
                touch.age_s = before.age_s + dt_s;
            }
            touch.valid &= is_explained;
            touch.whole = is_whole;
            self.touches.push(touch);
        }
        for before in self.before.iter().filter(|t| t.state != Stage::End) {
            if self.touches.iter().all(|t| t.id != before.id) {
                let age_s = before.age_s + dt_s;
                let age_frames = before.age_frames + 1;
                let ended = Touch { state: Stage::End, valid: false, age_s, age_frames, ..*before };
                self.touches.push(ended);
            }
        }
    }

    /// Reports a touch as one that begins. `excess`: chi^2 per row where it is above 1.
    fn report(
        &self,
        id: u64,
        state: &TouchState,
        model: &Model,
        settings: &ScoreSettings,
        excess: f64,
    ) -> Touch {
        let place = state.spot.place;
        let plane = state.covariance_m2.map(|row| row.map(|c| excess * c));
        let (position_m, normal) = self.skin.on_skin(state.spot.position_m);
        let intensity_s_m2 = settings.sign.factor() * state.strength_m2 * model.conductivity_s;
        let std = (excess * state.strength_variance).sqrt() * model.conductivity_s;
        Touch {
            id,
            state: Stage::Begin,
            position_m,
            normal: Some(normal),
            position_covariance_m2: in_space(plane, *model.grid.tangents(place)),
            velocity_m_s: state.velocity_m_s,
            intensity_s_m2,
            intensity_std_s_m2: Some(std),
            peak_s: intensity_s_m2 * model.dictionary.tops[place],
            learnt: None,
            // errors of the model that look like touches are as likely as the faintest that is shown
            confidence: (1.0 + (0.5 * (settings.shown - state.odds)).exp()).recip(),
            age_frames: 0,
            age_s: 0.0,
            // one that is rather an error of the model is not acted on
            valid: state.odds >= settings.shown && largest(plane) <= MOST_STD_M * MOST_STD_M,
            whole: true,
            split_from: None,
            merged_into: None,
        }
    }
}

/// Largest eigenvalue of a symmetric matrix.
fn largest([[a, b], [_, d]]: [[f64; 2]; 2]) -> f64 {
    0.5 * (a + d) + (0.5 * (a - d)).hypot(b)
}
