//! Results of a simulation: frames and ground truth.

use crate::solve::SolveReport;
use ndarray::{Array1, Array2, Array3};

/// Ground truth of a touch in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct TrueTouch {
    /// Frame index.
    pub frame: usize,
    /// Number of the finger in the script.
    pub finger: u32,
    /// Centre of the touch, metres.
    pub position_m: [f64; 2],
    /// Force, newton.
    pub force_n: f64,
    /// Radius of the fingertip, metres.
    pub tip_radius_m: f64,
    /// Radius of the contact area, metres.
    pub contact_radius_m: f64,
    /// Contact area, square metres.
    pub area_m2: f64,
    /// Deflection at the centre, metres.
    pub depth_m: f64,
}

/// Quality of a measurement: the worst problem that affects it. Files store [`TrueQuality::code`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum TrueQuality {
    /// No problem.
    #[default]
    Good,
    /// The current source reached its compliance voltage.
    SourceLimited,
    /// The converter clipped the value.
    Saturated,
    /// A loose contact of an electrode involved was open.
    Loose,
    /// An electrode involved has no contact.
    Lost,
    /// The value is that of the former frame: this one is torn.
    Torn,
    /// A single value is off by up to the largest voltage.
    Spiked,
}

impl TrueQuality {
    /// Returns the code used in files: 0 good, 1 source limited, 2 saturated, 3 loose contact open,
    /// 4 lost electrode, 5 torn frame, 6 spiked value.
    pub fn code(self) -> u8 {
        self as u8
    }
}

/// Ground truth of a simulation.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Truth {
    /// Mean contact pressure of each pixel, pascal: [frame, row, column], NaN outside the skin.
    pub pressure_pa: Array3<f64>,
    /// Change of the sheet conductivity relative to the untouched skin at time 0, siemens: [frame,
    /// row, column], NaN outside the skin.
    pub conductivity_change_s: Array3<f64>,
    /// The same change for each element of the simulation mesh, [frame, element], if requested
    /// ([`SimulationSettings::keep_elements`](crate::fabric::SimulationSettings)).
    pub element_change_s: Option<Array2<f64>>,
    /// Sheet conductivity of the untouched skin for each element, siemens.
    pub untouched_s: Array1<f64>,
    /// All touches, ordered by frame and then by finger.
    pub touches: Vec<TrueTouch>,
    /// Mean displacement of each electrode, metres: [frame, electrode, x y z].
    pub electrode_shift_m: Array3<f64>,
    /// Contact impedance, ohm metre (rim) or ohm square metre (patch): [frame, electrode].
    pub contact_impedance: Array2<f64>,
    /// Quality of each measurement: [frame, measurement].
    pub quality: Array2<TrueQuality>,
    /// Standard deviation of the instrument's noise, including rounding, volt: one per measurement.
    pub noise_std_v: Array1<f64>,
}

/// Result of a simulation: frames and ground truth.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Simulation {
    /// Values recorded by the instrument, volt: [frame, measurement].
    pub frames_v: Array2<f64>,
    /// Exact voltages before gain, noise and converter, volt: [frame, measurement]. Open contacts
    /// and the compliance limit of the source are included.
    pub exact_v: Array2<f64>,
    /// Exact voltages of the untouched skin at time 0, volt: one per measurement.
    pub reference_v: Array1<f64>,
    /// Touches, pressures and conductivities that the voltages come from.
    pub truth: Truth,
    /// Accuracy and effort of the simulation.
    pub report: SimulationReport,
}

/// Accuracy and effort of a simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct SimulationReport {
    /// Number of simulated frames.
    pub frames: usize,
    /// Number of threads that computed frames in parallel.
    pub threads: usize,
    /// Report of the solve of the untouched skin. Its backward error and expected loss are
    /// representative of all frames.
    pub untouched: SolveReport,
    /// Smallest ratio of a moved triangle's area, seen from +z, to its area at rest.
    pub least_area_ratio: f64,
    /// Range of the converter, volt; `None` without a converter.
    pub range_v: Option<f64>,
    /// Wall time, seconds.
    pub time_s: f64,
}
