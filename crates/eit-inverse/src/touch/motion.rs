//! Position of a touch that rests or moves.
//!
//! A filter that follows a slide passes on most of the noise of a finger at rest, and one that averages a finger at
//! rest lags behind a slide. So two filters run, one for each, and the data say which of them holds: interacting
//! multiple models (Blom, Bar-Shalom, *IEEE Trans. Autom. Control* 33 (1988) 780).

use super::filter::Filter;

type Matrix3 = [[f64; 3]; 3];

/// Mean time for which a touch rests, and for which it moves, seconds.
const RESTS_S: f64 = 1.0;
const MOVES_S: f64 = 2.0;

/// Root mean square distance that a resting touch creeps in one second, metres: its contact grows
/// and shrinks with the force.
const CREEP_M: f64 = 1e-3;

/// How touches move.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    /// Root mean square acceleration of a moving touch, m/s^2.
    pub(super) acceleration_m_s2: f64,
    /// Root mean square velocity of one that begins to move, m/s.
    pub(super) velocity_std_m_s: f64,
}

/// Both filters and the probability that the touch rests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    moving: Filter,
    resting: Filter,
    rests: f64,
    /// Combined state of both filters.
    state: Filter,
}

impl Motion {
    pub(super) fn new(position_m: [f64; 3], covariance_m2: Matrix3, pace: Pace) -> Self {
        let moving = Filter::new(position_m, covariance_m2, pace.velocity_std_m_s);
        let resting = Filter::new(position_m, covariance_m2, 0.0);
        let rests = RESTS_S / (RESTS_S + MOVES_S);
        Self {
            state: Filter::mixed([(1.0 - rests, &moving), (rests, &resting)]),
            moving,
            resting,
            rests,
        }
    }

    /// Position and velocity with their covariance.
    pub(super) fn state(&self) -> &Filter {
        &self.state
    }

    /// Predicts the state `dt` seconds later.
    pub(super) fn predict(&mut self, dt: f64, pace: Pace) {
        let [begin, stop] = [RESTS_S, MOVES_S].map(|time_s| -(-dt / time_s).exp_m1());
        let (mut started, mut stopped) = (self.resting, self.moving);
        started.rest(pace.velocity_std_m_s);
        stopped.stop();
        let moves = 1.0 - self.rests;
        let resting = [(self.rests * (1.0 - begin), &self.resting), (moves * stop, &stopped)];
        let moving = [(moves * (1.0 - stop), &self.moving), (self.rests * begin, &started)];
        self.rests = resting[0].0 + resting[1].0;
        (self.resting, self.moving) = (Filter::mixed(resting), Filter::mixed(moving));
        self.moving.predict(dt, pace.acceleration_m_s2);
        self.resting.spread(CREEP_M * CREEP_M * dt);
        self.mix();
    }

    /// Updates the state with a position measured on a skin with the given unit normal.
    pub(super) fn update(&mut self, place_m: [f64; 3], covariance_m2: &Matrix3, normal: [f64; 3]) {
        let density = |filter: &Filter| filter.log_density(place_m, covariance_m2, normal);
        if let (Some(rest), Some(motion)) = (density(&self.resting), density(&self.moving)) {
            let odds = (self.rests / (1.0 - self.rests)).ln() + rest - motion;
            // certainty would never end
            self.rests = (1.0 + (-odds).exp()).recip().clamp(1e-6, 1.0 - 1e-6);
        }
        self.moving.update(place_m, covariance_m2);
        self.resting.update(place_m, covariance_m2);
        self.mix();
    }

