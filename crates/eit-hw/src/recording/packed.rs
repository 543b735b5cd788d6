//! Numbers in memory in about as many bytes as they have digits.
//!
//! A file of single digits has two bytes per value, and an array of `f64` eight. So that a recording
//! takes no more memory than its file, each value is stored by itself in the shortest of a few exact
//! forms: a small whole number in one byte, a decimal number by its digits and exponent, anything
//! else in nine bytes. Values equal to those of the previous row are stored as their count.
//!
//! Over 300 lines because the forms of a number, how they are written and how they are read belong together.

use std::fmt::Write;
use std::iter::FusedIterator;

/// Longest row that is compared with the previous one; a longer one would cost more than it saves.
const MOST_COMPARED: usize = 1 << 16;
/// Size of a block in bytes: a growing list would be copied, and be in memory twice.
const BLOCK_BYTES: usize = 1 << 18;
/// Longest form of a value, or of a count, in bytes.
const MOST_BYTES: usize = 10;
/// Memory in bytes used to arrange rows as columns, or an eighth of the numbers' if that is more.
const TRANSPOSED_BYTES: usize = 8 << 20;

/// First byte of each form. Lower ones are the numbers 0 to 159 themselves.
mod form {
    /// 64 forms of two bytes: whole numbers from [`PAIR_FROM`].
    pub const PAIR: u8 = 160;
    pub const PAIR_END: u8 = PAIR + 64;
    pub const PAIR_FROM: i32 = -4096;
    pub const WHOLE_16: u8 = 224;
    pub const WHOLE_32: u8 = 225;
    pub const F32: u8 = 226;
    pub const F64: u8 = 227;
    pub const NAN: u8 = 228;
    pub const INFINITE: u8 = 229;
    pub const MINUS_INFINITE: u8 = 230;
    pub const MINUS_ZERO: u8 = 231;
    /// Six forms each: digits / 10 to 10^6, digits in one, two and four bytes.
    pub const DECIMAL_8: u8 = 232;
    pub const DECIMAL_16: u8 = 238;
    pub const DECIMAL_32: u8 = 244;
    /// Digits times a power of ten, both in as many bytes: one, two; four and two.
    pub const POWER_8: u8 = 250;
    pub const POWER_16: u8 = 251;
    pub const POWER_32: u8 = 252;
    /// A count of values that equal those one row earlier.
    pub const SAME: u8 = 253;
}

const TENS: [f64; 6] = [1e1, 1e2, 1e3, 1e4, 1e5, 1e6];

/// The row to compare with.
#[derive(Clone, Debug, Default, PartialEq)]
enum Row {
    /// The first row, whose length is not known yet.
    #[default]
    First,
    Length(usize),
    /// Rows are too long, or their length is not known.
    None,
}

/// A list of numbers, written from the start to the end and read the same way.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Packed {
    blocks: Vec<Vec<u8>>,
    count: usize,
    row: Row,
    /// The last value of each column.
    previous: Vec<f64>,
    /// Number of values that are equal to the previous row's and not stored yet.
    same: u64,
}

impl Packed {
    /// Creates an empty list of rows of this length.
    pub(crate) fn of_rows(length: usize) -> Self {
        let row =
            if (1..=MOST_COMPARED).contains(&length) { Row::Length(length) } else { Row::None };
        Self { row, ..Self::default() }
    }

    /// Packs a list of rows of this length.
    pub(crate) fn of(values: impl IntoIterator<Item = f64>, length: usize) -> Self {
        let mut packed = Self::of_rows(length);
        packed.extend(values);
        packed.finished()
    }

    /// Returns the number of values.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// Returns the memory taken by the values, in bytes.
    #[cfg(any(test, feature = "mcap"))]
    pub(crate) fn bytes(&self) -> usize {
        let last = self.blocks.last().map_or(0, Vec::capacity);
        BLOCK_BYTES * self.blocks.len().saturating_sub(1) + last + 8 * self.previous.capacity()
    }

    /// Ends the first row: later rows have as many values.
    pub(crate) fn end_first_row(&mut self) {
        self.row = match self.count == self.previous.len() && self.count > 0 {
            true => Row::Length(self.count),
            false => Row::None,
        };
        if self.row == Row::None {
            self.previous = Vec::new();
        }
    }

