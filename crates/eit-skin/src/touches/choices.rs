//! What a touch finder chose, and why, for people and programs.

use crate::scene::TouchModel;
use crate::twins;

/// Choices of a [`TouchFinder`](super::TouchFinder).
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Choices {
    /// Source of the noise.
    pub noise: String,
    /// Number of presses that the skin was learnt from; `None` if touches are found by the model.
    pub presses: Option<usize>,
    /// How touches are found where the skin was not learnt from presses.
    #[serde(default)]
    pub model: TouchModel,
    /// The sheet that explains the reference frame; `None` if an even one does as well.
    pub sheet: Option<FoundSheet>,
    /// Root mean square of the reference that an even sheet leaves unexplained, relative to its own.
    #[serde(skip)]
    pub left_even: f64,
    /// Number of rows of a frame: a measurement and its reciprocal count as one.
    pub rows: usize,
    /// Number of places at which touches are sought.
    pub places: usize,
    /// Number of places excluded because these measurements hardly respond to them.
    #[serde(rename = "blind_places")]
    pub blind: usize,
    /// Share of the skin whose touches these measurements cannot tell from touches elsewhere.
    #[serde(default)]
    pub twins: f64,
    /// Radius of a touch, metres.
    pub radius_m: f64,
    /// Minimum strength of a touch, S m^2.
    pub least_s_m2: f64,
}

/// An uneven sheet fitted to its reference frame.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct FoundSheet {
    /// Standard deviation of the logarithm of its conductivity.
    pub amplitude: f64,
    /// Root mean square of the reference that an even sheet leaves unexplained, relative to its own.
    pub left_even: f64,
    /// The same for this sheet.
    pub left: f64,
}

/// Part of the reference that the sheet leaves unexplained above which touches are lost: a tank and uneven sheets with 6 % show
/// theirs, real skins with 19 to 33 % none (docs/validation/learning.md).
const UNEXPLAINED: f64 = 0.1;

impl Choices {
    /// Warns that touches will be lost or misplaced: the model explains the reference badly, or cannot tell places apart.
    pub fn warnings(&self) -> Vec<String> {
        let left = self.sheet.map_or(self.left_even, |sheet| sheet.left);
        let unexplained = (self.presses.is_none() && left > UNEXPLAINED).then(|| format!(
            "the model leaves {:.0} % of the untouched skin's voltages unexplained: touches will be lost or misplaced; \
             check the scene (shape, electrodes, protocol), or learn the skin from presses (`eit learn`)",
            100.0 * left
        ));
        let twins = twins::finding(self.twins).map(|finding| finding.to_string());
        unexplained.into_iter().chain(twins).collect()
    }

    /// Describes each choice on a line, for people.
    pub fn lines(&self) -> Vec<String> {
        let sheet = match (self.presses, self.sheet) {
            (Some(presses), _) => format!("skin learnt from {presses} presses"),
            (None, None) => {
                "sheet assumed to be even, which explains the reference as well as an uneven one"
                    .to_owned()
            }
            (None, Some(FoundSheet { amplitude, left_even, left })) => format!(
                "sheet assumed to be uneven by {:.0} %, which explains the reference to {:.2} %, an even one \
                 to {:.2} %",
                100.0 * amplitude,
                100.0 * left,
                100.0 * left_even
            ),
        };
        let blind = match self.blind {
            0 => String::new(),
            blind => format!(", {blind} more are not seen"),
        };
        let warnings = self.warnings().into_iter().map(|warning| format!("warning: {warning}"));
        let lines = [
            format!("touches: {sheet}"),
            format!(
                "touches: noise {}; sought at {} places{blind}, as bells of {:.0} mm from {:.1e} S m2 on",
                self.noise,
                self.places,
                1e3 * self.radius_m,
                self.least_s_m2
            ),
        ];
        lines.into_iter().chain(warnings).collect()
    }
}
