//! The measurements of a protocol out of a recording.

use std::ops::Range;

use ndarray::{Array2, CowArray, Ix2};

use super::file::Recording;
use super::hint::CountHint;
use super::layout::Unit;
use super::map::{FrameMap, Projection};
use crate::error::HwError;
use crate::frame::{Frame, Quadruple, Quality};

/// Which real number is taken of each complex value z = x + i y.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Component {
    /// x.
    #[default]
    Real,
    /// y.
    Imaginary,
    /// sqrt(x^2 + y^2); it has no sign.
    Magnitude,
    /// Re(z exp(-i theta)) with one theta = arg(sum z^2) / 2 in (-pi/2, pi/2] over all good values
    /// of all frames: the projection on the axis that holds most of the signal. The squares make
    /// it blind to the signs of the measurements; the range keeps the sign of Re z where it is not
    /// small.
    Phased,
}

/// Frames as real numbers in protocol order.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredFrames {
    /// Values, [frame, measurement]. A value that is not good may be NaN.
    pub values: Array2<f64>,
    /// Flags of each value, [frame, measurement].
    pub quality: Array2<Quality>,
    /// Unit of the values.
    pub unit: Unit,
    /// The instrument's time of each frame in seconds since the first one.
    pub device_time_s: Option<Vec<f64>>,
    /// Frequency of the current, where the file states it.
    pub frequency_hz: Option<f64>,
    /// Amplitude of the current that the values belong to, where the file states it.
    pub current_a: Option<f64>,
    /// theta of [`Component::Phased`] in radian, for complex values.
    pub phase_rad: Option<f64>,
}

impl MeasuredFrames {
    /// The frames one by one, as a stream would bring them: `sequence` counts them from 0 in
    /// epoch 0, without host time.
    pub fn frames(&self) -> impl Iterator<Item = Frame> + '_ {
        self.values.rows().into_iter().zip(self.quality.rows()).zip(0_u64..).map(
            |((values, quality), sequence)| Frame {
                values: values.to_vec(),
                imaginary: None,
                quality: quality.to_vec(),
                sequence,
                epoch: 0,
                device_time_s: usize::try_from(sequence)
                    .ok()
                    .and_then(|frame| self.device_time_s.as_ref()?.get(frame).copied()),
                host_time_s: None,
            },
        )
    }

    /// Mean of the good values of each measurement over these frames (from 0, those beyond the
    /// last one do not count), and whether there is one; NaN where there is none.
    pub fn mean_of(&self, frames: Range<usize>) -> (Vec<f64>, Vec<bool>) {
        let mut sums = vec![0.0; self.values.ncols()];
        let mut counts = vec![0_usize; self.values.ncols()];
        let rows = self.values.rows().into_iter().zip(self.quality.rows());
        for (values, quality) in rows.take(frames.end).skip(frames.start) {
            let cells = values.into_iter().zip(quality);
            for ((value, quality), (sum, count)) in cells.zip(sums.iter_mut().zip(&mut counts)) {
                if quality.is_good() {
                    *sum += value;
                    *count += 1;
                }
            }
        }
        // 0 / 0 is NaN
        let means = sums.iter().zip(&counts).map(|(sum, &count)| sum / count as f64).collect();
        (means, counts.iter().map(|&count| count > 0).collect())
    }

    /// Mean of the good values of each measurement over all frames, NaN where there is none.
    pub fn mean_frame(&self) -> Vec<f64> {
        self.mean_of(0..self.values.nrows()).0
    }

    /// Makes the values volts under a current of `current_a` ampere, that of the scene's protocol.
    ///
    /// Ohms are multiplied by it. Volts of a file that states its current (above 0) are multiplied
    /// by `current_a` over the file's: a linear body gives so much for that current. Volts of a
    /// file that states none are taken to be for the scene's. Values of [`Unit::Arbitrary`] stay.
    /// Except for these, `self.current_a` is `current_a` afterwards, so a second call with the same
    /// current changes nothing.
    ///
    /// Both currents are amplitudes; `current_a` must be finite and above 0.
    pub fn to_volts(&mut self, current_a: f64) {
        let factor = match (self.unit, self.current_a) {
            (Unit::Arbitrary, _) => return,
            (Unit::Ohm, _) => current_a,
            (Unit::Volt, Some(file_a)) if file_a > 0.0 => current_a / file_a,
            (Unit::Volt, _) => 1.0,
        };
        self.values *= factor;
        self.unit = Unit::Volt;
        self.current_a = Some(current_a);
    }
}

