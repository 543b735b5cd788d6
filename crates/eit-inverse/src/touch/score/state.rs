//! The state of a touch, and a hypothesis: some touches, and how well they explain a frame.

use super::dictionary::COLUMNS;
use super::places::Spot;
use super::settings::MOST_TOUCHES;
use crate::geometry::distance_m;
use eit_core::vector::sub;

/// Time over which velocities are averaged, seconds.
const VELOCITY_S: f64 = 0.1;
/// Standard deviations beyond which a touch has slid.
const SLID: f64 = 3.0;

/// A touch in the last frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Before {
    pub(super) spot: Spot,
    /// Covariance of its position along the tangents of its place, square metres.
    pub(super) covariance_m2: [[f64; 2]; 2],
    /// Velocity, metres per second.
    pub(super) velocity_m_s: [f64; 3],
    /// 2 ln odds that it is still there, before this frame is seen.
    pub(super) odds: f64,
}

/// All that is known of a touch. It lives from frame to frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct TouchState {
    pub(super) spot: Spot,
    /// Area of doubled conductivity, square metres.
    pub(super) strength_m2: f64,
    /// Velocity, metres per second.
    pub(super) velocity_m_s: [f64; 3],
    /// `None`: it begins with this frame.
    pub(super) before: Option<Before>,
    /// Its id, once it has been shown.
    pub(super) id: Option<u64>,
    /// 2 ln odds that it is there.
    pub(super) odds: f64,
    /// Way that it has slid, metres, and where it was when that was known last.
    pub(super) path_m: f64,
    pub(super) slid_to_m: [f64; 3],
    /// Strength and position at which it has last left a trail.
    pub(super) laid_m2: f64,
    pub(super) laid_at_m: [f64; 3],
    /// From the last fit: covariance of the position along the place's tangents, variance of the strength, and what the touch
    /// and all that it does to the fabric give in the columns of its place.
    pub(super) covariance_m2: [[f64; 2]; 2],
    pub(super) strength_variance: f64,
    pub(super) response: [f64; COLUMNS],
}

impl TouchState {
    pub(super) fn new(spot: Spot) -> Self {
        let [slid_to_m, laid_at_m] = [spot.position_m; 2];
        Self { spot, slid_to_m, laid_at_m, ..Self::default() }
    }

    /// What the next frame knows of it, `dt_s` seconds later; touches end at a rate of `dies_hz`.
    pub(super) fn remembered(&self, dies_hz: f64, dt_s: f64) -> Before {
        let there = (1.0 - (dies_hz * dt_s).min(0.5)) / (1.0 + (-0.5 * self.odds).exp());
        Before {
            spot: self.spot,
            covariance_m2: self.covariance_m2,
            velocity_m_s: self.velocity_m_s,
            odds: 2.0 * (there / (1.0 - there)).ln(),
        }
    }

    /// Updates velocity and way after a frame; errors of the model last for `error_s` seconds.
    pub(super) fn follow(&mut self, error_s: f64, dt_s: f64) {
        let Some(before) = &self.before else {
            self.slid_to_m = self.spot.position_m;
            return;
        };
        let way = sub(self.spot.position_m, before.spot.position_m);
        let weight = (dt_s / VELOCITY_S).min(1.0);
        self.velocity_m_s = std::array::from_fn(|i| {
            before.velocity_m_s[i] + weight * (way[i] / dt_s - before.velocity_m_s[i])
        });
        let spread_m2 = self.covariance_m2[0][0] + self.covariance_m2[1][1];
        let slid_m = distance_m(self.spot.position_m, self.slid_to_m);
        if slid_m * slid_m > SLID * SLID * spread_m2 {
            self.path_m += slid_m;
            self.slid_to_m = self.spot.position_m;
        }
        // what moves more slowly than errors of the model last is one of them
        let weight = (dt_s / error_s).min(1.0);
        for (at, now) in self.slid_to_m.iter_mut().zip(self.spot.position_m) {
            *at += weight * (now - *at);
        }
    }

    /// Squared strength over its variance.
    pub(super) fn wald(&self) -> f64 {
        self.strength_m2 * self.strength_m2 / self.strength_variance.max(f64::MIN_POSITIVE)
    }

    /// Coefficients in the columns of its place of the print and of its derivatives with respect to the position.
    pub(super) fn print(&self) -> [[f64; 6]; 3] {
        let [x, y] = self.spot.step_m;
        [
            [1.0, x, y, 0.5 * x * x, x * y, 0.5 * y * y],
            [0.0, 1.0, 0.0, x, y, 0.0],
            [0.0, 0.0, 1.0, 0.0, x, y],
        ]
    }
}

/// At most [`MOST_TOUCHES`] touches.
#[derive(Debug, Clone, Copy)]
pub(super) struct Touches {
    at: [TouchState; MOST_TOUCHES],
    count: usize,
}

impl Touches {
    pub(super) fn none() -> Self {
        let spot = Spot { place: 0, step_m: [0.0; 2], position_m: [0.0; 3] };
        Self { at: [TouchState::new(spot); MOST_TOUCHES], count: 0 }
    }

    /// Adds a touch, if there is room.
    pub(super) fn with(mut self, touch: TouchState) -> Self {
        if let Some(free) = self.at.get_mut(self.count) {
            *free = touch;
            self.count += 1;
        }
        self
    }

    pub(super) fn without(mut self, k: usize) -> Self {
        if k < self.count {
            self.at.copy_within(k + 1..self.count, k);
            self.count -= 1;
        }
        self
    }
}

impl std::ops::Deref for Touches {
    type Target = [TouchState];

    fn deref(&self) -> &[TouchState] {
        &self.at[..self.count]
    }
}

impl std::ops::DerefMut for Touches {
    fn deref_mut(&mut self) -> &mut [TouchState] {
        &mut self.at[..self.count]
    }
}

/// Touches fitted to a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hypothesis {
    pub(super) touches: Touches,
    /// Squared length of the residual, whitened by everything that touches may do.
    pub(super) chi_square: f64,
    /// -2 log posterior, without what ended touches cost.
    pub(super) score: f64,
    /// Number of rows that count.
    pub(super) rows: usize,
}

impl Hypothesis {
    /// Factor by which variances are larger in a frame that is unlikely as a whole.
    pub(super) fn heat(&self) -> f64 {
        (self.chi_square / self.rows.max(1) as f64).max(1.0)
    }
}
