//! Generated parts of `docs/PERFORMANCE.md`, between the same markers as in `benches/compare.py`.

use crate::Result;
use std::path::{Path, PathBuf};

/// Writes a part of `docs/PERFORMANCE.md`, through a temporary file.
///
/// # Errors
/// A file that cannot be read or written, or that does not contain both markers of the part exactly
/// once.
pub fn write(part: &str, body: &str) -> Result<()> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/PERFORMANCE.md");
    let failed = |e: std::io::Error| format!("{}: {e}", path.display());
    let text = replaced(&std::fs::read_to_string(&path).map_err(failed)?, part, body)?;
    let beside = PathBuf::from(format!("{}.new", path.display()));
    std::fs::write(&beside, text).map_err(failed)?;
    Ok(std::fs::rename(&beside, &path).map_err(failed)?)
}

fn replaced(text: &str, part: &str, body: &str) -> Result<String> {
    let marks =
        [format!("<!-- generated: {part} -->"), format!("<!-- end of generated: {part} -->")];
    if marks.iter().any(|mark| text.matches(mark.as_str()).count() != 1) {
        return Err(format!("no '{}' and '{}' once each", marks[0], marks[1]).into());
    }
    let (before, rest) = text.split_once(&marks[0]).ok_or("counted above")?;
    let (_, after) = rest.split_once(&marks[1]).ok_or("the marks stand in the wrong order")?;
    Ok(format!("{before}{}\n{}\n{}{after}", marks[0], body.trim_end(), marks[1]))
}

/// Formats three significant digits, without an exponent.
pub fn digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let before = value.abs().log10().floor() as i32;
    format!("{value:.*}", usize::try_from(2 - before).unwrap_or(0))
}

/// Describes processor, cores and compiler, on which all times depend.
pub fn machine() -> String {
    let list = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = list.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    let processor = model.map_or(std::env::consts::ARCH, |(_, name)| name.trim());
    let cores = std::thread::available_parallelism().map_or(1, |count| count.get());
    let version = std::process::Command::new("rustc").arg("--version").output();
    let version = version.map(|out| String::from_utf8_lossy(&out.stdout).into_owned());
    let version = version.unwrap_or_default();
    let compiler = version.split(" (").next().unwrap_or_default().trim();
    format!("{processor}, {cores} cores; {compiler}")
}

/// Load average of the last minute, if the system reports it.
pub fn load() -> Option<f64> {
    std::fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_replaced_between_their_marks() {
        let marked = |body: &str| {
            format!("a\n<!-- generated: x -->\n{body}\n<!-- end of generated: x -->\nb\n")
        };
        assert_eq!(replaced(&marked("old"), "x", "new\n").unwrap(), marked("new"));
        assert!(replaced(&marked("old"), "y", "new").is_err());
        assert!(replaced(&marked("old").repeat(2), "x", "new").is_err());
    }

    #[test]
    fn three_digits() {
        let written = [0.0, 0.01234, 0.999, 9.876, 98.76, 12345.6].map(digits);
        assert_eq!(written, ["0", "0.0123", "0.999", "9.88", "98.8", "12346"]);
    }
}