impl Recording {
    /// The `count` measurements of a protocol, in its order.
    ///
    /// `quadruples` are those of the protocol, `None` if it has general current patterns; only a
    /// recording with [`Layout::ProtocolOrder`](super::Layout::ProtocolOrder) fits then. See [`FrameMap`] for
    /// frames that come one by one.
    ///
    /// # Errors
    /// [`HwError::CountMismatch`] with both counts where the file has another number of values;
    /// [`HwError::MissingDrive`], [`HwError::MissingMeasurement`] or [`HwError::MissingElectrode`]
    /// where it lacks some; [`HwError::NeedsQuadruples`], [`HwError::NoImaginaryPart`],
    /// [`HwError::QuadrupleCount`] and [`HwError::Inconsistent`] as they say.
    pub fn frames_for(
        &self,
        quadruples: Option<&[Quadruple]>,
        count: usize,
        component: Component,
    ) -> Result<MeasuredFrames, HwError> {
        self.check()?;
        let map = FrameMap::new(&self.layout, self.value_count(), quadruples, count, &self.path)
            .map_err(|error| self.with_frame_count(error))?;
        let recorded = Recorded {
            real: self.real.as_standard_layout(),
            imaginary: self.imaginary.as_ref().map(|imaginary| imaginary.as_standard_layout()),
            quality: self.quality.as_standard_layout(),
        };
        let phase_rad = match component {
            Component::Phased => recorded.phase_rad(&map)?,
            _ => None,
        };
        let projection = match component {
            Component::Real => Projection::Real,
            Component::Imaginary => Projection::Imaginary,
            Component::Magnitude => Projection::Magnitude,
            // real values have no angle and are taken as they are
            Component::Phased => Projection::Axis { angle_rad: phase_rad.unwrap_or_default() },
        };
        let mut values = Array2::zeros((self.frame_count(), count));
        let mut quality = Array2::default((self.frame_count(), count));
        let slots = values.rows_mut().into_iter().zip(quality.rows_mut());
        for (frame, (mut values, mut flags)) in slots.enumerate() {
            let (real, imaginary, quality) = recorded.frame(frame);
            let values = values.as_slice_mut().unwrap_or_default();
            let flags = flags.as_slice_mut().unwrap_or_default();
            map.apply_into(real, imaginary, quality, projection, values, flags)?;
        }
        Ok(MeasuredFrames {
            values,
            quality,
            unit: self.unit,
            device_time_s: self.device_time_s.clone(),
            frequency_hz: self.frequency_hz,
            current_a: self.current_a,
            phase_rad,
        })
    }

    /// The error with the number of frames of this recording and what that suggests.
    fn with_frame_count(&self, error: HwError) -> HwError {
        match error {
            HwError::CountMismatch { place, found, wanted, .. } => {
                let frames = self.frame_count();
                let hint = CountHint::of(found, frames, wanted, self.frames_are);
                HwError::CountMismatch { place, found, frames, wanted, hint }
            }
            other => other,
        }
    }
}

/// A recording's values with each frame in one piece.
struct Recorded<'a> {
    real: CowArray<'a, f64, Ix2>,
    imaginary: Option<CowArray<'a, f64, Ix2>>,
    quality: CowArray<'a, Quality, Ix2>,
}

impl Recorded<'_> {
    /// Real parts, imaginary parts and flags of a frame below the frame count.
    fn frame(&self, frame: usize) -> (&[f64], Option<&[f64]>, &[Quality]) {
        // a row in standard layout is a slice
        (
            self.real.row(frame).to_slice().unwrap_or_default(),
            self.imaginary
                .as_ref()
                .map(|imaginary| imaginary.row(frame).to_slice().unwrap_or_default()),
            self.quality.row(frame).to_slice().unwrap_or_default(),
        )
    }

    /// theta of [`Component::Phased`]; `None` for real values.
    fn phase_rad(&self, map: &FrameMap) -> Result<Option<f64>, HwError> {
        let mut sum = [0.0; 2];
        for frame in 0..self.real.nrows() {
            let (real, imaginary, quality) = self.frame(frame);
            let Some(imaginary) = imaginary else { return Ok(None) };
            let [x, y] = map.square_sum(real, imaginary, quality)?;
            sum = [sum[0] + x, sum[1] + y];
        }
        Ok(Some(0.5 * f64::atan2(sum[1], sum[0])))
    }
}
