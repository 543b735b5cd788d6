//! Fingers drawn from a seed on the paper's disc of 0.1 m.

use eit_skin::eit_fem::fabric::{Finger, Key, Random, Tip, TouchScript};
use std::f64::consts::{PI, TAU};
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

/// Force and speed of a finger that slides.
const SLIDE_N: f64 = 1.5;
const SLIDE_M_S: f64 = 0.05;

type Place = [f64; 2];

/// Presses and strokes of several fingers, one after the other.
pub struct Drawn {
    random: Random,
    fingers: Vec<Finger>,
    /// Time of the next press, seconds.
    pub next_s: f64,
}

impl Drawn {
    pub fn new(seed: u64, fingers: u32) -> Self {
        let (tip, interpolation) = (Tip::Round, Default::default());
        let finger = |id| Finger { id, tip, interpolation, keys: Vec::new() };
        Self {
            random: Random::named(seed, "places", 0),
            fingers: (1..=fingers).map(finger).collect(),
            next_s: FIRST_S,
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
        self.after(HOLD_S)
    }

    pub fn presses(&mut self, count: usize, force_n: Range<f64>) {
        (0..count).for_each(|_| _ = self.press(force_n.clone()));
    }

    /// All fingers press at once, at these places.
    pub fn press_at(&mut self, places: &[Place], force_n: Range<f64>) -> &mut Self {
        for (finger, &at) in places.iter().enumerate() {
            let force_n = self.random.between(force_n.start, force_n.end);
            self.add(finger, [at, at], force_n, HOLD_S);
        }
        self.after(HOLD_S)
    }

    /// All fingers press at once, at the corners of a regular polygon about the middle of the disc.
    pub fn ring(&mut self, radius_m: f64, first_angle: f64, force_n: f64) -> &mut Self {
        let count = self.fingers.len();
        let angle = |finger: usize| first_angle + TAU * finger as f64 / count as f64;
        let corners: Vec<Place> = (0..count).map(|k| polar(radius_m, angle(k))).collect();
        self.press_at(&corners, force_n..force_n)
    }

    pub fn hold(&mut self, at: Place, force_n: f64, time_s: f64) -> &mut Self {
        self.add(0, [at, at], force_n, time_s);
        self.after(time_s)
    }

    /// The first finger moves along a chord of 60 mm or more.
    pub fn slide(&mut self) -> &mut Self {
        let from = self.place(&[]);
        let mut to = from;
        while distance_m(from, to) < 0.06 {
            to = self.place(&[]);
        }
        self.slide_along([from, to])
    }

    pub fn slide_along(&mut self, way: [Place; 2]) -> &mut Self {
        let time_s = distance_m(way[0], way[1]) / SLIDE_M_S;
        self.add(0, way, SLIDE_N, time_s);
        self.after(time_s)
    }

    /// The first two fingers press, move towards each other through the middle of the disc, wait half a second and part.
    pub fn close_in(&mut self, angle: f64, force_n: f64, far_m: f64, near_m: f64) -> &mut Self {
        let time_s = 0.5 * (far_m - near_m) / SLIDE_M_S;
        for (finger, turn) in self.fingers.iter_mut().zip([0.0, PI]) {
            let mut now_s = self.next_s;
            let waits_s = [0.0, RAMP_S, time_s, 0.5, time_s, RAMP_S];
            let apart_m = [far_m, far_m, near_m, near_m, far_m, far_m];
            let forces_n = [0.0, force_n, force_n, force_n, force_n, 0.0];
            for ((wait_s, apart_m), force_n) in waits_s.into_iter().zip(apart_m).zip(forces_n) {
                now_s += wait_s;
                finger.keys.push(key(now_s, polar(0.5 * apart_m, angle + turn), force_n));
            }
        }
        self.after(2.0 * time_s + 0.5)
    }

    /// The script, followed by a second without touches.
    pub fn script(&self) -> TouchScript {
        TouchScript {
            name: String::new(),
            frame_rate_hz: RATE_HZ,
            frames: ((self.next_s - GAP_S + 1.0) * RATE_HZ) as usize,
            quiet_frames: QUIET_FRAMES,
            fingers: self.fingers.clone(),
        }
    }

    fn add(&mut self, finger: usize, [from, to]: [Place; 2], force_n: f64, hold_s: f64) {
        let down_s = self.next_s + RAMP_S;
        self.fingers[finger].keys.extend([
            key(self.next_s, from, 0.0),
            key(down_s, from, force_n),
            key(down_s + hold_s, to, force_n),
            key(down_s + hold_s + RAMP_S, to, 0.0),
        ]);
    }

    /// The next press comes after one that is held for this time.
    fn after(&mut self, hold_s: f64) -> &mut Self {
        self.next_s += 2.0 * RAMP_S + hold_s + GAP_S;
        self
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

fn key(time_s: f64, position_m: Place, force_n: f64) -> Key {
    Key { time_s, position_m, force_n, radius_m: TIP_M }
}

pub fn polar(radius_m: f64, angle: f64) -> Place {
    [radius_m * angle.cos(), radius_m * angle.sin()]
}

pub fn distance_m(a: Place, b: Place) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
