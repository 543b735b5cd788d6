//! Round numbers along an axis and their labels.

use plotters::coord::ranged1d::Ranged as _;
use plotters::coord::types::RangedCoordf64;

/// Round numbers along an axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ticks {
    /// Positions of the ticks.
    pub(crate) values: Vec<f64>,
    /// Labels: the values divided by ten to the exponent.
    pub(crate) labels: Vec<String>,
    /// Power of ten, a multiple of three, that the labels omit.
    pub(crate) exponent: i32,
    /// Decimal places that distinguish neighbouring labels once the exponent is omitted.
    decimals: i32,
}

impl Ticks {
    /// Returns at most `most` ticks at multiples of 1, 2 or 5 times a power of ten between the
    /// ends, which must be finite and distinct.
    pub(crate) fn new(low: f64, high: f64, most: usize) -> Self {
        // the end of larger magnitude decides the prefix: one to three digits before the point
        let largest = low.abs().max(high.abs()) * (1.0 + 1e-9);
        let exponent = 3 * (largest.log10() / 3.0).floor() as i32;
        // plotters treats ranges below 2e-16 as empty, so the ticks are computed for the scaled
        // numbers of the labels
        let unit = 10f64.powi(exponent);
        let written = RangedCoordf64::from(low / unit..high / unit).key_points(most);
        let step = written.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let decimals = if step.is_finite() { -(step.log10() + 1e-9).floor() as i32 } else { 0 };
        let values = written.iter().map(|value| value * unit).collect();
        Self { values, labels: Vec::new(), exponent, decimals }.labelled(exponent)
    }

    /// Returns the same ticks, labelled with another exponent.
    pub(crate) fn labelled(mut self, exponent: i32) -> Self {
        self.decimals += exponent - self.exponent;
        let decimals = self.decimals.clamp(0, 12) as usize;
        let label = |value: &f64| signed(value / 10f64.powi(exponent), decimals);
        self.labels = self.values.iter().map(label).collect();
        self.exponent = exponent;
        self
    }
}

/// Formats a decimal number with a true minus sign, but none on zero.
fn signed(value: f64, decimals: usize) -> String {
    let digits = format!("{:.decimals$}", value.abs());
    let zero = digits.chars().all(|c| c == '0' || c == '.');
    if value < 0.0 && !zero { format!("−{digits}") } else { digits }
}

/// Formats ten to an integer power: 10⁻⁶.
pub(crate) fn power_of_ten(exponent: i32) -> String {
    const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let mut text = String::from("10");
    for letter in exponent.to_string().chars() {
        text.push(letter.to_digit(10).map_or('⁻', |digit| RAISED[digit as usize]));
    }
    text
}

/// Formats a digit times a power of ten: 0.05, 5 and 500 if plain, otherwise 5×10⁻⁶.
pub(crate) fn round_number(digit: i32, exponent: i32, is_plain: bool) -> String {
    match exponent {
        _ if !is_plain && digit == 1 => power_of_ten(exponent),
        _ if !is_plain => format!("{digit}×{}", power_of_ten(exponent)),
        0.. => format!("{digit}{}", "0".repeat(exponent as usize)),
        _ => format!("0.{}{digit}", "0".repeat(exponent.unsigned_abs() as usize - 1)),
    }
}

/// Returns the unit for ten to `exponent` times `unit`: µS, or 10⁻¹⁵ S beyond the prefixes.
pub(crate) fn with_prefix(unit: &str, exponent: i32) -> String {
    let prefix = match exponent {
        -12 => "p",
        -9 => "n",
        -6 => "µ",
        -3 => "m",
        0 => "",
        3 => "k",
        6 => "M",
        9 => "G",
        _ => return format!("{} {unit}", power_of_ten(exponent)).trim_end().to_owned(),
    };
    match unit {
        "" if exponent != 0 => power_of_ten(exponent),
        _ => format!("{prefix}{unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let ticks = Ticks::new(-2.34e-6, 2.34e-6, 7);
        assert_eq!(ticks.labels, ["−2", "−1", "0", "1", "2"]);
        assert_eq!(ticks.exponent, -6);
        assert_eq!(Ticks::new(0.0, 1.0, 6).labels, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(Ticks::new(0.0, 999.0, 4).labels, ["0", "500"]);
        assert_eq!(Ticks::new(-1e3, 1e3, 5).labels, ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(Ticks::new(0.0, 45e-15, 6).labels, ["0", "10", "20", "30", "40"]);
        assert_eq!(Ticks::new(0.2, 1.4, 4).labelled(0).labels, ["0.5", "1.0"]);
        assert_eq!(
            Ticks::new(0.0, 4e3, 5).labelled(0).labels,
            ["0", "1000", "2000", "3000", "4000"]
        );
    }

    #[test]
    fn units_take_a_prefix_or_a_power() {
        assert_eq!(with_prefix("S", -6), "µS");
        assert_eq!(with_prefix("S", -18), "10⁻¹⁸ S");
        assert_eq!(with_prefix("", 3), "10³");
        assert_eq!(with_prefix("", 0), "");
    }
}
