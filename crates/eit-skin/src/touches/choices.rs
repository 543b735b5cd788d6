//! What a finder of touches chose, and why: for people and programs.

use serde_json::{Value, json};

/// What a [`TouchFinder`](super::TouchFinder) chose.
#[derive(Debug, Clone, PartialEq)]
pub struct Choices {
    /// Where the noise came from.
    pub noise: String,
    /// The sheet that explains the reference frame; `None` where an even one does as well.
    pub sheet: Option<FoundSheet>,
    /// Rows of a frame: a measurement and its reciprocal are one.
    pub rows: usize,
    /// Places at which touches are sought.
    pub places: usize,
    /// Further places that these measurements hardly see.
    pub blind: usize,
    /// Radius of a touch, metres.
    pub radius_m: f64,
    /// Least strength of a touch, S m^2.
    pub least_s_m2: f64,
}

/// An uneven sheet, as found in its reference frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundSheet {
    /// Standard deviation of the logarithm of its conductivity.
    pub amplitude: f64,
    /// Root mean square of what an even sheet leaves of the reference, part of its own.
    pub left_even: f64,
    /// The same of this one.
    pub left: f64,
}

impl Choices {
    /// A line each, for people.
    pub fn lines(&self) -> Vec<String> {
        let sheet = match self.sheet {
            None => "sheet taken to be even, which explains the reference as well as an uneven one"
                .to_owned(),
            Some(FoundSheet { amplitude, left_even, left }) => format!(
                "sheet taken to be uneven by {:.0} %, which explains the reference to {:.2} %, an even one \
                 to {:.2} %",
                100.0 * amplitude,
                100.0 * left,
                100.0 * left_even
            ),
        };
        let blind = match self.blind {
            0 => String::new(),
            blind => format!(", {blind} more are blind"),
        };
        vec![
            format!("touches: {sheet}"),
            format!(
                "touches: noise {}; sought at {} places{blind}, as bells of {:.0} mm from {:.1e} S m2 on",
                self.noise,
                self.places,
                1e3 * self.radius_m,
                self.least_s_m2
            ),
        ]
    }

    /// For programs.
    pub fn json(&self) -> Value {
        json!({
            "noise": self.noise,
            "sheet": self.sheet.map(|sheet| json!({
                "amplitude": sheet.amplitude,
                "left_even": sheet.left_even,
                "left": sheet.left,
            })),
            "rows": self.rows,
            "places": self.places,
            "blind_places": self.blind,
            "radius_m": self.radius_m,
            "least_s_m2": self.least_s_m2,
        })
    }
}
