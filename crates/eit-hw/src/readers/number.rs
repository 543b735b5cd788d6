//! Numbers of an array as they are stored.

/// Type of a stored number, or of either part of a complex one.
#[derive(Clone, Copy)]
pub(super) struct Kind {
    number: Number,
    big_endian: bool,
    /// Number of bytes: 1, 2, 4 or 8.
    pub size: usize,
}

#[derive(Clone, Copy)]
enum Number {
    Float,
    Signed,
    Unsigned,
}

impl Kind {
    /// Parses NumPy's name of a type without byte order, such as `f8`.
    pub(super) fn parse(name: &str, big_endian: bool) -> Option<Self> {
        let (number, size) = match name {
            "f4" => (Number::Float, 4),
            "f8" => (Number::Float, 8),
            "i1" => (Number::Signed, 1),
            "i2" => (Number::Signed, 2),
            "i4" => (Number::Signed, 4),
            "i8" => (Number::Signed, 8),
            "u1" => (Number::Unsigned, 1),
            "u2" => (Number::Unsigned, 2),
            "u4" => (Number::Unsigned, 4),
            "u8" => (Number::Unsigned, 8),
            _ => return None,
        };
        Some(Self { number, big_endian, size })
    }

    #[cfg(feature = "arrays")]
    pub(super) fn is_float(self) -> bool {
        matches!(self.number, Number::Float)
    }

    /// Decodes a number from its `size` bytes. Integers beyond 2^53 are rounded.
    pub(super) fn value(self, bytes: &[u8]) -> f64 {
        // the number in the low bytes of 8, least significant first
        let mut wide = [0; 8];
        for (slot, index) in wide.iter_mut().zip(0..bytes.len()) {
            *slot = bytes[if self.big_endian { bytes.len() - 1 - index } else { index }];
        }
        let raw = u64::from_le_bytes(wide);
        match self.number {
            // only the low 4 bytes are filled
            Number::Float if self.size == 4 => f64::from(f32::from_bits(raw as u32)),
            Number::Float => f64::from_bits(raw),
            Number::Unsigned => raw as f64,
            Number::Signed => {
                let unused = 64 - 8 * self.size as u32;
                ((raw << unused) as i64 >> unused) as f64
            }
        }
    }
}

/// The numbers of an array, or of either part of complex ones.
#[derive(Clone, Copy)]
pub(super) struct Numbers<'a> {
    pub kind: Kind,
    /// From the first byte of the first number.
    pub bytes: &'a [u8],
    /// Bytes from one number to the next.
    pub stride: usize,
}

impl<'a> Numbers<'a> {
    /// Iterates over all numbers in the order of the file.
    pub(super) fn values(self) -> impl Iterator<Item = f64> + 'a {
        let Self { kind, bytes, stride } = self;
        bytes.chunks(stride).filter_map(move |chunk| Some(kind.value(chunk.get(..kind.size)?)))
    }
}
