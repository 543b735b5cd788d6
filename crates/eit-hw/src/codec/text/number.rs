//! Number formats of boards.

/// How a number is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Number {
    /// Decimal number, such as `-1.25e-3`.
    Decimal,
    /// Hexadecimal 32-bit two's complement without padding (`ffffd8f1` is -9999); with a decimal
    /// point it is read as a decimal number, which one firmware prints.
    HexInteger,
    /// Bits of a 32-bit float in hexadecimal; with a decimal point it is read as a decimal number.
    HexFloat,
}

impl Number {
    /// Parses a field; returns `None` if it is not a finite number.
    pub fn parse(self, field: &[u8]) -> Option<f64> {
        let field = std::str::from_utf8(field).ok()?;
        let decimal = || {
            // `parse` also accepts `inf`, `nan` and the like
            let plain = field.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
            field.parse().ok().filter(|value: &f64| plain && value.is_finite())
        };
        if self == Self::Decimal || field.contains('.') {
            return decimal();
        }
        // `from_str_radix` also accepts a sign
        let digits = field.bytes().all(|byte| byte.is_ascii_hexdigit());
        let bits = digits.then(|| u32::from_str_radix(field, 16).ok()).flatten()?;
        if self == Self::HexInteger {
            return Some(f64::from(bits.cast_signed()));
        }
        Some(f64::from(f32::from_bits(bits))).filter(|value| value.is_finite())
    }

    /// Whether a field is what boards print for a number that is not finite: C prints `nan` and
    /// `inf`, an Arduino also `ovf`, in either case and with a sign.
    pub(super) fn is_not_finite(field: &[u8]) -> bool {
        let word = field.strip_prefix(b"-").or_else(|| field.strip_prefix(b"+")).unwrap_or(field);
        ["nan", "inf", "infinity", "ovf"]
            .iter()
            .any(|name| word.eq_ignore_ascii_case(name.as_bytes()))
    }

    /// Formats a number as a board would.
    pub fn write(self, value: f64) -> String {
        match self {
            Self::Decimal => value.to_string(),
            Self::HexInteger => format!("{:x}", value.round() as i32),
            Self::HexFloat => format!("{:x}", (value as f32).to_bits()),
        }
    }
}
