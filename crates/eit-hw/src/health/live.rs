//! Measures reference frames of a live instrument for a health check.

use std::time::{Duration, Instant};

use ndarray::Array2;

use super::check::{HealthReport, StreamFacts, check_health};
use crate::driver::{Event, FrameSource};
use crate::error::HwError;
use crate::frame::{Frame, Quadruple, Quality};
use crate::recording::{MeasuredFrames, Unit};

/// Frames of the untouched skin, and events during their measurement.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ReferenceFrames {
    /// Measured values (real parts) and their flags.
    pub frames: MeasuredFrames,
    /// Number of lost frames, and the requested rate.
    pub facts: StreamFacts,
    /// Messages from the instrument and its driver.
    pub notices: Vec<String>,
}

impl ReferenceFrames {
    /// Checks the frames with [`check_health`]; `quadruples` are their measurements.
    ///
    /// # Errors
    /// Those of [`check_health`].
    pub fn check(&self, quadruples: &[Quadruple]) -> Result<HealthReport, HwError> {
        check_health(&self.frames, quadruples, &self.facts)
    }
}

/// Measures `count` frames of one epoch, or as many as arrive within `limit`.
///
/// # Errors
/// Those of the source: [`HwError::Lost`], [`HwError::Overflow`], [`HwError::Identity`].
pub fn measure_reference_frames(
    source: &mut dyn FrameSource,
    count: usize,
    limit: Duration,
) -> Result<ReferenceFrames, HwError> {
    let (start, mut received, mut notices) = (Instant::now(), Vec::<Frame>::new(), Vec::new());
    let mut lost_frames = 0;
    while received.len() < count && !source.is_over() {
        let Some(left) = limit.checked_sub(start.elapsed()) else { break };
        match source.next_event(left.min(Duration::from_millis(100)))? {
            Some(Event::Frame(frame)) => received.push(frame),
            // losses before the first frame belong to the start
            Some(Event::Gap { frames }) if !received.is_empty() => lost_frames += frames,
            // frames before a reconnection are no longer valid
            Some(Event::Reconnected { .. }) => {
                notices.push("the connection was lost and restored".to_owned());
                received.clear();
                lost_frames = 0;
            }
            Some(Event::Disconnected { reason }) => notices.push(reason),
            Some(Event::Notice(text)) => notices.push(text),
            Some(Event::Silent { for_s, bytes }) => {
                notices.push(match bytes {
                    0 => format!("no frame came for {for_s:.1} s"),
                    _ => format!("no frame came for {for_s:.1} s, although {bytes} bytes came"),
                });
            }
            _ => {}
        }
    }
    let wanted_rate_hz = source.setup().frame_rate_hz;
    let facts = StreamFacts { lost_frames, wanted_rate_hz };
    Ok(ReferenceFrames { frames: measured(&received, source.setup().unit), facts, notices })
}

/// Converts live frames to those of a recording.
fn measured(frames: &[Frame], unit: Unit) -> MeasuredFrames {
    // all frames of a source have the same number of values
    let shape = (frames.len(), frames.first().map_or(0, |frame| frame.values.len()));
    let value = |(row, column): (usize, usize)| frames[row].values.get(column).copied();
    let flags = |(row, column): (usize, usize)| frames[row].quality.get(column).copied();
    let values = Array2::from_shape_fn(shape, |at| value(at).unwrap_or(f64::NAN));
    let quality = Array2::from_shape_fn(shape, |at| flags(at).unwrap_or(Quality::MISSING));
    let times: Option<Vec<f64>> = frames.iter().map(|frame| frame.device_time_s).collect();
    // for a board without a clock: times of arrival
    let host = || {
        let first_s = frames.first()?.host_time_s?;
        frames.iter().map(|frame| frame.host_time_s.map(|time_s| time_s - first_s)).collect()
    };
    MeasuredFrames {
        values,
        quality,
        unit,
        device_time_s: times.or_else(host),
        frequency_hz: None,
        current_a: None,
        phase_rad: None,
    }
}
