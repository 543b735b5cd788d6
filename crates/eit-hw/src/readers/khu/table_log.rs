//! The projection table, `ProjectionTableSendLog.txt`.

use std::path::Path;

use crate::error::{HwError, Place};
use crate::frame::Quadruple;
use crate::readers::{text, wrong_field};

/// Gain per step of the digital code: 40 / 200.
const GAIN_PER_CODE: f64 = 0.2;

const SOURCE: u64 = 2;
const SINK: u64 = 3;

/// Electrodes and gain of each record of a scan.
#[derive(Debug)]
pub(super) struct ProjectionTable {
    /// Number of channels of the instrument, at least 1.
    pub(super) channels: usize,
    /// Quadruple of each record, [projection, channel] flattened.
    pub(super) quadruples: Vec<Quadruple>,
    /// Voltage gain of each record.
    pub(super) gains: Vec<f64>,
}

struct Row {
    line: usize,
    projection: u64,
    channel: u64,
    role: u64,
    code: u64,
}

impl ProjectionTable {
    /// Parses the content of a table file; `path` is used in messages only.
    pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Self, HwError> {
        let content = text::decode(bytes, path)?;
        let mut rows = Vec::new();
        for (line, content) in text::lines(content) {
            if !content.trim().is_empty() && !content.starts_with("ProjIndex") {
                rows.push(row(content, line, path)?);
            }
        }
        let channels = rows.iter().take_while(|row| row.projection == 0).count();
        if channels == 0 {
            return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 });
        }
        let mut quadruples = Vec::with_capacity(rows.len());
        let mut gains = Vec::with_capacity(rows.len());
        for (projection, rows) in rows.chunks(channels).enumerate() {
            let [source, sink] = drive(rows, projection, channels, path)?;
            for (channel, row) in (0_u32..).zip(rows) {
                let before = channel.checked_sub(1).unwrap_or(last_of(channels));
                quadruples.push([source, sink, before, channel]);
                gains.push(row.code as f64 * GAIN_PER_CODE);
            }
        }
        Ok(Self { channels, quadruples, gains })
    }
}

/// Returns the last channel; more rows than `u32` can count would not fit into memory.
fn last_of(channels: usize) -> u32 {
    u32::try_from(channels - 1).unwrap_or(u32::MAX)
}

/// Returns source and sink of the rows of one projection.
fn drive(
    rows: &[Row],
    projection: usize,
    channels: usize,
    path: &Path,
) -> Result<[u32; 2], HwError> {
    let line = rows.first().map_or(1, |row| row.line);
    let count = |what, found, wanted| {
        HwError::count(
            Place::line(path, line),
            what,
            [found, wanted],
            "this projection is invalid: copy the table again from the instrument's folder",
        )
    };
    let in_order = rows
        .iter()
        .zip(0..)
        .take_while(|(row, channel)| row.projection == projection as u64 && row.channel == *channel)
        .count();
    if in_order != channels || rows.len() != channels {
        return Err(count("channels in order", in_order, channels));
    }
    let with_role = |role| {
        let mut found = (0_u32..).zip(rows).filter(|(_, row)| row.role == role);
        (found.next().map(|(channel, _)| channel), found.count())
    };
    match (with_role(SOURCE), with_role(SINK)) {
        ((Some(source), 0), (Some(sink), 0)) => Ok([source, sink]),
        ((None, _), _) => Err(count("sources (ChInfo 2)", 0, 1)),
        ((_, 1..), _) => Err(count("sources (ChInfo 2)", with_role(SOURCE).1 + 1, 1)),
        (_, (None, _)) => Err(count("sinks (ChInfo 3)", 0, 1)),
        (_, (_, more)) => Err(count("sinks (ChInfo 3)", more + 1, 1)),
    }
}

fn row(content: &str, line: usize, path: &Path) -> Result<Row, HwError> {
    let mut fields = content.split_whitespace();
    let mut next = |skipped: usize, field| {
        let text = fields.nth(skipped).unwrap_or_default();
        text.parse::<u64>().map_err(|_| wrong(line, path, field, text, "a whole number"))
    };
    let row = Row {
        line,
        projection: next(0, "ProjIndex")?,
        channel: next(0, "Ch")?,
        role: next(1, "ChInfo")?,
        code: next(5, "Gain1")?,
    };
    if (1..=255).contains(&row.code) {
        Ok(row)
    } else {
        Err(wrong(line, path, "Gain1", &row.code.to_string(), "a code from 1 to 255"))
    }
}

fn wrong(
    line: usize,
    path: &Path,
    field: &'static str,
    text: &str,
    wanted: &'static str,
) -> HwError {
    let mend = "copy the table again from the instrument's folder";
    wrong_field(Place::line(path, line), field, text, wanted, mend)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a table of 4 channels and 2 projections; roles are the column `ChInfo`.
    fn text_of(roles: [[u32; 4]; 2]) -> String {
        let mut text = "ProjIndex\tCh\tChIndex\tChInfo\tInj.Freq\tAmp1High\r\n".to_owned();
        for (projection, roles) in roles.iter().enumerate() {
            for (channel, role) in roles.iter().enumerate() {
                let gain = if *role == 0 { 10 } else { 1 };
                text += &format!(
                    "{projection}\t{channel}\t0\t{role}\t3\t1\t128\t1\t128\t{gain}\t1\r\n"
                );
            }
        }
        text
    }

    const ROLES: [[u32; 4]; 2] = [[2, 3, 0, 0], [0, 2, 0, 3]];

    /// Asserts that the error message contains all of `parts`.
    #[track_caller]
    fn refused(result: Result<ProjectionTable, HwError>, parts: &[&str]) {
        let message = result.expect_err("refused").to_string();
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }

    #[test]
    fn tables_and_their_faults() {
        let table = |text: &str| ProjectionTable::parse(text.as_bytes(), Path::new("t.txt"));
        let good = table(&text_of(ROLES)).unwrap();
        assert_eq!(good.channels, 4);
        assert_eq!(good.quadruples[..2], [[0, 1, 3, 0], [0, 1, 0, 1]]);
        assert_eq!(good.quadruples[7], [1, 3, 2, 3]);
        // code 1 is 0.2, code 10 is 2
        assert_eq!(good.gains, [0.2, 0.2, 2.0, 2.0, 2.0, 0.2, 2.0, 0.2]);
        refused(table(""), &["t.txt", "empty"]);
        refused(table("ProjIndex\n"), &["no complete frame"]);
        refused(table(&text_of([[0, 3, 0, 0]; 2])), &["line 2", "0 sources", "expected 1"]);
        refused(table(&text_of([[2, 2, 3, 0]; 2])), &["2 sources", "expected 1"]);
        refused(table(&text_of([ROLES[0], [2, 0, 0, 0]])), &["line 6", "0 sinks"]);
        refused(table(&text_of([[2, 3, 3, 3]; 2])), &["3 sinks", "expected 1"]);
        let cut = text_of(ROLES);
        refused(table(&cut[..cut.len() - 30]), &["channels in order", "expected 4"]);
        refused(table("0\t0\t0\t2\n"), &["line 1", "Gain1", "\"\""]);
        refused(table("0 0 0 2 3 1 128 1 128 256\n"), &["line 1", "Gain1", "1 to 255"]);
        refused(table("0 x 0 2 3 1 128 1 128 25\n"), &["line 1", "Ch is \"x\""]);
    }
}
