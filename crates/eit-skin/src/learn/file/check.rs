//! Validates the content of a file of `eit learn`: the program writes it so, but a checksum does not stop
//! anyone from writing something else.

use super::{Content, LearnedForce, MapRecord};
use crate::error::SkinError;
use crate::scene::{Must, check_numbers};
use eit_inverse::learn::{ForceCurve, ResponseMapSettings};

/// Name of a number, its value, and its allowed range.
type Check = (&'static str, Option<f64>, Must);

impl Content {
    /// Rejects lists of inconsistent length, and numbers that cannot be used in computations.
    pub(super) fn check(&self) -> Result<(), SkinError> {
        self.check_lengths()?;
        check_numbers(self.numbers()).map_err(|e| e.within("content"))?;
        if self.sign.abs() != 1.0 {
            let sign = self.sign;
            return Err(SkinError::input(format!("content: sign is {sign}: it must be 1 or -1")));
        }
        Ok(())
    }

    fn check_lengths(&self) -> Result<(), SkinError> {
        let (presses, channels, terms) =
            (self.places_m.len(), self.channels.len(), ForceCurve::TERMS);
        let lengths = [
            ("forces_n", self.forces_n.len(), presses),
            ("frames", self.frames.len(), presses),
            ("ratios", self.ratios.len(), channels),
        ];
        let sessions = match self.sessions.len() {
            0 => None,
            found => Some(("sessions", found, presses)),
        };
        let frames = self.frames.iter().map(|frame| ("a frame", frame.len(), channels));
        let covariance = self.force.as_ref().map(|force| &force.curve.covariance);
        let force = covariance.map(|list| ("force.covariance", list.len(), terms * terms));
        for (what, found, wanted) in lengths.into_iter().chain(sessions).chain(frames).chain(force)
        {
            if found != wanted {
                return Err(SkinError::input(format!(
                    "content: {what} has {found} values, but {wanted} are needed"
                )));
            }
        }
        let ascends = self.channels.windows(2).all(|pair| pair[0] < pair[1]);
        if !ascends || self.channels.last().is_none_or(|last| *last >= self.measurements) {
            return Err(SkinError::input(format!(
                "content: channels must be at least one, ascend, and be below {}",
                self.measurements
            )));
        }
        Ok(())
    }

    /// Every number with its allowed range.
    fn numbers(&self) -> impl Iterator<Item = Check> {
        use Must::{Finite, NotNegative, Positive};
        let MapRecord { settings, covariance_factor, rest_limit } = self.map;
        let ResponseMapSettings { length_m, noise, gain_pull, independent_channels } = settings;
        let [shift_x_m, shift_y_m] = self.pose.shift_m;
        let single = [
            ("bell_m", Some(self.bell_m), Positive),
            ("sign", Some(self.sign), Finite),
            ("pose.turn_rad", Some(self.pose.turn_rad), Finite),
            ("pose.scale", Some(self.pose.scale), Positive),
            ("pose.shift_m", Some(shift_x_m), Finite),
            ("pose.shift_m", Some(shift_y_m), Finite),
            ("map.length_m", Some(length_m), Positive),
            ("map.noise", Some(noise), Positive),
            ("map.gain_pull", gain_pull, Positive),
            ("map.independent_channels", Some(independent_channels), Positive),
            ("map.covariance_factor", Some(covariance_factor), NotNegative),
            ("map.rest_limit", Some(rest_limit), Must::Part),
            ("regression.width2", Some(self.regression.width2), Positive),
            ("regression.ridge", Some(self.regression.ridge), Positive),
        ];
        let errors = self.errors.model.into_iter().chain([self.errors.map, self.errors.regression]);
        let errors = errors.flat_map(|way| [way.median_m, way.mean_m]);
        let places = self.places_m.iter().flatten();
        single
            .into_iter()
            .chain(self.ratios.iter().map(|&ratio| ("ratios", Some(ratio), Finite)))
            .chain(places.map(|&x| ("places_m", Some(x), Finite)))
            .chain(self.frames.iter().flatten().map(|&value| ("frames", Some(value), Finite)))
            .chain(self.forces_n.iter().flatten().map(|&force| ("forces_n", Some(force), Positive)))
            .chain(errors.map(|error| ("errors", Some(error), NotNegative)))
            .chain(self.force.iter().flat_map(force_numbers))
    }
}

fn force_numbers(force: &LearnedForce) -> impl Iterator<Item = Check> {
    use Must::{Finite, NotNegative, Positive};
    let curve = &force.curve;
    let [low_ln, high_ln] = curve.range_ln;
    let [least_n, most_n] = curve.forces_n;
    let single = [
        ("force.radius_m", Some(curve.radius_m), Positive),
        ("force.middle_ln", Some(curve.middle_ln), Finite),
        ("force.range_ln", Some(low_ln), Finite),
        // the limits must be in order: values are clamped to the range
        ("the width of force.range_ln", Some(high_ln - low_ln), NotNegative),
        ("force.error_ln", Some(curve.error_ln), NotNegative),
        ("force.forces_n", Some(least_n), Positive),
        ("the width of force.forces_n", Some(most_n - least_n), NotNegative),
    ];
    let lists = [
        ("force.coefficients", &curve.coefficients[..]),
        ("force.covariance", &curve.covariance),
        ("force.middle_m", &curve.middle_m),
    ];
    let lists = lists
        .into_iter()
        .flat_map(|(what, list)| list.iter().map(move |&v| (what, Some(v), Finite)));
    single.into_iter().chain(lists)
}
