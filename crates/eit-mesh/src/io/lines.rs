//! Reads lines and words of a text file with sections; errors give the line.

use crate::MeshError;
use std::borrow::Cow;
use std::str::{FromStr, SplitAsciiWhitespace};

/// Iterates over the lines of a file.
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    file: &'a str,
    /// 1-based number of the last line read.
    pub(super) number: usize,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8], file: &'a str) -> Self {
        // some Windows editors prepend a byte order mark
        let rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        Self { rest, file, number: 0 }
    }

    /// Returns the next non-blank line, trimmed, or `None` at the end of the file.
    pub(super) fn next_line(&mut self) -> Option<Cow<'a, str>> {
        while !self.rest.is_empty() {
            let end = self.rest.iter().position(|&b| b == b'\n').unwrap_or(self.rest.len());
            let line = self.rest[..end].trim_ascii();
            self.rest = self.rest.get(end + 1..).unwrap_or(&[]);
            self.number += 1;
            if !line.is_empty() {
                return Some(String::from_utf8_lossy(line));
            }
        }
        None
    }

    /// Returns the next line of a section; an error if the section or the file ends.
    pub(super) fn content(
        &mut self,
        section: &str,
        until: &str,
    ) -> Result<Cow<'a, str>, MeshError> {
        match self.next_line() {
            Some(line) if !line.starts_with('$') => Ok(line),
            _ => {
                Err(self
                    .error(format!("section ${section} ends before {until}: is the file cut off?")))
            }
        }
    }

    /// Returns the first number of a section.
    pub(super) fn count(&mut self, section: &str) -> Result<u64, MeshError> {
        let line = self.content(section, "its count")?;
        self.fields(&line).next("a count")
    }

    pub(super) fn end(&mut self, section: &str) -> Result<(), MeshError> {
        match self.next_line() {
            Some(line) if line.strip_prefix("$End") == Some(section) => Ok(()),
            _ => {
                Err(self
                    .error(format!("$End{section} is missing here: is the section's count right?")))
            }
        }
    }

    pub(super) fn skip_section(&mut self, section: &str) -> Result<(), MeshError> {
        let start = self.number;
        while let Some(line) = self.next_line() {
            if line.strip_prefix("$End") == Some(section) {
                return Ok(());
            }
        }
        let section = short(section);
        Err(self.error(format!("section ${section} of line {start} has no $End{section}")))
    }

    pub(super) fn fields<'l>(&'l self, line: &'l str) -> Fields<'l, 'a> {
        Fields { words: line.split_ascii_whitespace(), line, lines: self }
    }

    /// Creates an error at the last line read.
    pub(super) fn error(&self, problem: impl Into<String>) -> MeshError {
        MeshError::Parse { file: self.file.into(), line: self.number, problem: problem.into() }
    }
}

/// The words of one line.
pub(super) struct Fields<'l, 'a> {
    words: SplitAsciiWhitespace<'l>,
    line: &'l str,
    pub(super) lines: &'l Lines<'a>,
}

impl<'l> Fields<'l, '_> {
    pub(super) fn next<T: FromStr>(&mut self, what: &str) -> Result<T, MeshError> {
        let Some(word) = self.words.next() else {
            return Err(self.lines.error(format!("the line ends before {what}")));
        };
        word.parse()
            .map_err(|_| self.lines.error(format!("expected {what}, found \"{}\"", short(word))))
    }

    /// Returns what follows the first two words.
    pub(super) fn rest(&self) -> &'l str {
        let mut rest = self.line;
        for _ in 0..2 {
            rest = rest.trim_ascii_start();
            rest = rest.find(|c: char| c.is_ascii_whitespace()).map_or("", |end| &rest[end..]);
        }
        rest.trim_ascii()
    }

    pub(super) fn position(&mut self) -> Result<[f64; 3], MeshError> {
        let mut position_m = [0.0; 3];
        for x in &mut position_m {
            *x = self.next("a coordinate")?;
            if !f64::is_finite(*x) {
                return Err(self.lines.error(format!("the coordinate {x} is not finite")));
            }
        }
        Ok(position_m)
    }

    pub(super) fn tags<const N: usize>(&mut self) -> Result<[u64; N], MeshError> {
        let mut tags = [0; N];
        for tag in &mut tags {
            *tag = self.next("a node's tag")?;
        }
        Ok(tags)
    }

    /// Rejects leftover words.
    pub(super) fn finish(&mut self) -> Result<(), MeshError> {
        match self.words.next() {
            None => Ok(()),
            Some(word) => {
                Err(self.lines.error(format!("\"{}\" is one word too many", short(word))))
            }
        }
    }
}

/// Returns the first 40 characters, without control characters, for error messages.
pub(super) fn short(text: &str) -> String {
    text.chars().take(40).map(|c| if c.is_control() { '?' } else { c }).collect()
}
