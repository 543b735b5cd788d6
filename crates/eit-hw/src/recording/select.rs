//! Selects the measurements of a protocol from a recording.

use std::ops::Range;

use ndarray::Array2;

use super::file::Recording;
use super::hint::CountHint;
use super::layout::Unit;
use super::map::FrameMap;
use crate::error::{HwError, Place};
use crate::frame::{Frame, Quadruple, Quality};

/// How each complex value z = x + i y is turned into a real number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Component {
    /// Real part of the value.
    #[default]
    Real,
    /// Imaginary part of the value.
    Imaginary,
    /// sqrt(x^2 + y^2), without sign.
    Magnitude,
    /// Re(z exp(-i theta)) with one theta = arg(sum z^2) / 2 in (-pi/2, pi/2] over all good values
    /// of all frames: the projection on the axis that contains most of the signal. The squares make
    /// theta independent of the signs of the measurements; its range preserves the sign of Re z
    /// unless that is small.
    Phased,
}

/// Frames as real numbers in protocol order.
///
/// ```
/// use eit_hw::{Component, Format, ReadOptions, parse_recording};
///
/// let text = b"1.0,2.0\n3.0,4.0\n";
/// let recording = parse_recording(text, "press.csv", Format::Csv, &ReadOptions::default())?;
/// let frames = recording.frames_for(None, 2, Component::Real)?;
/// assert_eq!(frames.mean_frame(), [2.0, 3.0]);
/// # Ok::<(), eit_hw::HwError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MeasuredFrames {
    /// Values, [frame, measurement]. Values with a flag may be NaN.
    pub values: Array2<f64>,
    /// Flags of each value, [frame, measurement].
    pub quality: Array2<Quality>,
    /// Unit of all values, as far as the file states it.
    pub unit: Unit,
    /// Time of each frame by the instrument's clock, in seconds since the first frame.
    pub device_time_s: Option<Vec<f64>>,
    /// Frequency of the current in hertz, if the file states it.
    pub frequency_hz: Option<f64>,
    /// Amplitude in ampere of the current that the values belong to, if the file states it.
    pub current_a: Option<f64>,
    /// theta of [`Component::Phased`] in radians, for complex values.
    pub phase_rad: Option<f64>,
}

impl MeasuredFrames {
    /// Iterates over the frames like a stream: `sequence` counts from 0 in epoch 0, without host
    /// time.
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

    /// Returns whether there are three frames or more, and all have the same values to the last digit: a source that
    /// repeats an old frame, or a converter too coarse to show its noise.
    pub fn are_equal(&self) -> bool {
        let mut rows = self.values.rows().into_iter();
        let Some(first) = rows.next().filter(|_| self.values.nrows() >= 3) else { return false };
        let is_same = |(a, b): (&f64, &f64)| a == b || (a.is_nan() && b.is_nan());
        rows.all(|row| row.iter().zip(first).all(is_same))
    }

    /// Returns the mean of the good values of each measurement over these frames, and whether there
    /// are any; NaN if not. Frames are counted from 0; those beyond the last are ignored.
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

    /// Returns the mean of the good values of each measurement over all frames; NaN if there are
    /// none.
    pub fn mean_frame(&self) -> Vec<f64> {
        self.mean_of(0..self.values.nrows()).0
    }