    /// Appends a value. Every NaN is the same.
    pub(crate) fn push(&mut self, value: f64) {
        let value = if value.is_nan() { f64::NAN } else { value };
        let index = self.count;
        self.count += 1;
        match self.row {
            Row::First if index < MOST_COMPARED => self.previous.push(value),
            Row::Length(length) if index < length => self.previous.push(value),
            Row::Length(length) => {
                if let Some(previous) = self.previous.get_mut(index % length) {
                    if previous.to_bits() == value.to_bits() {
                        self.same += 1;
                        return;
                    }
                    *previous = value;
                }
            }
            Row::First | Row::None => {}
        }
        self.store_same();
        let (bytes, length) = form_of(value);
        self.store(&bytes[..length]);
    }

    /// Ends the list; returns it without what only writing needs.
    pub(crate) fn finished(mut self) -> Self {
        self.store_same();
        if self.row == Row::First {
            self.row = Row::None;
        }
        self.previous = Vec::new();
        if let Some(last) = self.blocks.last_mut() {
            last.shrink_to_fit();
        }
        self
    }

    fn store_same(&mut self) {
        if self.same == 0 {
            return;
        }
        let (mut bytes, mut length, mut left) = ([form::SAME; MOST_BYTES + 1], 1, self.same);
        while left > 0 && length < bytes.len() {
            // seven bits at a time; the eighth says that more follow
            bytes[length] = (left & 0x7F) as u8 | if left > 0x7F { 0x80 } else { 0 };
            left >>= 7;
            length += 1;
        }
        self.same = 0;
        self.store(&bytes[..length]);
    }

    fn store(&mut self, bytes: &[u8]) {
        let is_full = |block: &Vec<u8>| block.len() + bytes.len() > BLOCK_BYTES;
        if self.blocks.last().is_none_or(is_full) {
            // small lists grow as they need; only the last block can be small
            let size = if self.blocks.is_empty() { 0 } else { BLOCK_BYTES };
            self.blocks.push(Vec::with_capacity(size));
        }
        if let Some(block) = self.blocks.last_mut() {
            block.extend_from_slice(bytes);
        }
    }

    /// Iterates over the values.
    pub(crate) fn iter(&self) -> Values<'_> {
        let (packed, previous) = (self, Vec::new());
        Values { packed, block: 0, at: 0, index: 0, same: 0, previous }
    }

    /// Returns the numbers with rows and columns exchanged, from rows of this length.
    pub(crate) fn transposed(&self, columns: usize) -> Self {
        let rows = self.count / columns.max(1);
        let mut transposed = Self::of_rows(rows);
        let most = (TRANSPOSED_BYTES / 8).max(self.count / 64);
        let group = (most / rows.max(1)).clamp(1, columns.max(1));
        let mut values = vec![0.0; group * rows];
        for first in (0..columns).step_by(group) {
            let wanted = first..columns.min(first + group);
            for (index, value) in self.iter().take(rows * columns).enumerate() {
                let (row, column) = (index / columns, index % columns);
                if wanted.contains(&column) {
                    values[(column - first) * rows + row] = value;
                }
            }
            transposed.extend(values[..wanted.len() * rows].iter().copied());
        }
        transposed.finished()
    }
}

impl Extend<f64> for Packed {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, values: I) {
        values.into_iter().for_each(|value| self.push(value));
    }
}

/// Iterates over the values of a [`Packed`].
#[derive(Clone, Debug)]
pub(crate) struct Values<'a> {
    packed: &'a Packed,
    block: usize,
    at: usize,
    index: usize,
    same: u64,
    previous: Vec<f64>,
}

impl Values<'_> {
    /// Returns the next form's first byte and at least as many bytes after it as any form has.
    fn form(&mut self) -> Option<(u8, [u8; MOST_BYTES])> {
        let mut block = self.packed.blocks.get(self.block)?;
        if self.at >= block.len() {
            (self.block, self.at) = (self.block + 1, 0);
            block = self.packed.blocks.get(self.block)?;
        }
        let (first, rest) = block.get(self.at..)?.split_first()?;
        let mut bytes = [0; MOST_BYTES];
        let length = rest.len().min(MOST_BYTES);
        bytes[..length].copy_from_slice(&rest[..length]);
        Some((*first, bytes))
    }

    fn take_count(&mut self, bytes: &[u8]) {
        let (mut count, mut length) = (0, 0);
        for (byte, shift) in bytes.iter().zip((0..).step_by(7)) {
            count |= u64::from(byte & 0x7F) << shift;
            length += 1;
            if byte & 0x80 == 0 {
                break;
            }
        }
        self.same = count;
        self.at += 1 + length;
    }
}

