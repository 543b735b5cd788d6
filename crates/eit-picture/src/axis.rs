//! One axis of a plot: its range, ticks and labels.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

use crate::plot::AREA;
use crate::ticks::{Ticks, power_of_ten, round_number};

/// Maximum number of ticks along an axis, so that labels stay apart.
const MOST_TICKS: usize = 8;
/// Multiples labelled within a decade: the first set whose labels fit is used.
const WITHIN: [&[i32]; 3] = [&[1, 2, 3, 4, 5, 6, 7, 8, 9], &[1, 2, 5], &[1, 3]];

/// A range and its ticks. Replaces the axes of plotters, whose logarithmic axis has no ticks within
/// a decade and whose linear axis treats ranges below 2e-16 as empty.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    log: bool,
    /// Ends of the range, as base-10 logarithms if the axis is logarithmic.
    low: f64,
    high: f64,
    /// Quantity and unit.
    pub(crate) name: String,
    ticks: Vec<f64>,
    /// Labels at the ticks.
    pub(crate) labels: Vec<String>,
    /// Positions of fainter lines: 2, 3, ... 9 times the powers of ten.
    minor: Vec<f64>,
}

impl Axis {
    /// Creates an axis that covers all values, which must be finite, and positive if `log`.
    pub(crate) fn new(values: impl Iterator<Item = f64> + Clone, log: bool, name: &str) -> Self {
        let transformed = values.map(|v| if log { v.log10() } else { v });
        let least = transformed.clone().fold(f64::INFINITY, f64::min);
        let most = transformed.fold(f64::NEG_INFINITY, f64::max);
        // a single value, or values that agree to six digits, still need an axis with ticks
        let least_span = if log { 0.02 } else { (1e-6 * least.abs().max(most.abs())).max(1e-300) };
        let missing = (least_span - (most - least)).max(0.0) / 2.0;
        // space between the extreme points and the axes, as a fraction of the range
        let padding = 0.04 * (most - least + 2.0 * missing);
        let mut axis = Self {
            log,
            low: least - missing - padding,
            high: most + missing + padding,
            name: name.to_owned(),
            ticks: Vec::new(),
            labels: Vec::new(),
            minor: Vec::new(),
        };
        match log {
            // shorter axes have labels within the decades: all of 1 to 9, or 1, 2 and 5, or one
            true if axis.high - axis.low >= 2.5 => axis.mark_decades(),
            // at least two numbers, so that the step is apparent
            true if axis.within(WITHIN[0]).len() > 1 => axis.mark_within_decades(),
            _ => axis.mark_round_values(),
        }
        axis
    }

    /// Returns the given multiples of powers of ten that lie on the axis, in ascending order.
    fn within(&self, multiples: &'static [i32]) -> Vec<(i32, i32)> {
        let decades = self.low.floor() as i32..=self.high.floor() as i32;
        let all = decades.flat_map(|decade| multiples.iter().map(move |k| (*k, decade)));
        let ends = self.low..=self.high;
        all.filter(|(k, decade)| ends.contains(&(f64::from(*k).log10() + f64::from(*decade))))
            .collect()
    }

    /// Whether labels at these positions are at least a character, 7 points wide, apart on an axis as
    /// long as the horizontal one. The vertical axis is shorter, but its labels are stacked.
    fn stand_apart(&self, ticks: &[(i32, i32)]) -> bool {
        let letters = round_numbers(ticks).iter().map(|label| label.chars().count()).max();
        let wanted = 7.0 * (letters.unwrap_or(0) + 1) as f64;
        let at = |(k, decade): (i32, i32)| f64::from(k).log10() + f64::from(decade);
        let apart =
            |pair: &[(i32, i32)]| AREA[0] * (at(pair[1]) - at(pair[0])) / (self.high - self.low);
        ticks.windows(2).all(|pair| apart(pair) >= wanted)
    }

    /// Places ticks at round numbers within a few decades, and fainter lines at all other
    /// multiples.
    fn mark_within_decades(&mut self) {
        let fits = |ticks: &Vec<(i32, i32)>| {
            (2..=MOST_TICKS).contains(&ticks.len()) && self.stand_apart(ticks)
        };
        let ticks = WITHIN.into_iter().map(|multiples| self.within(multiples)).find(fits);
        let ticks = ticks.unwrap_or_else(|| self.within(WITHIN[2]));
        self.labels = round_numbers(&ticks);
        self.ticks = ticks.iter().map(|(k, decade)| f64::from(*k) * 10f64.powi(*decade)).collect();
        let rest = self.within(WITHIN[0]).into_iter();
        let rest = rest.map(|(k, decade)| f64::from(k) * 10f64.powi(decade));
        self.minor = rest.filter(|at| !self.ticks.contains(at)).collect();
    }

