//! The numbers of a line of text, whatever a board, a logger or a spreadsheet puts around them: one reader for files and for lines
//! that arrive.
//!
//! Numbers are separated by a comma or semicolon with blanks around it, or by blanks. What stands around them is stripped and named
//! ([`Stripped`]): a time, label or counter before an arrow or colon, brackets, Python's `b'...'`, quotes, units. Where semicolons
//! or blanks separate and every comma stands within a number without a point, commas are decimal.

use super::number::Number;

/// What was stripped from lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Stripped {
    label: bool,
    brackets: bool,
    quotes: bool,
    units: bool,
    commas: bool,
}

impl Stripped {
    /// A counter.
    pub(crate) const LABEL: Self =
        Self { label: true, brackets: false, quotes: false, units: false, commas: false };

    /// What was stripped from one line or the other.
    pub(crate) fn or(self, other: Self) -> Self {
        Self {
            label: self.label || other.label,
            brackets: self.brackets || other.brackets,
            quotes: self.quotes || other.quotes,
            units: self.units || other.units,
            commas: self.commas || other.commas,
        }
    }

    /// Names it; `None` if nothing was.
    pub(crate) fn words(self) -> Option<String> {
        let all = [
            (self.label, "a time, label or counter before the numbers"),
            (self.brackets, "brackets"),
            (self.quotes, "quotes"),
            (self.units, "units"),
            (self.commas, "decimal commas, read as points"),
        ];
        let found: Vec<&str> =
            all.into_iter().filter(|(is, _)| *is).map(|(_, what)| what).collect();
        (!found.is_empty()).then(|| found.join(", "))
    }
}

/// A field that is not a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NotANumber<'a> {
    /// Index of the field, from 0.
    pub(crate) field: usize,
    pub(crate) text: &'a str,
}

/// Calls `take` with each number of a line, NaN for what is printed as `nan`, `inf` or the like. Returns what was stripped.
///
/// # Errors
/// The first field that is not a number, also an empty one between two commas.
pub(crate) fn numbers(line: &str, mut take: impl FnMut(f64)) -> Result<Stripped, NotANumber<'_>> {
    let mut stripped = Stripped::default();
    let bare = bare(line.trim(), &mut stripped);
    if bare.is_empty() && !line.trim().is_empty() {
        return Err(NotANumber { field: 0, text: line.trim() });
    }
    let has_commas = has_decimal_commas(bare);
    stripped.commas = has_commas;
    let is_blank = |byte: &u8| matches!(byte, b' ' | b'\t');
    let is_mark = |byte: u8| byte == b';' || (byte == b',' && !has_commas);
    let (mut field, mut rest) = (0, bare);
    while !rest.is_empty() {
        let is_end = |byte: u8| is_blank(&byte) || is_mark(byte);
        let length = rest.bytes().position(is_end).unwrap_or(rest.len());
        let text = &rest[..length];
        rest = &rest[length..];
        rest = &rest[rest.bytes().take_while(|byte| is_blank(byte)).count()..];
        match value(text, &mut stripped) {
            Some(value) => take(value),
            None => return Err(NotANumber { field, text }),
        }
        // a unit after a blank
        let next = &rest[..rest.bytes().position(is_end).unwrap_or(rest.len())];
        if is_unit(next) {
            stripped.units = true;
            rest = rest[next.len()..].trim_start_matches([' ', '\t']);
        }
        if rest.bytes().next().is_some_and(is_mark) {
            rest = rest[1..].trim_start_matches([' ', '\t']);
        }
        field += 1;
    }
    Ok(stripped)
}

/// The part of a trimmed line that holds numbers, without what ends it.
fn bare<'a>(line: &'a str, stripped: &mut Stripped) -> &'a str {
    const ENDS: [char; 4] = [',', ';', ' ', '\t'];
    let mut bare = line.trim_end_matches(ENDS);
    // what most lines are
    let is_plain = |byte: u8| byte.is_ascii_digit() || b"+-.,; \teE".contains(&byte);
    if bare.bytes().all(is_plain) {
        return bare;
    }
    for quote in ['\'', '"'] {
        let inner = bare.strip_prefix('b').and_then(|bare| bare.strip_prefix(quote));
        if let Some(inner) = inner {
            stripped.brackets = true;
            let inner = inner.strip_suffix(quote).unwrap_or(inner);
            // as Python writes line ends
            let ended = |text: &'a str| {
                let text = text.trim_end_matches(ENDS);
                text.strip_suffix("\\n").or_else(|| text.strip_suffix("\\r"))
            };
            bare = std::iter::successors(Some(inner), |text| ended(text)).last().unwrap_or(inner);
            bare = bare.trim_end_matches(ENDS);
        }
    }
    if let Some((_, right)) = bare.rsplit_once("->").or_else(|| bare.rsplit_once("=>")) {
        (bare, stripped.label) = (right.trim_start(), true);
    }
    if let Some((label, right)) = bare.split_once('[') {
        stripped.label |= !label.trim().is_empty();
        stripped.brackets = true;
        bare = right.rsplit_once(']').map_or(right, |(inner, _)| inner);
    }
    let inner = bare.trim_matches(['[', ']', '(', ')', '{', '}', ' ', '\t']);
    stripped.brackets |= inner.len() < bare.trim().len();
    bare = inner.trim_end_matches(ENDS);
    if let Some((label, right)) = bare.rsplit_once(':') {
        let is_digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
        // a time such as 12:15:03.007 ends with a separator, a label with the colon
        let is_time = is_digit(label.chars().last()) && is_digit(right.chars().next());
        let end = if is_time { right.find(ENDS).unwrap_or(right.len()) } else { 0 };
        (bare, stripped.label) = (right[end..].trim_start_matches(ENDS), true);
    }
    bare
}