impl Iterator for Values<'_> {
    type Item = f64;

    fn next(&mut self) -> Option<f64> {
        if self.index >= self.packed.count {
            return None;
        }
        let length = match self.packed.row {
            Row::Length(length) => length,
            _ => 0,
        };
        let slot = self.index.checked_rem(length).unwrap_or_default();
        if self.same == 0 {
            let (mut first, mut bytes) = self.form()?;
            if first == form::SAME {
                self.take_count(&bytes);
                if self.same == 0 {
                    (first, bytes) = self.form()?;
                }
            }
            if self.same == 0 {
                let (value, used) = value_of(first, &bytes);
                self.at += 1 + used;
                self.index += 1;
                match self.previous.get_mut(slot) {
                    Some(previous) => *previous = value,
                    None if length > 0 => self.previous.push(value),
                    None => {}
                }
                return Some(value);
            }
        }
        self.same -= 1;
        self.index += 1;
        self.previous.get(slot).copied()
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.packed.count - self.index;
        (left, Some(left))
    }
}

impl ExactSizeIterator for Values<'_> {}
impl FusedIterator for Values<'_> {}

type Form = ([u8; MOST_BYTES], usize);

/// Puts a form together.
fn form<const N: usize>(first: u8, rest: [u8; N]) -> Form {
    let mut bytes = [0; MOST_BYTES];
    bytes[0] = first;
    bytes[1..=N].copy_from_slice(&rest);
    (bytes, 1 + N)
}

/// Returns the shortest form of a value.
fn form_of(value: f64) -> Form {
    if value.is_nan() {
        return form(form::NAN, []);
    }
    if value.is_infinite() {
        let first = if value > 0.0 { form::INFINITE } else { form::MINUS_INFINITE };
        return form(first, []);
    }
    if value == 0.0 {
        return form(if value.is_sign_negative() { form::MINUS_ZERO } else { 0 }, []);
    }
    // of whole numbers that `f32` holds some have few digits, as 7e9; of others none has
    let round = || if value.fract() == 0.0 { power(value).filter(|form| form.1 < 5) } else { None };
    whole(value)
        .or_else(|| decimal(value))
        .or_else(round)
        .or_else(|| single(value))
        .or_else(|| power(value))
        .unwrap_or_else(|| form(form::F64, value.to_le_bytes()))
}

/// The value as a whole number, if it is one that `i32` holds.
fn as_whole(value: f64) -> Option<i32> {
    // the conversion saturates, so that the comparison fails for larger values
    let number = value as i32;
    (f64::from(number) == value).then_some(number)
}

fn whole(value: f64) -> Option<Form> {
    let number = as_whole(value)?;
    if let Some(first) = u8::try_from(number).ok().filter(|first| *first < form::PAIR) {
        return Some(form(first, []));
    }
    let offset = u16::try_from(i64::from(number) - i64::from(form::PAIR_FROM)).ok();
    if let Some([low, high]) = offset.map(u16::to_le_bytes)
        && high < form::PAIR_END - form::PAIR
    {
        return Some(form(form::PAIR + high, [low]));
    }
    if let Ok(number) = i16::try_from(number) {
        return Some(form(form::WHOLE_16, number.to_le_bytes()));
    }
    let short = power(value).filter(|(_, length)| *length < 5);
    Some(short.unwrap_or_else(|| form(form::WHOLE_32, number.to_le_bytes())))
}

fn decimal(value: f64) -> Option<Form> {
    (0_u8..).zip(TENS).find_map(|(places, ten)| {
        let digits = as_whole((value * ten).round())?;
        if (f64::from(digits) / ten).to_bits() != value.to_bits() {
            return None;
        }
        Some(match (i8::try_from(digits), i16::try_from(digits)) {
            (Ok(digits), _) => form(form::DECIMAL_8 + places, digits.to_le_bytes()),
            (_, Ok(digits)) => form(form::DECIMAL_16 + places, digits.to_le_bytes()),
            _ => form(form::DECIMAL_32 + places, digits.to_le_bytes()),
        })
    })
}

fn single(value: f64) -> Option<Form> {
    let single = value as f32;
    (f64::from(single) == value).then(|| form(form::F32, single.to_le_bytes()))
}

