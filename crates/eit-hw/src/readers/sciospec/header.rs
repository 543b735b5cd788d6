//! The header of an `.eit` file.
//!
//! With 9 lines: count, name, date, first frequency, last frequency, logarithmic, frequencies,
//! amplitude in ampere, frames per second. With 11 or more, a version follows the count, and
//! further lines follow at the end, of which only `MeasurementChannels: 1,2,...` is used.

use std::path::Path;

use crate::error::{HwError, Place};
use crate::readers::wrong_field;

const MEND: &str = "the file is damaged or not a Sciospec text frame: export it again";

pub(super) struct Header {
    /// Number of header lines.
    pub(super) lines: usize,
    /// Milliseconds since 1970 by the clock of the recording computer.
    pub(super) time_ms: Option<i64>,
    pub(super) first_hz: f64,
    pub(super) last_hz: f64,
    pub(super) logarithmic: bool,
    pub(super) frequencies: usize,
    pub(super) current_a: f64,
    /// Channels that are electrodes, from 1; `None` if the header does not say.
    pub(super) channels: Option<Vec<u32>>,
}

impl Header {
    /// Parses the header from the first of `lines`.
    pub(super) fn parse(lines: &[(usize, &str)], path: &Path) -> Result<Self, HwError> {
        let text = |index: usize| lines.get(index).map_or("", |(_, line)| line.trim());
        let wrong = |index: usize, field, wanted| {
            wrong_field(Place::line(path, index + 1), field, text(index), wanted, MEND)
        };
        let count = text(0)
            .parse::<usize>()
            .ok()
            .filter(|count| (9..=lines.len()).contains(count))
            .ok_or_else(|| wrong(0, "number of header lines", "a number of at least 9"))?;
        let shift = usize::from(count >= 11);
        let number = |index: usize, field| {
            let value = text(index).parse::<f64>().ok();
            value
                .filter(|value| value.is_finite() && *value >= 0.0)
                .ok_or_else(|| wrong(index, field, "a number of at least 0"))
        };
        let mut channels = None;
        for (index, (_, line)) in lines.iter().enumerate().take(count).skip(9) {
            if let Some(list) = line.strip_prefix("MeasurementChannels:") {
                let list = channel_list(list);
                channels = Some(list.ok_or_else(|| {
                    wrong(
                        index,
                        "MeasurementChannels",
                        "a list of different numbers, each at least 1",
                    )
                })?);
            }
        }
        Ok(Self {
            lines: count,
            time_ms: milliseconds(text(2 + shift)),
            first_hz: number(3 + shift, "first frequency")?,
            last_hz: number(4 + shift, "last frequency")?,
            logarithmic: number(5 + shift, "logarithmic")? != 0.0,
            frequencies: text(6 + shift).parse().ok().filter(|&count| count > 0).ok_or_else(
                || wrong(6 + shift, "number of frequencies", "a number of at least 1"),
            )?,
            current_a: number(7 + shift, "amplitude")?,
            channels,
        })
    }

    /// Returns the frequency of a row: rows have equal steps or equal ratios.
    pub(super) fn frequency_hz(&self, row: usize) -> f64 {
        if self.frequencies < 2 {
            return self.first_hz;
        }
        let part = row as f64 / (self.frequencies - 1) as f64;
        if self.logarithmic && self.first_hz > 0.0 {
            self.first_hz * (self.last_hz / self.first_hz).powf(part)
        } else {
            self.first_hz + part * (self.last_hz - self.first_hz)
        }
    }
}

/// Parses a list such as `1,2,3` of different numbers, each at least 1.
fn channel_list(text: &str) -> Option<Vec<u32>> {
    let channels: Vec<u32> =
        text.split(',').map(|channel| channel.trim().parse().ok()).collect::<Option<_>>()?;
    let mut sorted = channels.clone();
    sorted.sort_unstable();
    sorted.dedup();
    (sorted.len() == channels.len() && !sorted.contains(&0)).then_some(channels)
}