    fn mix(&mut self) {
        self.state = Filter::mixed([(1.0 - self.rests, &self.moving), (self.rests, &self.resting)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

    const PACE: Pace = Pace { acceleration_m_s2: 2.0, velocity_std_m_s: 0.3 };
    const DT_S: f64 = 0.05;
    const UP: [f64; 3] = [0.0, 0.0, 1.0];

    fn square(std_m: f64) -> Matrix3 {
        let variance = std_m * std_m;
        [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, 1e-6]]
    }

    /// Root mean square errors of the states along a path, and of the last velocity.
    fn follow(path: &[f64], std_m: f64, seed: u64) -> (Vec<f64>, f64) {
        let mut random = Random::new(seed);
        let mut errors = vec![0.0; path.len()];
        let mut velocity = 0.0;
        let trials = 400;
        for _ in 0..trials {
            let mut place = |x: f64| [x + std_m * random.normal(), std_m * random.normal(), 0.0];
            let mut motion = Motion::new(place(path[0]), square(std_m), PACE);
            for (k, x) in path.iter().enumerate().skip(1) {
                motion.predict(DT_S, PACE);
                motion.update(place(*x), &square(std_m), UP);
                let [a, b, _] = motion.state().position_m;
                errors[k] += ((a - x).powi(2) + b * b) / f64::from(trials);
            }
            velocity += motion.state().velocity_m_s[0] / f64::from(trials);
        }
        (errors.into_iter().map(f64::sqrt).collect(), velocity)
    }

    /// A finger at rest is averaged: after 20 frames its error is below half of that of one frame
    /// (1 / sqrt 20 = 0.22 is the optimum), whatever the noise; with a filter for motion alone it
    /// stays above 0.6.
    #[test]
    fn a_resting_finger_is_averaged() {
        for std_m in [1e-3, 5e-3] {
            let (errors, velocity) = follow(&[0.0; 20], std_m, 3);
            let alone = 2.0_f64.sqrt() * std_m;
            println!("{:.2} of a frame's error", errors[19] / alone);
            assert!(errors[19] < 0.45 * alone, "{} {alone}", errors[19]);
            assert!(velocity.abs() < 0.02, "{velocity}");
        }
    }

    /// A slide of 50 mm/s after a rest is followed with at most the noise of a frame once it is a few frames
    /// old, and with its step of 2.5 mm more when it begins.
    #[test]
    fn a_slide_is_followed() {
        let path: Vec<f64> = (0..40).map(|k| 2.5e-3 * f64::from((k - 15).max(0))).collect();
        let (errors, velocity) = follow(&path, 1e-3, 4);
        let alone = 2.0_f64.sqrt() * 1e-3;
        println!("{:?}", errors.iter().map(|e| (1e5 * e).round() / 100.0).collect::<Vec<_>>());
        let most = errors[16..].iter().copied().fold(0.0, f64::max);
        assert!(most < 2.5e-3 + 0.5 * alone, "{most}");
        assert!(errors[20..].iter().all(|e| *e < 1.1 * alone), "{errors:?}");
        assert!((velocity - 0.05).abs() < 0.01, "{velocity}");
    }

    /// Errors are as large as the covariance states, at rest and in motion.
    #[test]
    fn covariances_are_honest() {
        let mut random = Random::new(5);
        for speed_m_s in [0.0, 0.1] {
            let (mut squared, mut count) = (0.0, 0.0);
            for _ in 0..300 {
                let mut place = |x: f64| [x + 3e-3 * random.normal(), 3e-3 * random.normal(), 0.0];
                let mut motion = Motion::new(place(0.0), square(3e-3), PACE);
                for k in 1..20 {
                    let x = speed_m_s * DT_S * f64::from(k);
                    motion.predict(DT_S, PACE);
                    motion.update(place(x), &square(3e-3), UP);
                    let Filter { position_m: [a, b, _], pp, .. } = motion.state();
                    squared += (a - x).powi(2) / pp[0][0] + b * b / pp[1][1];
                    count += 2.0;
                }
            }
            println!("{speed_m_s} m/s: mean square {:.2}", squared / count);
            // the path is neither of the models: rest without creep, motion without acceleration
            assert!((0.3..1.3).contains(&(squared / count)), "{speed_m_s}: {}", squared / count);
        }
    }
}