/// Whether commas stand within numbers only, which something else separates.
fn has_decimal_commas(bare: &str) -> bool {
    let has = |byte: u8| bare.as_bytes().contains(&byte);
    if !has(b',') || has(b'.') {
        return false;
    }
    let is_number = |field: &str| {
        let mut parts = field.split(',');
        let digits = |part: &str| part.bytes().any(|byte| byte.is_ascii_digit());
        parts.next().is_some_and(digits)
            && parts.next().is_none_or(digits)
            && parts.next().is_none()
    };
    let mut fields = bare.split([';', '\t', ' ']).filter(|field| !field.is_empty());
    fields.clone().nth(1).is_some() && fields.all(is_number)
}

/// The number of a field, without quotes and unit.
fn value(text: &str, stripped: &mut Stripped) -> Option<f64> {
    let plain = |text: &str| match stripped.commas {
        true => Number::Decimal.parse(text.replace(',', ".").as_bytes()),
        false => Number::Decimal.parse(text.as_bytes()),
    };
    if let Some(value) = plain(text) {
        return Some(value);
    }
    let bare = text.trim_matches(['"', '\'']);
    if Number::is_not_finite(bare.as_bytes()) {
        stripped.quotes |= bare.len() < text.len();
        return Some(f64::NAN);
    }
    let digits = bare.trim_end_matches(|c: char| !c.is_ascii_digit() && c != '.');
    let unit = &bare[digits.len()..];
    let value = plain(digits).filter(|_| unit.is_empty() || is_unit(unit))?;
    stripped.quotes |= bare.len() < text.len();
    stripped.units |= !unit.is_empty();
    Some(value)
}

/// Whether a word is a unit of what instruments measure, with or without a prefix.
fn is_unit(word: &str) -> bool {
    const UNITS: [&str; 8] = ["V", "A", "Ohm", "Ohms", "\u{3a9}", "\u{2126}", "S", "dB"];
    const PREFIXES: [&str; 6] = ["n", "u", "\u{b5}", "\u{3bc}", "m", "k"];
    let is = |word: &str| UNITS.iter().any(|unit| unit.eq_ignore_ascii_case(word));
    is(word) || PREFIXES.iter().any(|prefix| word.strip_prefix(prefix).is_some_and(is))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> (Vec<f64>, String) {
        let mut found = Vec::new();
        match numbers(line, |value| found.push(value)) {
            Ok(stripped) => (found, stripped.words().unwrap_or_default()),
            Err(NotANumber { field, text }) => (found, format!("{field}: {text:?}")),
        }
    }

    #[test]
    fn numbers_are_found_in_what_people_print() {
        let label = "a time, label or counter before the numbers";
        for (line, stripped) in [
            ("1.5,-2,3e-1", ""),
            (" 1.5, -2 ,3e-1,", ""),
            ("1.5;-2;3e-1;", ""),
            ("1.5,-2,3e-1,;", ""),
            ("1.5\t-2\t3e-1", ""),
            ("1.5  -2 3e-1", ""),
            ("12:15:03.007 -> 1.5,-2,3e-1", label),
            ("12:15:03.007 -> 7: 1.5,-2,3e-1;", label),
            ("12:15:03.007, 1.5,-2,3e-1", label),
            ("2026-11-27 12:15:03 1.5 -2 3e-1", label),
            ("7: 1.5,-2,3e-1", label),
            ("magnitudes : 1.5,-2,3e-1", label),
            ("[1.5, -2, 3e-1]", "brackets"),
            ("[[ 1.5 -2 3e-1]", "brackets"),
            ("b'1.5, -2, 3e-1, \\n'", "brackets"),
            ("b'1.5,-2,3e-1\\r\\n'", "brackets"),
            ("{\"t\":7,\"v\":[1.5,-2,3e-1]}", &format!("{label}, brackets")),
            ("\"1.5\",\"-2\",\"3e-1\"", "quotes"),
            ("1.5mV -2mV 3e-1mV", "units"),
            ("1.5 V, -2 V, 3e-1 V", "units"),
            ("1,5;-2,0;3e-1", "decimal commas, read as points"),
            ("1,5\t-2\t0,3", "decimal commas, read as points"),
            ("1,5 -2 0,3", "decimal commas, read as points"),
        ] {
            let (found, said) = read(line);
            assert_eq!(
                (found.as_slice(), said.as_str()),
                (&[1.5, -2.0, 0.3][..], stripped),
                "{line}"
            );
        }
        let (found, _) = read("b'1,nan\\r\\n'");
        assert!(found.len() == 2 && found[1].is_nan(), "{found:?}");
        let (found, _) = read("nan,-inf,OVF,1");
        assert!(found[..3].iter().all(|value| value.is_nan()) && found[3] == 1.0);
    }

    #[test]
    fn what_is_no_number_is_named() {
        for (line, field) in [
            ("1,,2", "1: \"\""),
            ("1,x2,3", "1: \"x2\""),
            ("1;2,3.5,4;x", "4: \"x\""),
            ("hello", "0: \"hello\""),
            ("1 apple", "1: \"apple\""),
            ("1,2;3,4,5", ""),
            ("Backtrace:0x4000:0x3FFB", "0: \"Backtrace:0x4000:0x3FFB\""),
            (";", "0: \";\""),
            ("1.2.3", "0: \"1.2.3\""),
            ("0x12", "0: \"0x12\""),
            ("", ""),
        ] {
            assert_eq!(read(line).1, field, "{line}");
        }
        // whole numbers with commas between them are many
        assert_eq!(read("1,2,3,4").0.len(), 4);
        assert_eq!(read("1, 2 3, 4").0.len(), 4);
    }
}
