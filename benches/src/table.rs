//! Tables of results, in Markdown.

use std::fmt;

/// A cell of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Text that identifies a row.
    Text(String),
    /// A value and its number of decimal places; NaN is shown as a dash.
    Number(f64, usize),
}

impl Cell {
    /// Creates a text cell from any displayable value.
    pub fn text(value: impl ToString) -> Self {
        Self::Text(value.to_string())
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::Number(value, _) if value.is_nan() => f.write_str("-"),
            Self::Number(value, digits) => write!(f, "{value:.digits$}"),
        }
    }
}

/// Results of one experiment.
#[derive(Debug, Clone)]
pub struct Table {
    /// Heading.
    pub title: &'static str,
    /// Conditions: trials, seeds, definitions.
    pub note: String,
    /// Column headings, with units.
    pub columns: Vec<&'static str>,
    /// Cells of each row.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// The conditions and the rows, without the heading.
    pub fn body(&self) -> String {
        let line = |cells: &[Cell]| {
            let cells: Vec<String> = cells.iter().map(Cell::to_string).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let head: Vec<Cell> = self.columns.iter().map(Cell::text).collect();
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        format!("{}\n\n{}|{}\n{rows}", self.note, line(&head), "---|".repeat(head.len()))
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "## {}\n\n{}", self.title, self.body())
    }
}

/// Quantile of the values; NaN if there are none.
pub fn quantile(values: &[f64], fraction: f64) -> f64 {
    eit_core::quantile(values, fraction).unwrap_or(f64::NAN)
}