/// Digits times a power of ten, from the shortest text that is read as this value.
fn power(value: f64) -> Option<Form> {
    let mut text = Text::default();
    write!(text, "{value:e}").ok()?;
    let (digits, exponent) = text.as_str()?.split_once('e')?;
    let (before, after) = digits.split_once('.').unwrap_or((digits, ""));
    let exponent = exponent.parse::<i16>().ok()?.checked_sub(i16::try_from(after.len()).ok()?)?;
    let sign = if before.starts_with('-') { -1 } else { 1 };
    let join = |number: i64, digit: u8| number * 10 + i64::from(digit - b'0');
    let all = before.bytes().chain(after.bytes()).filter(u8::is_ascii_digit);
    let number = i32::try_from(sign * all.fold(0, join)).ok()?;
    if raised(number, exponent).to_bits() != value.to_bits() {
        return None;
    }
    let [low, high] = exponent.to_le_bytes();
    Some(match (i8::try_from(number), i8::try_from(exponent), i16::try_from(number)) {
        (Ok(number), Ok(exponent), _) => {
            form(form::POWER_8, [number.to_le_bytes()[0], exponent.to_le_bytes()[0]])
        }
        (_, _, Ok(number)) => {
            let [one, two] = number.to_le_bytes();
            form(form::POWER_16, [one, two, low, high])
        }
        _ => {
            let [one, two, three, four] = number.to_le_bytes();
            form(form::POWER_32, [one, two, three, four, low, high])
        }
    })
}

/// Returns `number` times ten to the power of `exponent`, rounded once, as text is read.
fn raised(number: i32, exponent: i16) -> f64 {
    let mut text = Text::default();
    let written = write!(text, "{number}e{exponent}");
    written.ok().and_then(|()| text.as_str()?.parse().ok()).unwrap_or(f64::NAN)
}

/// Returns the value of a form, and how many bytes it has after the first.
fn value_of(first: u8, bytes: &[u8; MOST_BYTES]) -> (f64, usize) {
    let [a, b, c, d, e, f, g, h, ..] = *bytes;
    let by_8 = f64::from(i8::from_le_bytes([a]));
    let by_16 = f64::from(i16::from_le_bytes([a, b]));
    let by_32 = f64::from(i32::from_le_bytes([a, b, c, d]));
    let ten = |form: u8| TENS.get(usize::from(first - form)).copied().unwrap_or(f64::NAN);
    match first {
        0..form::PAIR => (f64::from(first), 0),
        form::PAIR..form::PAIR_END => {
            let offset = u16::from_le_bytes([a, first - form::PAIR]);
            (f64::from(i32::from(offset) + form::PAIR_FROM), 1)
        }
        form::WHOLE_16 => (by_16, 2),
        form::WHOLE_32 => (by_32, 4),
        form::F32 => (f64::from(f32::from_le_bytes([a, b, c, d])), 4),
        form::F64 => (f64::from_le_bytes([a, b, c, d, e, f, g, h]), 8),
        form::INFINITE => (f64::INFINITY, 0),
        form::MINUS_INFINITE => (f64::NEG_INFINITY, 0),
        form::MINUS_ZERO => (-0.0, 0),
        form::DECIMAL_8..form::DECIMAL_16 => (by_8 / ten(form::DECIMAL_8), 1),
        form::DECIMAL_16..form::DECIMAL_32 => (by_16 / ten(form::DECIMAL_16), 2),
        form::DECIMAL_32..form::POWER_8 => (by_32 / ten(form::DECIMAL_32), 4),
        form::POWER_8 => {
            (raised(i32::from(i8::from_le_bytes([a])), i8::from_le_bytes([b]).into()), 2)
        }
        form::POWER_16 => {
            (raised(i16::from_le_bytes([a, b]).into(), i16::from_le_bytes([c, d])), 4)
        }
        form::POWER_32 => (raised(i32::from_le_bytes([a, b, c, d]), i16::from_le_bytes([e, f])), 6),
        _ => (f64::NAN, 0),
    }
}

/// A short text without allocation.
#[derive(Default)]
struct Text {
    bytes: [u8; 32],
    length: usize,
}

impl Text {
    fn as_str(&self) -> Option<&str> {
        std::str::from_utf8(self.bytes.get(..self.length)?).ok()
    }
}

