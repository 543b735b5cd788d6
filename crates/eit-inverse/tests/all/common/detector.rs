//! A disc with linear data of touches, for tests of the detector.
//!
//! The data come from a mesh of their own, which shares no position or integral with the detector's.

use super::{RADIUS_M, adjacent, disc, jacobian};
use eit_inverse::touch::{DetectedTouch, DetectorModel, DetectorSettings, TouchDetector};
use eit_mesh::Surface;
use fixtures::Random;
use ndarray::{Array1, Array2, Axis};
use std::sync::LazyLock;

pub const ELECTRODES: usize = 16;
pub const MEASUREMENTS: usize = 208;
pub const DT_S: f64 = 0.05;

/// Strength of a finger of 1 N on a sheet of 1 S, S m^2.
pub const FINGER: f64 = 1e-5;

/// Noise: 80 dB below the largest voltage.
pub const NOISE: f64 = 1e-4;

/// A disc of 1 S with its voltages for 1 A.
pub struct Disc {
    pub surface: Surface,
    pub jacobian: Array2<f64>,
    /// `v = -J sigma`: voltages are homogeneous of degree -1 in the conductivity.
    pub model_v: Vec<f64>,
    /// Effect of the sheet as a whole, one standard deviation of 0.1 %.
    pub unknowns: Array2<f64>,
    pub reciprocal: Vec<usize>,
    pub noise_std_v: Vec<f64>,
    pub quiet_v: Array2<f64>,
}

impl Disc {
    pub fn new(rings: usize) -> Self {
        let surface = disc(RADIUS_M, rings);
        let jacobian = jacobian(&surface, ELECTRODES);
        let model_v = -jacobian.sum_axis(Axis(1));
        let quadruples = adjacent(ELECTRODES);
        let twin = |&[a, b, m, n]: &[usize; 4]| {
            quadruples.iter().position(|other| *other == [m, n, a, b]).unwrap()
        };
        let largest = model_v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        Self {
            unknowns: (&model_v * 1e-3).insert_axis(Axis(1)),
            reciprocal: quadruples.iter().map(twin).collect(),
            noise_std_v: vec![NOISE * largest; MEASUREMENTS],
            quiet_v: Array2::zeros((0, MEASUREMENTS)),
            model_v: model_v.to_vec(),
            surface,
            jacobian,
        }
    }

    pub fn model<'a>(&'a self, used: &'a [bool]) -> DetectorModel<'a> {
        DetectorModel {
            surface: &self.surface,
            jacobian: &self.jacobian,
            model_v: &self.model_v,
            unknowns: &self.unknowns,
            kinds: &[],
            reference_v: &self.model_v,
            noise_std_v: &self.noise_std_v,
            quiet_v: self.quiet_v.view(),
            used,
            reciprocal: &self.reciprocal,
            of_electrode: &[],
        }
    }

    pub fn detector(&self, least_s_m2: f64) -> TouchDetector {
        let settings = DetectorSettings::with_least(least_s_m2);
        TouchDetector::new(&self.model(&[true; MEASUREMENTS]), settings).unwrap()
    }

    /// Voltage changes by a finger: a bell of 7 mm with a tail of 5 % and 12 mm, zero beyond 38.5 mm.
    pub fn touch_v(&self, [x, y]: [f64; 2], strength_s_m2: f64) -> Array1<f64> {
        let bell = |c: &[f64; 3]| {
            let d_m = (c[0] - x).hypot(c[1] - y);
            let bell = (-(d_m / 7e-3).powi(2)).exp() + 0.05 * (-d_m / 12e-3).exp();
            if d_m < 5.5 * 7e-3 { bell } else { 0.0 }
        };
        let mut change: Array1<f64> = self.surface.centroids().iter().map(bell).collect();
        let whole: f64 = change.iter().zip(self.surface.areas_m2()).map(|(b, a)| a * b).sum();
        change *= strength_s_m2 / whole;
        self.jacobian.dot(&change)
    }
}

/// Edges of 5 mm, as in a mesh for practical use.
pub static SKIN: LazyLock<Disc> = LazyLock::new(|| Disc::new(20));

/// Edges of 2.7 mm: the mesh of the data.
pub static TRUTH: LazyLock<Disc> = LazyLock::new(|| Disc::new(37));

/// Returns the reference with touches.
pub fn touched(touches: &[([f64; 2], f64)]) -> Vec<f64> {
    let mut frame = Array1::from(SKIN.model_v.clone());
    touches.iter().for_each(|&(at, strength)| frame += &TRUTH.touch_v(at, strength));
    frame.to_vec()
}

/// A frame with touches and noise.
pub fn noisy(random: &mut Random, touches: &[([f64; 2], f64)]) -> Vec<f64> {
    random.noisy(&touched(touches), SKIN.noise_std_v[0])
}

pub fn push(detector: &mut TouchDetector, frame: &[f64]) -> Vec<DetectedTouch> {
    detector.push(frame, |_| false, DT_S).unwrap();
    detector.touches().to_vec()
}

pub fn distance_m(touch: &DetectedTouch, at: [f64; 2]) -> f64 {
    (touch.position_m[0] - at[0]).hypot(touch.position_m[1] - at[1])
}

/// Random position within a fraction of the disc's radius.
pub fn place(random: &mut Random, part: f64) -> [f64; 2] {
    let (r, angle) = (part * RADIUS_M * random.uniform().sqrt(), random.between(0.0, 6.3));
    [r * angle.cos(), r * angle.sin()]
}

/// `(p - c)' C^-1 (p - c)` in the plane: mean 2, variance 4 if `C` is the covariance of `p`.
pub fn normalised_squared(touch: &DetectedTouch, at: [f64; 2]) -> f64 {
    let [x, y] = [0, 1].map(|k| touch.position_m[k] - at[k]);
    let [[a, b, _], [_, d, _], _] = touch.position_covariance_m2;
    (d * x * x - 2.0 * b * x * y + a * y * y) / (a * d - b * b)
}
