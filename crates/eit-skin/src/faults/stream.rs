//! Faulty electrodes in the frames of an instrument, without a model of the skin.

use super::monitor::FaultMonitor;
use super::protocol::Wiring;
use super::reference::{median, of_start};
use super::{ElectrodeFault, FaultKind};
use crate::error::SkinError;
use eit_fem::Protocol;
use eit_hw::{MeasuredFrames, Quadruple};
use eit_inverse::{noise_std_of_quiet_frames, smallest_step};
use ndarray::Array2;

/// Time in which the reference follows the frames, seconds: slow drift of reciprocal halves against each
/// other is none of the faults that this looks for.
const FOLLOW_S: f64 = 30.0;
/// Part of their reference by which reciprocal halves may differ. A frame's measurements are taken one
/// after the other, and the reference knows no touches: a Sciospec instrument whose object is lifted fast
/// reaches 0.2 % for half of an electrode's pairs. Noise of 0.2 % of the largest voltage is found still.
const WRONG_DRIFT: f64 = 3e-3;
/// Noise of values that never change, as a part of the median one.
const STILL_NOISE: f64 = 1e-6;
/// Time between frames that have no time, seconds.
const UNKNOWN_PERIOD_S: f64 = 0.05;

/// Looks for faulty electrodes in the frames of an instrument, without a model: the first frames are the
/// reference, touched or not, since touches are reciprocal.
///
/// Finds what is open, shorted, noisy, stuck or flagged. A gain that drifts is reciprocal and needs the
/// model: see [`FaultMonitor::blame`]. Allocates nothing once the reference is there.
#[derive(Debug, Clone)]
pub struct StreamMonitor {
    protocol: Protocol,
    /// Measurements without a driven electrode: those on one are no reciprocal of any.
    used: Vec<bool>,
    /// The first frames, `[frame, measurement]`; not a number where a value is bad.
    first: Array2<f64>,
    frames: usize,
    reference: Vec<f64>,
    before_s: f64,
    monitor: Option<FaultMonitor>,
}

impl StreamMonitor {
    /// For frames of these measurements, in this order; so many first ones are the reference.
    ///
    /// # Errors
    ///
    /// No measurements, an electrode that is not there, fewer than 3 frames.
    pub fn new(
        quadruples: &[Quadruple],
        electrodes: usize,
        reference_frames: usize,
    ) -> Result<Self, SkinError> {
        if reference_frames < 3 {
            let (key, value) = ("reference_frames", reference_frames as f64);
            return Err(SkinError::OutOfRange { key, value, must: "3 or more" });
        }
        // voltages are judged against each other: the current does not matter
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

    /// Begins anew: the next frames are the reference.
    pub fn restart(&mut self) {
        (self.frames, self.monitor) = (0, None);
    }

    /// Takes a frame `[measurement]` in any unit; `is_good` says which values are not flagged.
    ///
    /// # Errors
    ///
    /// A frame of another length, a time that is no number. The monitor is then as before.
    pub fn push(
        &mut self,
        values: &[f64],
        is_good: impl Fn(usize) -> bool,
        time_s: f64,
    ) -> Result<(), SkinError> {
        SkinError::check_measurements("the frame", values.len(), self.used.len())?;
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

    /// Electrodes that are faulty in the last frame, by ascending number; none while the reference is
    /// taken.
    pub fn faults(&self) -> &[ElectrodeFault] {
        self.monitor.as_ref().map_or(&[], FaultMonitor::faults)
    }

    /// The first frames as differences of reciprocals over the root of 2: as noisy as a measurement, and a
    /// touch is not in them.
    fn without_touches(&self, reciprocal: &[usize]) -> Array2<f64> {
        Array2::from_shape_fn(self.first.dim(), |(frame, i)| match reciprocal[i] {
            twin if twin == i => self.first[[frame, i]],
            twin => {
                (self.first[[frame, i]] - self.first[[frame, twin]])
                    * std::f64::consts::FRAC_1_SQRT_2
            }
        })
    }

    /// Reference and noise from the first frames, and who is faulty in them.
    fn begin(&mut self, time_s: f64) -> Result<FaultMonitor, SkinError> {
        for (mut channel, reference) in
            self.first.columns_mut().into_iter().zip(&mut self.reference)
        {
            let good = channel.iter().filter(|value| value.is_finite());
            let (sum, count) = good.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
            *reference = if count > 0.0 { sum / count } else { 0.0 };
            // the monitor takes bad values out frame by frame; the noise is that of the others
            channel.mapv_inplace(|v| if v.is_finite() { v } else { *reference });
        }
        let typical = median(&self.reference, &self.used);
        let least = STILL_NOISE * typical;
        let wiring = Wiring::new(&self.protocol, &self.used);
        let mut std: Vec<f64> =
            match noise_std_of_quiet_frames(self.without_touches(&wiring.reciprocal).view()) {
                Ok(std) => std.into_iter().map(|std| std.max(least)).collect(),
                // frames that are all equal
                Err(_) => vec![least; self.used.len()],
            };
        let found = of_start(&wiring, &self.used, &std, &self.reference, self.first.nrows());
        // what floats is not its noise
        let common = median(&std, &self.used);
        for &i in found.iter().flat_map(|&e| &wiring.of_electrode[e]) {
            std[i] = common;
        }
        let step = smallest_step(self.first.view());
        let mut monitor = FaultMonitor::new(&self.protocol, &self.used, &std, step)?
            .with_wrong_drift(WRONG_DRIFT);
        for &electrode in &found {
            monitor.condemn(electrode, FaultKind::Contradicts, time_s);
            // where it will be once it is sound nobody knows: as large as others, and reciprocal
            wiring.of_electrode[electrode].iter().for_each(|&i| self.reference[i] = typical);
        }
        monitor.leave_out();
        Ok(monitor)
    }
}

/// Electrodes that fail at any time in some frames of an instrument, without a model, by ascending
/// number; the first fault of each.
///
/// # Errors
///
/// Those of [`StreamMonitor`].
pub fn of_frames(
    quadruples: &[Quadruple],
    electrodes: usize,
    frames: &MeasuredFrames,
) -> Result<Vec<ElectrodeFault>, SkinError> {
    let count = frames.values.nrows();
    let mut monitor = StreamMonitor::new(quadruples, electrodes, count)?;
    let mut found: Vec<ElectrodeFault> = Vec::new();
    // all frames are the reference, then each is held against it
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
