//! Frames as JSON. JSON has no NaN, so `null` stands for a value that is not finite.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{self, SeqAccess, Visitor};
use serde::ser::SerializeStruct;
use serde::{Deserialize, Deserializer, Serialize};

use crate::frame::{Frame, Quality};

/// A frame as stored; [`FrameJson`] writes it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameRecord {
    sequence: u64,
    epoch: u32,
    device_time_s: Option<f64>,
    host_time_s: Option<f64>,
    /// `null` is read as NaN.
    values: Bounded<Option<f64>>,
    #[serde(default)]
    imaginary: Option<Bounded<Option<f64>>>,
    /// Flags as bits; absent if all values are good.
    #[serde(default)]
    quality: Option<Bounded<u16>>,
}

/// A borrowed frame to serialise without copying.
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

/// Maximum number of values per frame; adjacent patterns of 256 electrodes have 64 768.
pub(super) const MOST_VALUES: usize = 1 << 18;

/// A list of at most [`MOST_VALUES`] values. The limit keeps a hostile file from exhausting memory:
/// two characters of JSON can take sixteen bytes in memory.
struct Bounded<T>(Vec<T>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Bounded<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for List<T> {
            type Value = Bounded<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a list of at most {MOST_VALUES} values")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
                let mut values = Vec::new();
                while let Some(value) = list.next_element()? {
                    if values.len() == MOST_VALUES {
                        return Err(de::Error::invalid_length(MOST_VALUES + 1, &self));
                    }
                    values.push(value);
                }
                Ok(Bounded(values))
            }
        }
        deserializer.deserialize_seq(List(PhantomData))
    }
}

/// Reads a list of at most [`MOST_VALUES`] values; for `#[serde(deserialize_with)]`.
pub(super) fn bounded<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    Bounded::deserialize(deserializer).map(|list| list.0)
}

/// Numbers, of which `null` is NaN.
fn numbers(list: Bounded<Option<f64>>) -> Vec<f64> {
    let values = list.0.into_iter().map(|value| value.unwrap_or(f64::NAN));
    let mut values: Vec<f64> = values.collect();
    // thousands of these lists are kept
    values.shrink_to_fit();
    values
}

impl FrameRecord {
    /// Converts to a frame; returns `None` if its lists differ in length or a flag is unknown.
    pub(super) fn into_frame(self) -> Option<Frame> {
        let values = numbers(self.values);
        let count = values.len();
        let quality = match self.quality {
            None => vec![Quality::GOOD; count],
            Some(bits) => bits.0.into_iter().map(Quality::from_bits).collect::<Option<_>>()?,
        };
        let frame = Frame {
            values,
            imaginary: self.imaginary.map(numbers),
            quality,
            sequence: self.sequence,
            epoch: self.epoch,
            device_time_s: self.device_time_s,
            host_time_s: self.host_time_s,
        };
        frame.check(None, "".as_ref()).is_ok().then_some(frame)
    }
}
