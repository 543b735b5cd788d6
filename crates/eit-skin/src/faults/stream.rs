//! Detects faulty electrodes in an instrument's frames without a model of the skin.

use super::monitor::{FaultMonitor, check_time};
use super::protocol::Wiring;
use super::reference::{median, of_start};
use super::{ElectrodeFault, FaultKind};
use crate::error::SkinError;
use eit_fem::Protocol;
use eit_hw::{MeasuredFrames, Quadruple};
use eit_inverse::{noise_std_of_quiet_frames, smallest_step};
use ndarray::Array2;

/// Time constant with which the reference follows the frames, seconds. Slow relative drift of
/// reciprocal halves is not a fault that this monitor detects.
const FOLLOW_S: f64 = 30.0;
/// Fraction of their reference by which reciprocal halves may differ. The measurements of a frame are taken
/// in sequence, and the reference contains no touches: on a Sciospec instrument from which an object is
/// lifted quickly, half of an electrode's pairs reach 0.2 %. Noise of 0.2 % of the largest voltage is still
/// detected.
const WRONG_DRIFT: f64 = 3e-3;
/// Noise of values that never change, as a fraction of the median noise.
const STILL_NOISE: f64 = 1e-6;
/// Assumed time between frames without a time stamp, seconds.
const UNKNOWN_PERIOD_S: f64 = 0.05;

/// Detects faulty electrodes in an instrument's frames without a model. The first frames are the reference,
/// touched or not, because touches are reciprocal.
///
/// Detects open, shorted, noisy, stuck and flagged electrodes. A drifting gain is reciprocal and requires the
/// model: see [`FaultMonitor::blame`]. Does not allocate once the reference has been taken.
#[derive(Debug, Clone)]
pub struct StreamMonitor {
    protocol: Protocol,
    /// Measurements without a driven electrode; the others have no reciprocal among them.
    used: Vec<bool>,
    /// The first frames, `[frame, measurement]`; NaN where a value is bad.
    first: Array2<f64>,
    frames: usize,
    reference: Vec<f64>,
    before_s: f64,
    monitor: Option<FaultMonitor>,
}

impl StreamMonitor {
    /// Creates a monitor for frames of these measurements, in this order; the first `reference_frames` are
    /// the reference.
    ///
    /// # Errors
    ///
    /// No measurements; an electrode index out of range; fewer than 3 frames.
    pub fn new(
        quadruples: &[Quadruple],
        electrodes: usize,
        reference_frames: usize,
    ) -> Result<Self, SkinError> {
        if reference_frames < 3 {
            let (key, value) = ("reference_frames", reference_frames as f64);
            return Err(SkinError::OutOfRange { key, value, must: "3 or more" });
        }
        // voltages are compared with each other only: the current does not matter
        let protocol = Protocol::from_quadruples(electrodes, quadruples, 1.0)?;
        let is_apart = |&[a, b, m, n]: &Quadruple| a != m && a != n && b != m && b != n;
        Ok(Self {
            protocol,
            used: quadruples.iter().map(is_apart).collect(),
            first: Array2::zeros((reference_frames, quadruples.len())),
            frames: 0,
            reference: vec![0.0; quadruples.len()],
            before_s: 0.0,
            monitor: None,
        })
    }

    /// Starts again: the next frames are the reference.
    pub fn restart(&mut self) {
        (self.frames, self.monitor) = (0, None);
    }

    /// Processes a frame `[measurement]` in any unit; `is_good` tells which values are not flagged.
    ///
    /// # Errors
    ///
    /// A frame with the wrong length; a time that is not finite. The monitor is then unchanged.
    pub fn push(
        &mut self,
        values: &[f64],
        is_good: impl Fn(usize) -> bool,
        time_s: f64,
    ) -> Result<(), SkinError> {
        SkinError::check_measurements("the frame", values.len(), self.used.len())?;
        check_time(time_s)?;
        let Some(monitor) = &mut self.monitor else {
            for (i, slot) in self.first.row_mut(self.frames).iter_mut().enumerate() {
                *slot = if is_good(i) { values[i] } else { f64::NAN };
            }
            self.frames += 1;
            self.before_s = time_s;
            if self.frames == self.first.nrows() {
                self.monitor = Some(self.begin(time_s)?);
            }
            return Ok(());
        };
        monitor.push(values, &self.reference, is_good, time_s)?;
        for &i in monitor.healed() {
            self.reference[i] = values[i];
        }
        let weight = -(-(time_s - self.before_s).max(0.0) / FOLLOW_S).exp_m1();
        self.before_s = time_s;
        for (i, reference) in self.reference.iter_mut().enumerate() {
            if self.used[i] && !monitor.is_missing(i) {
                *reference += weight * (values[i] - *reference);
            }
        }
        Ok(())
    }

