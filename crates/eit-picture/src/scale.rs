//! Maps values to colours and draws the colour bar.

use plotters::style::text_anchor::HPos;

use crate::{
    ColorMap, PictureError, PictureSettings,
    canvas::{Canvas, INK, LINE, Rgb, crisp, crisp_frame},
    ticks::{Ticks, with_prefix},
};

/// Number of colour steps. Odd, so that zero has the neutral colour; few enough to leave room for
/// greys in the 256 colours of a GIF.
pub(crate) const LEVELS: usize = 201;
/// Values beyond this would overflow in differences, so they count as infinite.
pub(crate) const LARGEST: f64 = 1e300;
/// A largest magnitude below this counts as zero, because its ticks would underflow.
pub(crate) const SMALLEST: f64 = 1e-300;
/// Em of numbers, in points.
const TICK_EM: f64 = 11.0;
/// Width limit of the bar's heading, in points; a longer one is shortened.
const HEADING_WIDTH: f64 = 160.0;
/// Width of the bar and length of its ticks, in points.
const BAR: [f64; 2] = [14.0, 4.0];

/// The map from values to colours shared by all panels of a picture.
#[derive(Clone, Debug)]
pub(crate) struct Scale {
    low: f64,
    high: f64,
    colors: Vec<Rgb>,
    heading: String,
    ticks: Ticks,
    /// Notes on values that the colours do not distinguish.
    pub(crate) remarks: Vec<String>,
}

impl Scale {
    /// Creates a scale for these values; NaN counts as absent.
    pub(crate) fn new<'a>(
        values: impl Iterator<Item = &'a f64> + Clone,
        settings: &PictureSettings,
    ) -> Result<Self, PictureError> {
        let finite = values.clone().filter(|v| v.abs() <= LARGEST);
        let least = finite.clone().copied().fold(f64::INFINITY, f64::min);
        let most = finite.clone().copied().fold(f64::NEG_INFINITY, f64::max);
        let [low, high] = match settings.range {
            Some([low, high])
                if low < high && (SMALLEST..=LARGEST).contains(&low.abs().max(high.abs())) =>
            {
                [low, high]
            }
            Some([low, high]) => return Err(PictureError::Range { low, high }),
            None => [least, most],
        };
        let [low, high] = widened([low, high], settings.map);

        let mut remarks = Vec::new();
        let mut remark = |count: usize, text: &str| {
            if count > 0 {
                remarks.push(format!("{text}: {count}"));
            }
        };
        remark(finite.filter(|v| **v < low || **v > high).count(), "values beyond the bar");
        remark(values.filter(|v| v.abs() > LARGEST).count(), "infinite values");
        if least >= most {
            remarks.push(alike(least, most, &settings.unit));
        }

        let ticks = Ticks::new(low, high, 7);
        let unit = with_prefix(&settings.unit, ticks.exponent);
        let heading = match (settings.quantity.is_empty(), unit.is_empty()) {
            (_, true) => settings.quantity.clone(),
            (true, _) => unit,
            _ => format!("{} ({unit})", settings.quantity),
        };
        let colors = (0..LEVELS)
            .map(|level| settings.map.color(level as f64 / (LEVELS - 1) as f64))
            .collect();
        Ok(Self { low, high, colors, heading, ticks, remarks })
    }

    /// Replaces infinite values by the nearest end of the bar, for interpolation.
    pub(crate) fn bounded(&self, value: f64) -> f64 {
        if value.abs() > LARGEST { value.clamp(self.low, self.high) } else { value }
    }

    /// Colour of a value that is not NaN; values beyond the ends take the colour of the end.
    pub(crate) fn color(&self, value: f64) -> Rgb {
        let level = self.position(value) * (LEVELS - 1) as f64;
        self.colors[(level.round() as usize).min(LEVELS - 1)]
    }

    /// All colours, from the lower end up.
    pub(crate) fn colors(&self) -> &[Rgb] {
        &self.colors
    }

    /// Position of a value on the bar, 0 to 1.
    fn position(&self, value: f64) -> f64 {
        ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }

    /// Width that [`Scale::draw_bar`] needs to the right of its left border, in points.
    pub(crate) fn bar_width(&self, width_of: impl Fn(&str, f64) -> f64) -> f64 {
        let labels = self.ticks.labels.iter().map(|label| width_of(label, TICK_EM));
        let labels = BAR[0] + BAR[1] + 4.0 + labels.fold(0.0, f64::max);
        labels.max(width_of(&self.heading, TICK_EM).min(HEADING_WIDTH))
    }

    /// Draws the bar with its heading above and its ticks on the right; the middle of the heading
    /// is 18 points above `top`.
    pub(crate) fn draw_bar(&self, canvas: &mut Canvas, [left, top]: [f64; 2], height: f64) {
        let heading = canvas.font().shortened(&self.heading, TICK_EM, HEADING_WIDTH);
        canvas.text(&heading, TICK_EM, [left, top - 18.0], HPos::Left, INK);
        let rows = (height * canvas.zoom() as f64) as usize;
        let row_height = height / rows.max(1) as f64;
        for row in 0..rows {
            let value = self.high - (row as f64 + 0.5) / rows as f64 * (self.high - self.low);
            let corner = [left, top + row as f64 * row_height];
            canvas.fill_rect(corner, [BAR[0], row_height], self.color(value));
        }
        canvas.stroke(&crisp_frame([left, top], [BAR[0], height]), 1.0, LINE, 1.0);
        let (right, bottom) = (left + BAR[0], top + height);
        for (value, label) in self.ticks.values.iter().zip(&self.ticks.labels) {
            let y = bottom - self.position(*value) * height;
            let end = right + BAR[1];
            canvas.stroke(&[[right, crisp(y)], [end, crisp(y)]], 1.0, LINE, 1.0);
            canvas.text(label, TICK_EM, [right + BAR[1] + 4.0, y], HPos::Left, INK);
        }
    }
}

