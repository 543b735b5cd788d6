//! The table of presses: a CSV file with a line for each press.

use crate::error::SkinError;
use serde::Deserialize;
use std::path::Path;

/// A line of the table.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Press {
    /// Where, metres.
    pub x_m: f64,
    /// See there.
    pub y_m: f64,
    /// Height on a curved skin, metres.
    #[serde(default)]
    pub z_m: Option<f64>,
    /// How hard, newtons.
    #[serde(default)]
    pub force_n: Option<f64>,
    /// How deep, metres: kept for reports.
    #[serde(default)]
    pub depth_m: Option<f64>,
    /// First and last frame of the press, from 0; without them each press has one frame, in order.
    #[serde(default)]
    pub first_frame: Option<usize>,
    /// See there.
    #[serde(default)]
    pub last_frame: Option<usize>,
    /// First and last frame of the untouched skin before it; without them the reference of the recording.
    #[serde(default)]
    pub before_first: Option<usize>,
    /// See there.
    #[serde(default)]
    pub before_last: Option<usize>,
}

/// Presses in the order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct PressTable {
    /// The lines.
    pub presses: Vec<Press>,
    /// The file, for messages.
    pub place: String,
}

impl PressTable {
    /// Reads a CSV file with the columns of [`Press`].
    ///
    /// # Errors
    ///
    /// A file that cannot be read, an unknown column, a value that is no number, with its line.
    pub fn read(path: &Path) -> Result<Self, SkinError> {
        let place = path.display().to_string();
        let refused = |e: csv::Error| {
            SkinError::input(format!(
                "{place}: {e}; columns are x_m, y_m and where wanted z_m, force_n, depth_m, first_frame, \
                 last_frame, before_first, before_last"
            ))
        };
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(refused)?;
        let presses: Vec<Press> =
            reader.deserialize().collect::<Result<_, _>>().map_err(refused)?;
        let table = Self { presses, place };
        table.validate()?;
        Ok(table)
    }

    fn validate(&self) -> Result<(), SkinError> {
        if self.presses.is_empty() {
            return Err(SkinError::input(format!("{}: no press", self.place)));
        }
        for (k, press) in self.presses.iter().enumerate() {
            // the header is line 1
            let at = |what: &str, value: f64, must: &str| {
                let line = k + 2;
                let place = &self.place;
                SkinError::input(format!(
                    "{place}, line {line}: {what} is {value}: it must be {must}"
                ))
            };
            for (what, value) in
                [("x_m", press.x_m), ("y_m", press.y_m), ("z_m", press.z_m.unwrap_or(0.0))]
            {
                if !value.is_finite() {
                    return Err(at(what, value, "finite"));
                }
            }
            if let Some(force_n) = press.force_n.filter(|f| !(*f > 0.0 && f.is_finite())) {
                return Err(at("force_n", force_n, "finite and above zero"));
            }
            let ranges = [
                ("last_frame", press.first_frame, press.last_frame),
                ("before_last", press.before_first, press.before_last),
            ];
            for (what, first, last) in ranges {
                if let Some(last) = last
                    && first.is_none_or(|first| last < first)
                {
                    return Err(at(what, last as f64, "at or after its first frame"));
                }
            }
        }
        Ok(())
    }

    /// The first presses.
    pub fn first(&self, count: usize) -> Self {
        Self { presses: self.presses.iter().take(count).cloned().collect(), ..self.clone() }
    }
}
