//! Fingers drawn from a seed on the paper's disc of 0.1 m.

use eit_skin::eit_fem::fabric::{Finger, Key, Random, Tip, TouchScript};
use std::ops::Range;

pub const RATE_HZ: f64 = 20.0;

/// First frames without a finger: reference and noise.
pub const QUIET_FRAMES: usize = 40;

/// First press, after the quiet frames.
pub const FIRST_S: f64 = 2.1;

/// Largest distance from the middle, metres.
const WITHIN_M: f64 = 0.092;

/// Minimum distance between two fingers, metres.
const APART_M: f64 = 0.04;

const TIP_M: f64 = 0.01;
const RAMP_S: f64 = 0.2;
const HOLD_S: f64 = 0.7;
const GAP_S: f64 = 0.5;

type Place = [f64; 2];

/// Presses and strokes of several fingers, one after the other.
pub struct Drawn {
    random: Random,
    fingers: Vec<Finger>,
    /// Time of the next press, seconds.
    pub next_s: f64,
    end_s: f64,
}

impl Drawn {
    pub fn new(seed: u64, fingers: u32) -> Self {
        let finger = |id| Finger {
            id,
            tip: Tip::Round,
            interpolation: Default::default(),
            keys: Vec::new(),
        };
        Self {
            random: Random::named(seed, "places", 0),
            fingers: (1..=fingers).map(finger).collect(),
            next_s: FIRST_S,
            end_s: 0.0,
        }
    }

    /// All fingers press at once, at places of their own.
    pub fn press(&mut self, force_n: Range<f64>) -> &mut Self {
        let mut taken: Vec<Place> = Vec::new();
        for finger in 0..self.fingers.len() {
            let at = self.place(&taken);
            taken.push(at);
            let force_n = self.random.between(force_n.start, force_n.end);
            self.add(finger, [at, at], force_n, HOLD_S);
        }
        self.next_s += 2.0 * RAMP_S + HOLD_S + GAP_S;
        self
    }

    /// All fingers press at once, at these places.
    pub fn press_at(&mut self, places: &[Place], force_n: Range<f64>) -> &mut Self {
        for (finger, &at) in places.iter().enumerate() {
            let force_n = self.random.between(force_n.start, force_n.end);
            self.add(finger, [at, at], force_n, HOLD_S);
        }
        self.next_s += 2.0 * RAMP_S + HOLD_S + GAP_S;
        self
    }

    /// The first finger moves along a chord of 60 mm or more.
    pub fn slide(&mut self, force_n: f64, speed_m_s: f64) -> &mut Self {
        let from = self.place(&[]);
        let mut to = from;
        while distance_m(from, to) < 0.06 {
            to = self.place(&[]);
        }
        self.slide_along([from, to], force_n, speed_m_s)
    }

    /// The first finger moves from one place to another.
    pub fn slide_along(&mut self, way: [Place; 2], force_n: f64, speed_m_s: f64) -> &mut Self {
        let time_s = distance_m(way[0], way[1]) / speed_m_s;
        self.add(0, way, force_n, time_s);
        self.next_s += time_s + 2.0 * RAMP_S + GAP_S;
        self
    }

    /// All fingers press at once, at the corners of a regular polygon about the middle of the disc.
    pub fn ring(&mut self, radius_m: f64, first_angle: f64, force_n: f64) -> &mut Self {
        let count = self.fingers.len();
        for finger in 0..count {
            let angle = first_angle + std::f64::consts::TAU * finger as f64 / count as f64;
            let at = [radius_m * angle.cos(), radius_m * angle.sin()];
            self.add(finger, [at, at], force_n, HOLD_S);
        }
        self.next_s += 2.0 * RAMP_S + HOLD_S + GAP_S;
        self
    }

    /// The first two fingers press at the ends of a line through the middle of the disc, move towards each other at
    /// 50 mm/s, wait half a second and part again.
    pub fn close_in(&mut self, angle: f64, force_n: f64, far_m: f64, near_m: f64) -> &mut Self {
        let time_s = 0.5 * (far_m - near_m) / 0.05;
        let begin_s = self.next_s;
        for (finger, turn) in self.fingers.iter_mut().zip([0.0, std::f64::consts::PI]) {
            let mut now_s = begin_s;
            let mut key = |wait_s: f64, apart_m: f64, force_n: f64| {
                now_s += wait_s;
                let (sin, cos) = (angle + turn).sin_cos();
                let position_m = [0.5 * apart_m * cos, 0.5 * apart_m * sin];
                finger.keys.push(Key { time_s: now_s, position_m, force_n, radius_m: TIP_M });
            };
            key(0.0, far_m, 0.0);
            key(RAMP_S, far_m, force_n);
            key(time_s, near_m, force_n);
            key(0.5, near_m, force_n);
            key(time_s, far_m, force_n);
            key(RAMP_S, far_m, 0.0);
        }
        self.end_s = begin_s + 2.0 * (RAMP_S + time_s) + 0.5;
        self.next_s = self.end_s + GAP_S;
        self
    }

    /// The script, followed by a second without touches.
    pub fn script(&self) -> TouchScript {
        TouchScript {
            name: String::new(),
            frame_rate_hz: RATE_HZ,
            frames: ((self.end_s + 1.0) * RATE_HZ) as usize,
            quiet_frames: QUIET_FRAMES,
            fingers: self.fingers.clone(),
        }
    }

    fn add(&mut self, finger: usize, [from, to]: [Place; 2], force_n: f64, hold_s: f64) {
        let begin_s = self.next_s;
        let key =
            |time_s, position_m, force_n| Key { time_s, position_m, force_n, radius_m: TIP_M };
        let end_s = begin_s + hold_s + 2.0 * RAMP_S;
        self.fingers[finger].keys.extend([
            key(begin_s, from, 0.0),
            key(begin_s + RAMP_S, from, force_n),
            key(begin_s + RAMP_S + hold_s, to, force_n),
            key(end_s, to, 0.0),
        ]);
        self.end_s = self.end_s.max(end_s);
    }

    fn place(&mut self, taken: &[Place]) -> Place {
        loop {
            let at = [0; 2].map(|_| self.random.between(-WITHIN_M, WITHIN_M));
            if at[0].hypot(at[1]) <= WITHIN_M
                && taken.iter().all(|other| distance_m(*other, at) >= APART_M)
            {
                return at;
            }
        }
    }
}

pub fn distance_m(a: Place, b: Place) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