/// Describes what a bar cannot show: that there is no value, or only one.
fn alike(least: f64, most: f64, unit: &str) -> String {
    if least > most {
        return "no finite value".to_owned();
    }
    let value = if least == 0.0 { "0".to_owned() } else { format!("{least:e}") };
    format!("all values are {value}\u{a0}{unit}").trim_end().to_owned()
}

/// Returns a range of positive width that can be divided into ticks, symmetric for a diverging map.
fn widened([low, high]: [f64; 2], map: ColorMap) -> [f64; 2] {
    let largest = low.abs().max(high.abs());
    if low > high || largest < SMALLEST {
        // no values, or all zero: any bar is suitable
        return if map == ColorMap::CoolWarm { [-1.0, 1.0] } else { [0.0, 1.0] };
    }
    if map == ColorMap::CoolWarm {
        return [-largest, largest];
    }
    // a range narrower than 1e-6 of its magnitude cannot be labelled with few digits
    let missing = (1e-6 * largest - (high - low)).max(0.0);
    [low - missing / 2.0, high + missing / 2.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scale(values: &[f64], map: ColorMap, range: Option<[f64; 2]>) -> Scale {
        Scale::new(values.iter(), &PictureSettings { map, range, ..Default::default() }).unwrap()
    }

    #[test]
    fn the_heading_says_the_unit_of_the_ticks() {
        assert_eq!(scale(&[-2e-6, 1e-6], ColorMap::CoolWarm, None).heading, "Δσ (µS)");
        assert_eq!(scale(&[3e-17], ColorMap::CoolWarm, None).heading, "Δσ (10⁻¹⁸ S)");
    }

    #[test]
    fn a_diverging_scale_is_neutral_at_zero_and_symmetric() {
        let scale = scale(&[-1.0, 4.0, f64::NAN], ColorMap::CoolWarm, None);
        assert_eq!([scale.low, scale.high], [-4.0, 4.0]);
        assert_eq!(scale.color(0.0), ColorMap::CoolWarm.color(0.5));
        assert_eq!(scale.color(-4.0), ColorMap::CoolWarm.color(0.0));
        assert_eq!(scale.color(f64::INFINITY), scale.color(4.0));
    }

    #[test]
    fn odd_values_still_make_a_bar() {
        let cases: [&[f64]; 7] = [
            &[],
            &[f64::NAN],
            &[0.0, 0.0],
            &[5e-324, -5e-324],
            &[1e-300, 1e300],
            &[f64::MAX, f64::MIN, f64::INFINITY],
            &[7.0, 7.0 + 1e-12],
        ];
        for values in cases {
            for map in [ColorMap::CoolWarm, ColorMap::Viridis] {
                let scale = scale(values, map, None);
                assert!(scale.low < scale.high, "{values:?} {map:?}");
                assert!((1..=7).contains(&scale.ticks.values.len()), "{values:?} {scale:?}");
                assert!(scale.ticks.labels.iter().all(|label| label.len() < 16), "{scale:?}");
            }
        }
    }

    #[test]
    fn a_given_range_is_kept_and_says_what_it_clips() {
        let scale = scale(&[1.0, 9.0], ColorMap::Viridis, Some([0.0, 5.0]));
        assert_eq!([scale.low, scale.high], [0.0, 5.0]);
        assert_eq!(scale.remarks, ["values beyond the bar: 1"]);
        for range in [[1.0, 1.0], [2.0, 1.0], [f64::NAN, 1.0], [0.0, f64::INFINITY]] {
            let settings = PictureSettings { range: Some(range), ..Default::default() };
            let error = Scale::new([1.0].iter(), &settings).unwrap_err();
            assert!(matches!(error, PictureError::Range { .. }));
        }
    }
}