    /// Converts the values to volts for a current of `current_a` ampere, that of the scene's
    /// protocol.
    ///
    /// Values in ohms are multiplied by it. Volts of a file that states its current (above 0) are
    /// multiplied by `current_a` divided by the file's current, which assumes a linear body. Volts
    /// of a file that states none are assumed to be for the scene's current. Values of
    /// [`Unit::Arbitrary`] remain unchanged. Otherwise `self.current_a` becomes `current_a`, so
    /// that a second call with the same current changes nothing.
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
    /// Returns the `count` measurements of a protocol, in its order.
    ///
    /// `quadruples` are those of the protocol, or `None` if it has general current patterns, which
    /// require a recording with [`Layout::ProtocolOrder`](super::Layout::ProtocolOrder). To convert
    /// frames one by one, use [`FrameMap`].
    ///
    /// # Errors
    /// Those of [`FrameMap::new`]; [`HwError::NoImaginaryPart`] if `component` needs complex values
    /// and the recording is real; [`HwError::Inconsistent`] if fields of the recording differ in
    /// size.
    pub fn frames_for(
        &self,
        quadruples: Option<&[Quadruple]>,
        count: usize,
        component: Component,
    ) -> Result<MeasuredFrames, HwError> {
        let map = self.map_for(quadruples, count)?;
        if component == Component::Imaginary && self.imaginary.is_none() {
            return Err(HwError::NoImaginaryPart { place: Place::file(&self.path) });
        }
        let phase_rad = match component {
            Component::Phased => self.phase_rad(&map)?,
            _ => None,
        };
        // real values have no angle and are used as they are
        let (sine, cosine) = phase_rad.unwrap_or_default().sin_cos();
        let mut values = Array2::zeros((self.frame_count(), count));
        let mut quality = Array2::default((self.frame_count(), count));
        let slots = values.rows_mut().into_iter().zip(quality.rows_mut());
        let mut mapped = Frame::new(0, Vec::new());
        for (recorded, (mut values, mut flags)) in self.frames().zip(slots) {
            map.apply_to(&recorded, &mut mapped)?;
            let y = mapped.imaginary.iter().flatten().copied().chain(std::iter::repeat(0.0));
            let parts = mapped.values.iter().zip(y);
            for (slot, (&x, y)) in values.iter_mut().zip(parts) {
                *slot = match component {
                    Component::Imaginary => y,
                    Component::Magnitude if mapped.imaginary.is_some() => x.hypot(y),
                    Component::Magnitude => x.abs(),
                    Component::Phased if mapped.imaginary.is_some() => x * cosine + y * sine,
                    Component::Real | Component::Phased => x,
                };
            }
            flags.iter_mut().zip(&mapped.quality).for_each(|(slot, flags)| *slot = *flags);
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

    /// Returns the map from the values of a frame to the `count` measurements of a protocol, to
    /// convert frames one by one; arguments as for [`frames_for`](Self::frames_for).
    ///
    /// # Errors
    /// Those of [`FrameMap::new`], and [`HwError::Inconsistent`] if there is not a time for each
    /// frame.
    pub fn map_for(
        &self,
        quadruples: Option<&[Quadruple]>,
        count: usize,
    ) -> Result<FrameMap, HwError> {
        self.check()?;
        FrameMap::new(&self.layout, self.value_count(), quadruples, count, &self.path)
            .map_err(|error| self.with_frame_count(error))
    }

    /// Adds the number of frames of this recording, and the hint that follows from it, to the
    /// error.
    fn with_frame_count(&self, error: HwError) -> HwError {
        match error {
            HwError::CountMismatch { place, found, wanted, .. } => {
                let frames = self.frame_count();
                let is_twice = found == 2 || wanted.checked_mul(2) == Some(found);
                let hint = match self.may_have_decimal_commas && is_twice {
                    true => CountHint::DecimalComma,
                    false => CountHint::of(found, frames, wanted, self.frames_are),
                };
                HwError::CountMismatch { place, found, frames, wanted, hint }
            }
            other => other,
        }
    }

    /// Returns theta of [`Component::Phased`]; `None` for real values.
    fn phase_rad(&self, map: &FrameMap) -> Result<Option<f64>, HwError> {
        let (mut sum, mut mapped) = ([0.0; 2], Frame::new(0, Vec::new()));
        for recorded in self.frames() {
            map.apply_to(&recorded, &mut mapped)?;
            let Some(imaginary) = &mapped.imaginary else { return Ok(None) };
            let parts = mapped.values.iter().zip(imaginary).zip(&mapped.quality);
            let [mut re, mut im] = [0.0; 2];
            for ((x, y), _) in parts.filter(|(_, quality)| quality.is_good()) {
                re += x * x - y * y;
                im += 2.0 * x * y;
            }
            sum = [sum[0] + re, sum[1] + im];
        }
        Ok(Some(0.5 * f64::atan2(sum[1], sum[0])))
    }
}
