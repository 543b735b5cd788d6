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
    values: Bounded<Option<f64>, f64>,
    #[serde(default)]
    imaginary: Option<Bounded<Option<f64>, f64>>,
    /// Flags as bits; absent if all values are good.
    #[serde(default)]
    quality: Option<Bounded<u16, u16>>,
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

/// A list of at most [`MOST_VALUES`] values, read as `T` and stored as `U`. The limit keeps a
/// hostile file from exhausting memory: two characters of JSON can take sixteen bytes in memory.
pub(super) struct Bounded<T, U>(pub(super) Vec<U>, PhantomData<T>);

/// Conversion from the value read to the value stored.
pub(super) trait Keep<T> {
    fn keep(read: T) -> Self;
}

impl Keep<Option<f64>> for f64 {
    fn keep(read: Option<f64>) -> Self {
        read.unwrap_or(f64::NAN)
    }
}

impl<T> Keep<T> for T {
    fn keep(read: T) -> Self {
        read
    }
}

impl<'de, T: Deserialize<'de>, U: Keep<T>> Deserialize<'de> for Bounded<T, U> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List<T, U>(PhantomData<(T, U)>);
        impl<'de, T: Deserialize<'de>, U: Keep<T>> Visitor<'de> for List<T, U> {
            type Value = Bounded<T, U>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a list of at most {MOST_VALUES} values")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
                let mut values = Vec::new();
                while let Some(value) = list.next_element()? {
                    if values.len() == MOST_VALUES {
                        return Err(de::Error::invalid_length(MOST_VALUES + 1, &self));
                    }
                    values.push(U::keep(value));
                }
                // thousands of these lists are kept
                values.shrink_to_fit();
                Ok(Bounded(values, PhantomData))
            }
        }
        deserializer.deserialize_seq(List(PhantomData))
    }
}

/// Reads a [`Bounded`] list; for `#[serde(deserialize_with)]`.
pub(super) fn bounded<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    Bounded::<T, T>::deserialize(deserializer).map(|list| list.0)
}

impl FrameRecord {
    /// Converts to a frame; returns `None` if its lists differ in length or a flag is unknown.
    pub(super) fn into_frame(self) -> Option<Frame> {
        let values = self.values.0;
        let count = values.len();
        let quality = match self.quality {
            None => vec![Quality::GOOD; count],
            Some(bits) => bits.0.into_iter().map(Quality::from_bits).collect::<Option<_>>()?,
        };
        let frame = Frame {
            values,
            imaginary: self.imaginary.map(|list| list.0),
            quality,
            sequence: self.sequence,
            epoch: self.epoch,
            device_time_s: self.device_time_s,
            host_time_s: self.host_time_s,
        };
        frame.check(None, "".as_ref()).is_ok().then_some(frame)
    }
}
