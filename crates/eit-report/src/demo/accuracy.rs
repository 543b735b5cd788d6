//! Compares the live results with the true images and touches.

use super::live::LiveRun;
use super::paper::squared_error;
use eit_core::median;
use eit_fem::fabric::Simulation;
use eit_inverse::touch::Touch;
use ndarray::{Array2, Axis};
use serde_json::{Value, json};

/// A touch farther than this from every finger is false; a finger is 2 cm wide.
const WITHIN_M: f64 = 0.025;

/// Accuracy of images and touches.
#[derive(Default)]
pub(super) struct Accuracy {
    /// For each image: frame of the script, mean squared error before and after the network
    /// (siemens squared), and whether a finger is on the skin.
    pub errors: Vec<ImageError>,
    /// Touches that belong to a finger.
    pub pairs: Vec<Pair>,
    /// Number of fingers on the skin, summed over all frames, and how many of them were found.
    pub fingers: usize,
    pub found: usize,
    /// False touches, and those of them in frames without any finger; the latter are mostly caused
    /// by hysteresis of the fabric after a finger has left.
    pub false_touches: usize,
    pub without_finger: usize,
    /// Fingers not found in the first frame of their contact, because a touch is reported only
    /// after two frames.
    pub late: usize,
}

/// A touch and its finger.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    /// Frame of the script, and number of the touch.
    pub frame: usize,
    pub touch: u64,
    pub distance_m: f64,
}

/// Errors of one image.
#[derive(Debug, Clone, Copy)]
pub(super) struct ImageError {
    pub frame: usize,
    pub raw: f64,
    pub made: f64,
    /// Mean square of the truth, siemens squared.
    pub truth: f64,
    pub is_touched: bool,
}

impl ImageError {
    /// Root mean square errors before and after the network, relative to the root mean square of the truth.
    pub(crate) fn relative(&self) -> [f64; 2] {
        [self.raw, self.made].map(|error| (error / self.truth).sqrt())
    }
}

impl Accuracy {
    /// Compares the live results with the simulation.
    pub(super) fn of(live: &LiveRun, truth: &Simulation) -> Self {
        let mut accuracy = Self::default();
        let images = &truth.truth.conductivity_change_s;
        let mut before: usize = 0;
        for (k, &frame) in live.frames.iter().enumerate() {
            // an instrument that continues after the last frame starts again
            let row = frame % images.len_of(Axis(0));
            let really = images.index_axis(Axis(0), row);
            let fingers: Vec<[f64; 2]> = truth
                .truth
                .touches
                .iter()
                .filter(|t| t.frame == row)
                .map(|t| t.position_m)
                .collect();
            accuracy.errors.push(ImageError {
                frame: row,
                raw: squared_error(live.raw.index_axis(Axis(0), k), really),
                made: squared_error(live.made.index_axis(Axis(0), k), really),
                truth: squared_error(really, Array2::zeros(really.dim()).view()),
                is_touched: !fingers.is_empty(),
            });
            let found = accuracy.pair(row, &fingers, &live.touches[k]);
            before = if fingers.is_empty() { 0 } else { before + 1 };
            // two frames of three must show a touch before it is reported
            if before == 1 {
                accuracy.late += fingers.len() - found;
            }
        }
        accuracy
    }

    /// Pairs fingers with touches, nearest first, and returns the number of fingers found.
    fn pair(&mut self, frame: usize, fingers: &[[f64; 2]], touches: &[Touch]) -> usize {
        let touches: Vec<&Touch> = touches.iter().filter(|touch| touch.valid).collect();
        let distance = |finger: &[f64; 2], touch: &Touch| {
            (finger[0] - touch.position_m[0]).hypot(finger[1] - touch.position_m[1])
        };
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (f, finger) in fingers.iter().enumerate() {
            let of = touches.iter().enumerate().map(|(t, touch)| (distance(finger, touch), f, t));
            pairs.extend(of.filter(|pair| pair.0 <= WITHIN_M));
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut is_found, mut is_meant) = (vec![false; fingers.len()], vec![false; touches.len()]);
        for (distance_m, f, t) in pairs {
            if !is_found[f] && !is_meant[t] {
                (is_found[f], is_meant[t]) = (true, true);
                self.pairs.push(Pair { frame, touch: touches[t].id, distance_m });
            }
        }
        let found = is_found.iter().filter(|found| **found).count();
        self.fingers += fingers.len();
        self.found += found;
        self.false_touches += touches.len() - found;
        self.without_finger += if fingers.is_empty() { touches.len() } else { 0 };
        found
    }

    /// Median errors of the frames with touches: raw, after the network, and the ratio of the two.
    pub(crate) fn errors_of_touched(&self) -> [f64; 3] {
        let touched = || self.errors.iter().filter(|error| error.is_touched);
        [
            median(touched().map(|error| error.raw)).unwrap_or(f64::NAN),
            median(touched().map(|error| error.made)).unwrap_or(f64::NAN),
            median(touched().map(|error| error.made / error.raw)).unwrap_or(f64::NAN),
        ]
    }

    /// Median relative errors of the images of frames with touches, before and after the network.
    pub(crate) fn relative_errors(&self) -> [f64; 2] {
        let touched = || self.errors.iter().filter(|error| error.is_touched);
        [0, 1].map(|k| median(touched().map(|error| error.relative()[k])).unwrap_or(f64::NAN))
    }

    /// Median distance of a touch from its finger, metres.
    pub(crate) fn distance_m(&self) -> f64 {
        median(self.pairs.iter().map(|pair| pair.distance_m)).unwrap_or(f64::NAN)
    }

    /// Largest distance of a touch from its finger, metres; `None` without touches.
    pub(crate) fn worst_distance_m(&self) -> Option<f64> {
        self.pairs.iter().map(|pair| pair.distance_m).reduce(f64::max)
    }

    /// Returns the results as JSON.
    pub(crate) fn json(&self) -> Value {
        let [raw, made, quotient] = self.errors_of_touched();
        let [relative_raw, relative] = self.relative_errors();
        json!({
            "relative_error_raw": relative_raw,
            "relative_error": relative,
            "mean_squared_error_raw_s2": raw,
            "mean_squared_error_s2": made,
            "error_over_raw": quotient,
            "fingers": self.fingers,
            "found": self.found,
            "not_yet_reported": self.late,
            "invented": self.false_touches,
            "invented_without_finger": self.without_finger,
            "position_error_m": self.distance_m(),
            "worst_position_error_m": self.worst_distance_m(),
        })
    }
}
