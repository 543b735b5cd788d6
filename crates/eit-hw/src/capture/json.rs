//! Frames as JSON. JSON has no NaN: `null` stands for what is not finite.

use serde::ser::SerializeStruct;
use serde::{Deserialize, Serialize};

use crate::frame::{Frame, Quality};

/// A frame as it is stored: what [`FrameJson`] writes.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameRecord {
    sequence: u64,
    epoch: u32,
    device_time_s: Option<f64>,
    host_time_s: Option<f64>,
    /// JSON has no NaN: `null` stands for what is not finite.
    values: Vec<Option<f64>>,
    #[serde(default)]
    imaginary: Option<Vec<Option<f64>>>,
    /// Flags as bits; left out where all are good.
    #[serde(default)]
    quality: Option<Vec<u16>>,
}

/// A frame to be written, in place: nothing is copied.
pub(super) struct FrameJson<'a>(pub(super) &'a Frame);

impl Serialize for FrameJson<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let frame = self.0;
        let mut fields = serializer.serialize_struct("Frame", 7)?;
        fields.serialize_field("sequence", &frame.sequence)?;
        fields.serialize_field("epoch", &frame.epoch)?;
        fields.serialize_field("device_time_s", &frame.device_time_s)?;
        fields.serialize_field("host_time_s", &frame.host_time_s)?;
        fields.serialize_field("values", &Finite(&frame.values))?;
        if let Some(imaginary) = &frame.imaginary {
            fields.serialize_field("imaginary", &Finite(imaginary))?;
        }
        if frame.quality.iter().any(|quality| !quality.is_good()) {
            fields.serialize_field("quality", &Bits(&frame.quality))?;
        }
        fields.end()
    }
}

struct Finite<'a>(&'a [f64]);

impl Serialize for Finite<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(|&value| value.is_finite().then_some(value)))
    }
}

struct Bits<'a>(&'a [Quality]);

impl Serialize for Bits<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(|quality| quality.bits()))
    }
}

fn or_nan(values: Vec<Option<f64>>) -> Vec<f64> {
    values.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect()
}

impl FrameRecord {
    /// The frame; `None` where its parts have different lengths or a flag has no meaning.
    pub(super) fn into_frame(self) -> Option<Frame> {
        let count = self.values.len();
        let quality = match self.quality {
            None => vec![Quality::GOOD; count],
            Some(bits) => bits.into_iter().map(Quality::from_bits).collect::<Option<_>>()?,
        };
        let imaginary = self.imaginary.map(or_nan);
        if quality.len() != count || imaginary.as_ref().is_some_and(|parts| parts.len() != count) {
            return None;
        }
        let values = or_nan(self.values);
        let (sequence, epoch) = (self.sequence, self.epoch);
        let (device_time_s, host_time_s) = (self.device_time_s, self.host_time_s);
        Some(Frame { values, imaginary, quality, sequence, epoch, device_time_s, host_time_s })
    }
}
