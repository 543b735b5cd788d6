//! What really was, for every frame.

use crate::solve::SolveReport;
use ndarray::{Array1, Array2, Array3};

/// A touch as it was in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueTouch {
    /// Frame.
    pub frame: usize,
    /// The finger's number in the script.
    pub finger: u32,
    /// Middle, metres.
    pub position_m: [f64; 2],
    /// Force, newton.
    pub force_n: f64,
    /// Radius of the fingertip, metres.
    pub tip_radius_m: f64,
    /// Radius of contact, metres.
    pub contact_radius_m: f64,
    /// Area of contact, square metres.
    pub area_m2: f64,
    /// Deflection in the middle, metres.
    pub depth_m: f64,
}

/// Why a measurement is bad, the worst reason; [`TrueQuality::code`] writes it into files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum TrueQuality {
    /// As it should be.
    #[default]
    Good,
    /// The current source gave up.
    SourceLimited,
    /// The converter clipped it.
    Saturated,
    /// A loose contact that takes part was open.
    Loose,
    /// An electrode without contact takes part.
    Lost,
}

impl TrueQuality {
    /// 0 good, 1 source limited, 2 saturated, 3 loose contact open, 4 lost electrode.
    pub fn code(self) -> u8 {
        self as u8
    }
}

/// Ground truth of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Contact pressure, pascal, mean of each pixel: [frame, row, column], NaN outside the skin.
    pub pressure_pa: Array3<f64>,
    /// Sheet conductivity less that of the untouched skin at time 0, siemens:
    /// [frame, row, column], NaN outside the skin.
    pub conductivity_change_s: Array3<f64>,
    /// The same by element of the simulating mesh, [frame, element], if it was asked for.
    pub element_change_s: Option<Array2<f64>>,
    /// Sheet conductivity of the untouched skin by element, siemens.
    pub untouched_s: Array1<f64>,
    /// Every touch of every frame, in the order of frames and fingers.
    pub touches: Vec<TrueTouch>,
    /// Mean displacement of each electrode, metres: [frame, electrode, x y z].
    pub electrode_shift_m: Array3<f64>,
    /// Contact impedance, ohm metre (rim) or ohm square metre (patch): [frame, electrode].
    pub contact_impedance: Array2<f64>,
    /// Why a measurement is bad: [frame, measurement].
    pub quality: Array2<TrueQuality>,
    /// Standard deviation of the instrument's noise, rounding included, volt: one per
    /// measurement.
    pub noise_std_v: Array1<f64>,
}

/// Frames and truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// What the instrument wrote down, volt: [frame, measurement].
    pub frames_v: Array2<f64>,
    /// The same without instrument, volt; with open contacts and a source that gives up.
    pub exact_v: Array2<f64>,
    /// The untouched skin at time 0 without instrument, volt: one per measurement.
    pub reference_v: Array1<f64>,
    /// What really was.
    pub truth: Truth,
    /// How it went.
    pub report: SimulationReport,
}

/// How a simulation went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulationReport {
    /// Frames solved.
    pub frames: usize,
    /// Threads used.
    pub threads: usize,
    /// Solve of the untouched skin: backward error and expected loss hold for all frames alike.
    pub untouched: SolveReport,
    /// Smallest area of a moved triangle, seen from +z, over its area at rest.
    pub least_area_ratio: f64,
    /// Range of the converter, volt.
    pub range_v: Option<f64>,
    /// Wall time, seconds.
    pub time_s: f64,
}
