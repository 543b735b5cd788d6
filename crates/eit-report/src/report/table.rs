//! Tables of experiments, written in three formats.

use super::markdown;
use crate::Answer;
use crate::error::ReportError;
use crate::output::{OutFolder, io};
use eit_skin::Progress;
use serde_json::{Map, Value, json};

/// A report that consists of tables.
pub(super) struct TableReport<'a> {
    pub title: &'a str,
    pub tables: &'a [Table],
    /// File names: `.md`, `.csv`, `.json`.
    pub files: [&'static str; 3],
}

/// Writes all tables as Markdown, CSV and JSON; the Markdown is the answer.
pub(super) fn write(
    report: &TableReport<'_>,
    out: &mut OutFolder,
    progress: &Progress,
) -> Result<Answer, ReportError> {
    let TableReport { title, tables, files: [md, csv, json] } = *report;
    let sections: Vec<String> = tables.iter().map(Table::markdown).collect();
    let markdown = format!("# {title}\n\n{}", sections.join("\n"));
    out.write(md, |w| w.write_all(markdown.as_bytes()).map_err(io))?;
    let lines: String = tables.iter().map(Table::csv).collect();
    let text = format!("table,row,column,value\n{lines}");
    out.write(csv, |w| w.write_all(text.as_bytes()).map_err(io))?;
    let value = json!({
        "tables": tables.iter().map(Table::json).collect::<Vec<_>>(),
        "stages": progress.times(),
    });
    out.write(json, |w| writeln!(w, "{value:#}").map_err(io))?;
    let text =
        format!("{markdown}\nwritten to {}: {}", out.path().display(), out.names().join(", "));
    Ok(Answer { text, json: value })
}

/// A cell of a table.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    /// Text that identifies a row.
    Text(String),
    /// A value and its number of decimal places; NaN is shown as a dash.
    Number(f64, usize),
}

/// Results of one experiment.
#[derive(Debug, Clone)]
pub(super) struct Table {
    /// Name in the CSV and JSON files.
    pub name: &'static str,
    /// Heading.
    pub title: &'static str,
    /// Conditions: trials, seeds, definitions.
    pub note: String,
    /// Column headings, with units.
    pub columns: Vec<&'static str>,
    /// Cells of each row.
    pub rows: Vec<Vec<Cell>>,
}

impl Cell {
    /// Creates a text cell from any displayable value.
    pub fn text(value: impl ToString) -> Self {
        Self::Text(value.to_string())
    }

    fn shown(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(value, _) if value.is_nan() => "-".to_owned(),
            Self::Number(value, digits) => format!("{value:.digits$}"),
        }
    }
}

impl Table {
    /// Returns the Markdown section.
    pub fn markdown(&self) -> String {
        let shown = |row: &Vec<Cell>| row.iter().map(Cell::shown).collect::<Vec<_>>();
        let rows: Vec<Vec<String>> = self.rows.iter().map(shown).collect();
        format!("## {}\n\n{}\n\n{}", self.title, self.note, markdown::table(&self.columns, &rows))
    }

    /// Returns CSV lines `table,row,column,value`; `row` consists of the text cells.
    pub fn csv(&self) -> String {
        let mut text = String::new();
        for row in &self.rows {
            let texts = row.iter().filter_map(|cell| match cell {
                Cell::Text(text) => Some(text.as_str()),
                Cell::Number(..) => None,
            });
            let key = texts.collect::<Vec<_>>().join("; ").replace('"', "\"\"");
            for (column, cell) in self.columns.iter().zip(row) {
                if let Cell::Number(value, _) = cell {
                    text += &format!("{},\"{key}\",\"{column}\",{value}\n", self.name);
                }
            }
        }
        text
    }

    /// Returns one JSON object per row; values that are not finite are null.
    pub fn json(&self) -> Value {
        let of_row = |row: &Vec<Cell>| {
            let value = |cell: &Cell| match cell {
                Cell::Text(text) => text.parse::<f64>().map_or_else(|_| json!(text), Value::from),
                Cell::Number(value, _) => json!(value),
            };
            let pairs =
                self.columns.iter().zip(row).map(|(c, cell)| ((*c).to_owned(), value(cell)));
            Value::Object(pairs.collect::<Map<_, _>>())
        };
        let rows: Vec<Value> = self.rows.iter().map(of_row).collect();
        json!({ "name": self.name, "title": self.title, "note": self.note, "rows": rows })
    }
}