    /// Returns the electrodes that are faulty in the last frame, in ascending order; none while the reference
    /// is taken.
    pub fn faults(&self) -> &[ElectrodeFault] {
        self.monitor.as_ref().map_or(&[], FaultMonitor::faults)
    }

    /// The first frames as differences of reciprocals divided by the square root of 2: as noisy as a
    /// measurement, and free of touches.
    fn without_touches(&self, reciprocal: &[usize]) -> Array2<f64> {
        Array2::from_shape_fn(self.first.dim(), |(frame, i)| match reciprocal[i] {
            twin if twin == i => self.first[[frame, i]],
            twin => {
                (self.first[[frame, i]] - self.first[[frame, twin]])
                    * std::f64::consts::FRAC_1_SQRT_2
            }
        })
    }

    /// Computes reference and noise from the first frames, and the electrodes that are faulty in them.
    fn begin(&mut self, time_s: f64) -> Result<FaultMonitor, SkinError> {
        for (mut channel, reference) in
            self.first.columns_mut().into_iter().zip(&mut self.reference)
        {
            let good = channel.iter().filter(|value| value.is_finite());
            let (sum, count) = good.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
            *reference = if count > 0.0 { sum / count } else { 0.0 };
            // the monitor excludes bad values frame by frame; the noise is that of the others
            channel.mapv_inplace(|v| if v.is_finite() { v } else { *reference });
        }
        let typical = median(&self.reference, &self.used);
        let least = STILL_NOISE * typical;
        let wiring = Wiring::new(&self.protocol, &self.used);
        let mut std: Vec<f64> =
            match noise_std_of_quiet_frames(self.without_touches(&wiring.reciprocal).view()) {
                Ok(std) => std.into_iter().map(|std| std.max(least)).collect(),
                // all frames are equal
                Err(_) => vec![least; self.used.len()],
            };
        let found = of_start(&wiring, &self.used, &std, &self.reference, self.first.nrows());
        // the measured values of a floating electrode are not its noise
        let common = median(&std, &self.used);
        for &i in found.iter().flat_map(|&e| &wiring.of_electrode[e]) {
            std[i] = common;
        }
        let step = smallest_step(self.first.view());
        let mut monitor = FaultMonitor::new(&self.protocol, &self.used, &std, step)?
            .with_wrong_drift(WRONG_DRIFT);
        for &electrode in &found {
            monitor.condemn(electrode, FaultKind::Contradicts, time_s);
            // its values once it recovers are unknown: assume the typical size, and reciprocity
            wiring.of_electrode[electrode].iter().for_each(|&i| self.reference[i] = typical);
        }
        monitor.leave_out();
        Ok(monitor)
    }
}

/// Finds the electrodes that fail at any time in an instrument's frames, without a model, in ascending order;
/// returns the first fault of each.
///
/// # Errors
///
/// The errors of [`StreamMonitor`].
pub(crate) fn of_frames(
    quadruples: &[Quadruple],
    electrodes: usize,
    frames: &MeasuredFrames,
) -> Result<Vec<ElectrodeFault>, SkinError> {
    let count = frames.values.nrows();
    let mut monitor = StreamMonitor::new(quadruples, electrodes, count)?;
    let mut found: Vec<ElectrodeFault> = Vec::new();
    // all frames form the reference; then each is compared with it
    for k in 0..2 * count {
        let (frame, time_s) = (k % count, k as f64 * UNKNOWN_PERIOD_S);
        let values: Vec<f64> = frames.values.row(frame).to_vec();
        let quality = frames.quality.row(frame);
        monitor.push(&values, |i| quality[i].is_good(), time_s)?;
        for fault in monitor.faults() {
            if found.iter().all(|other| other.electrode != fault.electrode) {
                found.push(*fault);
            }
        }
    }
    found.sort_by_key(|fault| fault.electrode);
    Ok(found)
}