/// Converts a time such as `2025.02.12. 13:19:58.685`, with or without milliseconds, to
/// milliseconds since 1970 by the same clock. Returns `None` for other notations, since an
/// unreadable time is no reason to reject a frame.
fn milliseconds(text: &str) -> Option<i64> {
    let (date, time) = text.split_once(' ')?;
    let mut date = date.trim_end_matches('.').split('.').map(|part| part.parse::<i64>().ok());
    let (year, month, day) = (date.next()??, date.next()??, date.next()??);
    let (time, fraction) = time.trim().split_once('.').unwrap_or((time.trim(), "0"));
    let mut time = time.split(':').map(|part| part.parse::<i64>().ok());
    let (hour, minute, second) = (time.next()??, time.next()??, time.next()??);
    // digits only, since `5e300` would also parse as a number
    if !fraction.bytes().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    let millisecond = (1000.0 * format!("0.{fraction}").parse::<f64>().ok()?).round() as i64;
    let valid = (0..10_000).contains(&year)
        && (1..=12).contains(&month)
        && (1..=31).contains(&day)
        && (0..24).contains(&hour)
        && (0..60).contains(&minute)
        && (0..61).contains(&second);
    valid.then(|| {
        let seconds = ((days(year, month, day) * 24 + hour) * 60 + minute) * 60 + second;
        seconds * 1000 + millisecond
    })
}

/// Returns the days since 1970-01-01 in the Gregorian calendar. Years start in March, so that a
/// leap day is the last of its year; 146097 days are 400 years.
fn days(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    // days before a month, counted from March: 0, 31, 61, 92, 122, 153, ...
    365 * year + leap_days + (153 * month + 2) / 5 + day - 1 - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_of_known_dates() {
        assert_eq!(days(1970, 1, 1), 0);
        assert_eq!(days(2000, 2, 29), 11_016);
        assert_eq!(days(2000, 3, 1), 11_017);
        assert_eq!(days(2025, 2, 12), 20_131);
    }

    #[test]
    fn dates_with_and_without_milliseconds() {
        let whole = milliseconds("2020.07.08. 14:20:28").expect("a date");
        assert_eq!(milliseconds("2020.07.08. 14:20:28.750"), Some(whole + 750));
        assert_eq!(milliseconds("2020.07.08. 14:20:28.75"), Some(whole + 750));
        assert_eq!(whole, (20_131 - 1680) * 86_400_000 + 51_628_000);
        for wrong in [
            "",
            "2020.07.08.",
            "2020.13.08. 14:20:28",
            "yesterday 1:2:3",
            "1.1.1. 99:0:0",
            "2020.07.08. 14:20:28.5e300",
            "2020.07.08. 14:20:28.5e-3",
        ] {
            assert_eq!(milliseconds(wrong), None, "{wrong}");
        }
    }

    proptest::proptest! {
        #![proptest_config(fixtures::cases(256))]

        // with overflow checks, no part of a date overflows
        #[test]
        fn any_date_is_a_time_or_none(
            date in "[0-9]{1,20}[.][0-9]{1,3}[.][0-9]{1,3}[.]?",
            time in "[0-9+-]{1,20}:[0-9]{1,3}:[0-9]{1,3}",
            fraction in "[0-9]{0,4}([eE][+-]?)?[0-9]{0,3}",
        ) {
            // years 0 to 9999
            let range = -62_200_000_000_000..253_500_000_000_000;
            for date in [&date, "2020.07.08."] {
                for time in [&time, "14:20:28"] {
                    let time_ms = milliseconds(&format!("{date} {time}.{fraction}"));
                    assert!(time_ms.is_none_or(|time| range.contains(&time)), "{time_ms:?}");
                }
            }
        }
    }

    #[test]
    fn frequencies_are_spaced_as_stated() {
        let mut header = Header {
            lines: 9,
            time_ms: None,
            first_hz: 1e3,
            last_hz: 1e5,
            logarithmic: true,
            frequencies: 3,
            current_a: 1e-3,
            channels: None,
        };
        // rounding of a power and a product
        assert!((header.frequency_hz(1) - 1e4).abs() < 1e-8);
        header.logarithmic = false;
        assert_eq!(header.frequency_hz(1), 50_500.0);
    }
}