impl Write for Text {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        let end = self.length + text.len();
        let slot = self.bytes.get_mut(self.length..end).ok_or(std::fmt::Error)?;
        slot.copy_from_slice(text.as_bytes());
        self.length = end;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn number() -> impl Strategy<Value = f64> {
        prop_oneof![
            any::<f64>(),
            any::<f32>().prop_map(f64::from),
            any::<i16>().prop_map(f64::from),
            any::<i64>().prop_map(|number| number as f64),
            (any::<i32>(), 0..9)
                .prop_map(|(digits, places)| { f64::from(digits) / 10_f64.powi(places) }),
            (any::<i16>(), -330..310).prop_map(|(digits, exponent)| {
                format!("{digits}e{exponent}").parse().unwrap_or_default()
            }),
            prop::sample::select(vec![0.0, -0.0, f64::NAN, f64::INFINITY, -f64::INFINITY, 5e-324]),
            (0_u8..3).prop_map(f64::from),
        ]
    }

    fn bits(values: impl IntoIterator<Item = f64>) -> Vec<u64> {
        let one = |value: f64| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
        values.into_iter().map(one).collect()
    }

    proptest! {
        #![proptest_config(fixtures::cases(256))]

        #[test]
        fn numbers_are_read_back_bit_for_bit(
            values in prop::collection::vec(number(), 0..400),
            length in 0_usize..20,
        ) {
            let packed = Packed::of(values.iter().copied(), length);
            prop_assert_eq!(packed.iter().len(), values.len());
            prop_assert_eq!(bits(packed.iter()), bits(values.iter().copied()));
            // the first row's length known only at its end
            let mut late = Packed::default();
            let first = length.min(values.len());
            late.extend(values[..first].iter().copied());
            late.end_first_row();
            late.extend(values[first..].iter().copied());
            prop_assert_eq!(bits(late.finished().iter()), bits(values.iter().copied()));
        }

        #[test]
        fn rows_become_columns(rows in 1_usize..9, columns in 1_usize..9, seed in 0_u32..100) {
            let value = |row: usize, column: usize| f64::from((row * 31 + column) as u32 % (1 + seed));
            let all = (0..rows * columns).map(|index| value(index / columns, index % columns));
            let wanted = (0..rows * columns).map(|index| value(index % rows, index / rows));
            prop_assert_eq!(bits(Packed::of(all, columns).transposed(columns).iter()), bits(wanted));
        }

        /// No number is longer than its text with a separator, but for those of eight digits and more.
        #[test]
        fn a_number_is_no_longer_than_its_text(digits in any::<i32>(), exponent in -320_i32..300) {
            for text in [
                format!("{digits}"),
                format!("{}", f64::from(digits % 1000) / 10.0),
                format!("{}e{exponent}", digits % 1000),
                format!("{}e{}", digits % 10, exponent % 10),
                format!("{}", f64::from(digits % 100_000) / 1000.0),
                format!("{}", f64::from(digits) / 1e6),
            ] {
                let value: f64 = text.parse().unwrap_or_default();
                let text = text.trim_start_matches("0").trim_start_matches("-0");
                prop_assert!(form_of(value).1 <= text.len() + 1, "{} {:?}", text, form_of(value));
            }
        }
    }

    /// Blocks, rows that are the same, and rows that are too long to compare.
    #[test]
    fn long_lists_are_read_back_and_repeated_rows_cost_nothing() {
        let value = |index: usize| (index as f64).sin();
        let long: Vec<f64> = (0..200_000).map(value).collect();
        for length in [1, 208, MOST_COMPARED, MOST_COMPARED + 1, 200_000] {
            let packed = Packed::of(long.iter().copied(), length);
            assert!(packed.iter().eq(long.iter().copied()), "{length}");
            assert!(packed.bytes() <= 10 * long.len(), "{length}: {}", packed.bytes());
        }
        let same = Packed::of((0..2_000_000).map(|index| value(index % 208)), 208);
        assert!(same.bytes() < 4000, "{}", same.bytes());
        assert!(
            same.iter().skip(1_999_900).enumerate().all(|(i, v)| v == value((1_999_900 + i) % 208))
        );
        let wide = Packed::of(long.iter().copied(), 1000).transposed(1000);
        assert!(wide.iter().enumerate().all(|(i, v)| v == value(i % 200 * 1000 + i / 200)));
    }
}