    /// Places at most eight ticks, at powers of ten.
    fn mark_decades(&mut self) {
        let every = (((self.high - self.low) / MOST_TICKS as f64).ceil() as i32).max(1);
        let decades = self.low.ceil() as i32..=self.high.floor() as i32;
        for decade in decades.filter(|decade| decade % every == 0) {
            self.ticks.push(10f64.powi(decade));
            self.labels.push(power_of_ten(decade));
        }
        // lines between the powers of ten would be too dense on a longer axis
        if self.high - self.low <= 6.0 {
            let between = |decade: i32| (2..10).map(move |k| f64::from(k) * 10f64.powi(decade));
            let lines = (self.low.floor() as i32..=self.high.floor() as i32).flat_map(between);
            self.minor = lines.filter(|at| (self.low..=self.high).contains(&at.log10())).collect();
        }
    }

    /// Places ticks at round values; beyond thousands and thousandths, the power of ten moves to
    /// the axis name.
    fn mark_round_values(&mut self) {
        let ends = self.range();
        let mut ticks = Ticks::new(ends.start, ends.end, MOST_TICKS);
        if ticks.exponent.abs() <= 3 {
            ticks = ticks.labelled(0);
        } else {
            self.name += &format!("  ×{}", power_of_ten(ticks.exponent));
        }
        self.ticks = ticks.values;
        self.labels = ticks.labels;
    }
}

/// Formats digits times powers of ten, all in the same style: plain up to thousands and
/// thousandths.
fn round_numbers(ticks: &[(i32, i32)]) -> Vec<String> {
    let is_plain = ticks.iter().all(|(_, decade)| decade.abs() <= 3);
    ticks.iter().map(|(k, decade)| round_number(*k, *decade, is_plain)).collect()
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let at = if self.log { value.log10() } else { *value };
        let share = (at - self.low) / (self.high - self.low);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { self.minor.clone() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        match self.log {
            true => 10f64.powf(self.low)..10f64.powf(self.high),
            false => self.low..self.high,
        }
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, tick: &f64) -> String {
        let mut labels = self.ticks.iter().zip(&self.labels);
        labels.find(|(at, _)| *at == tick).map(|(_, label)| label.clone()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_ticks_for_any_values() {
        let pairs = [[1.0, 1.0], [0.0, 0.0], [-3.0, 9e4], [1e300, -1e300], [5e-7, 5.000001e-7]];
        for pair in pairs {
            let axis = Axis::new(pair.into_iter(), false, "x");
            assert!((2..=12).contains(&axis.ticks.len()), "{pair:?}: {:?}", axis.ticks);
            let places: Vec<i32> = axis.ticks.iter().map(|t| axis.map(t, (0, 1000))).collect();
            assert!(places.iter().all(|place| (0..=1000).contains(place)), "{axis:?}");
            assert_eq!(axis.ticks.len(), axis.labels.len());
            let mut labels = axis.labels.clone();
            labels.dedup();
            assert_eq!(labels, axis.labels, "two ticks alike");
        }
        for pair in [[1.0, 1.0], [1e-300, 1e300], [2.0, 3.0], [1e-6, 1.5e3]] {
            let axis = Axis::new(pair.into_iter(), true, "x");
            assert!((2..=12).contains(&axis.ticks.len()), "{pair:?}: {:?}", axis.ticks);
        }
        let decades = Axis::new([1e-2, 1e1].into_iter(), true, "x");
        assert_eq!(decades.labels, ["10⁻²", "10⁻¹", "10⁰", "10¹"]);
        assert_eq!(decades.format_ext(&decades.ticks[1]), "10⁻¹");
        // eight within each decade, and 0.008 and 0.009 within the padding
        assert_eq!(decades.minor.len(), 3 * 8 + 2, "{decades:?}");
    }

    /// An axis of one or two decades has evenly chosen labels within them, and lines at all other
    /// multiples.
    #[test]
    fn few_decades_have_numbers_within_them() {
        let labels = |low: f64, high: f64| Axis::new([low, high].into_iter(), true, "x").labels;
        assert_eq!(labels(5.0, 400.0), ["5", "10", "20", "50", "100", "200"]);
        assert_eq!(labels(2.2e-3, 11.3e-3), ["0.005", "0.01"]);
        assert_eq!(labels(2.0, 8.0), ["2", "3", "4", "5", "6", "7", "8"]);
        assert_eq!(labels(2e-6, 3e-5), ["2×10⁻⁶", "5×10⁻⁶", "10⁻⁵", "2×10⁻⁵"]);
        let axis = Axis::new([5.0, 400.0].into_iter(), true, "x");
        assert_eq!(
            axis.minor,
            [6.0, 7.0, 8.0, 9.0, 30.0, 40.0, 60.0, 70.0, 80.0, 90.0, 300.0, 400.0]
        );
    }
}
