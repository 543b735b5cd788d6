//! A table of the benchmark, as HTML, Markdown and CSV.

use crate::error::ReportError;
use crate::html::Block;
use crate::output::io;
use std::io::Write;

/// Column headings, rows and conditions.
#[derive(Clone)]
pub(super) struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
    note: String,
}

impl Table {
    /// Creates a table; its column headings are separated by bars.
    pub(crate) fn new(head: &str, rows: Vec<Vec<String>>, note: impl Into<String>) -> Self {
        let head = head.split(" | ").map(str::to_owned).collect();
        Self { head, rows, note: note.into() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(crate) fn block(&self) -> Block {
        let Self { head, rows, note } = self.clone();
        Block::Table { head, rows, note }
    }

    pub(crate) fn markdown(&self) -> String {
        let line = |cells: &Vec<String>| format!("| {} |\n", cells.join(" | "));
        let rule = format!("|{}\n", "---|".repeat(self.head.len()));
        let rows: String = self.rows.iter().map(line).collect();
        format!("{}{rule}{rows}\n{}\n", line(&self.head), self.note)
    }

    /// Writes CSV; cells with commas, quotes or line breaks are quoted.
    pub(crate) fn write_csv(&self, out: &mut dyn Write) -> Result<(), ReportError> {
        let mut writer = csv::Writer::from_writer(out);
        writer.write_record(&self.head).map_err(csv_failed)?;
        for row in &self.rows {
            writer.write_record(row).map_err(csv_failed)?;
        }
        writer.flush().map_err(io)
    }
}

pub(super) fn csv_failed(error: csv::Error) -> ReportError {
    ReportError::Failure(format!("writing failed: {error}"))
}
