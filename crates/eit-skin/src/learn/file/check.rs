//! Validates the content of a file of `eit learn`: the program writes it so, but a checksum does not stop
//! anyone from writing something else.

use super::{Content, ForceRecord, MapRecord};
use crate::error::SkinError;
use eit_inverse::learn::ForceCurve;

/// Name of a number, its value, and its allowed range.
type Check = (&'static str, f64, Must);

/// Allowed range of a number.
#[derive(Clone, Copy)]
enum Must {
    BeFinite,
    BePositive,
    NotBeNegative,
    /// Above zero and at most one.
    BePart,
}

impl Must {
    fn holds(self, value: f64) -> bool {
        value.is_finite()
            && match self {
                Self::BeFinite => true,
                Self::BePositive => value > 0.0,
                Self::NotBeNegative => value >= 0.0,
                Self::BePart => value > 0.0 && value <= 1.0,
            }
    }

    fn words(self) -> &'static str {
        match self {
            Self::BeFinite => "finite",
            Self::BePositive => "finite and above zero",
            Self::NotBeNegative => "finite and not below zero",
            Self::BePart => "above zero and at most 1",
        }
    }
}

impl Content {
    /// Rejects lists of inconsistent length, and numbers that cannot be used in computations.
    pub(super) fn check(&self) -> Result<(), SkinError> {
        self.check_lengths()?;
        let wrong = self.numbers().find(|(_, value, must)| !must.holds(*value));
        match wrong {
            Some((what, value, must)) => Err(SkinError::input(format!(
                "content: {what} is {value}: it must be {}",
                must.words()
            ))),
            None if self.sign.abs() != 1.0 => {
                let sign = self.sign;
                Err(SkinError::input(format!("content: sign is {sign}: it must be 1 or -1")))
            }
            None => Ok(()),
        }
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
        let force = self.force.iter().flat_map(|force| {
            [
                ("force.coefficients", force.coefficients.len(), terms),
                ("force.covariance", force.covariance.len(), terms * terms),
            ]
        });
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
        use Must::{BeFinite, BePositive, NotBeNegative};
        let MapRecord {
            length_m, noise, gain_pull, independent_channels, covariance_factor, ..
        } = self.map;
        let [shift_x_m, shift_y_m] = self.pose.shift_m;
        let single = [
            ("bell_m", self.bell_m, BePositive),
            ("sign", self.sign, BeFinite),
            ("pose.turn_rad", self.pose.turn_rad, BeFinite),
            ("pose.scale", self.pose.scale, BePositive),
            ("pose.shift_m", shift_x_m, BeFinite),
            ("pose.shift_m", shift_y_m, BeFinite),
            ("map.length_m", length_m, BePositive),
            ("map.noise", noise, BePositive),
            ("map.gain_pull", gain_pull.unwrap_or(1.0), BePositive),
            ("map.independent_channels", independent_channels, BePositive),
            ("map.covariance_factor", covariance_factor, NotBeNegative),
            ("map.rest_limit", self.map.rest_limit, Must::BePart),
            ("regression.width2", self.regression.width2, BePositive),
            ("regression.ridge", self.regression.ridge, BePositive),
        ];
        let errors = self.errors.model.into_iter().chain([self.errors.map, self.errors.regression]);
        let errors = errors.flat_map(|way| [way.median_m, way.mean_m]);
        let places = self.places_m.iter().flatten();
        single
            .into_iter()
            .chain(self.ratios.iter().map(|&ratio| ("ratios", ratio, BeFinite)))
            .chain(places.map(|&x| ("places_m", x, BeFinite)))
            .chain(self.frames.iter().flatten().map(|&value| ("frames", value, BeFinite)))
            .chain(self.forces_n.iter().flatten().map(|&force| ("forces_n", force, BePositive)))
            .chain(errors.map(|error| ("errors", error, NotBeNegative)))
            .chain(self.force.iter().flat_map(ForceRecord::numbers))
    }
}

impl ForceRecord {
    fn numbers(&self) -> impl Iterator<Item = Check> {
        use Must::{BeFinite, BePositive, NotBeNegative};
        let [low_ln, high_ln] = self.range_ln;
        let [least_n, most_n] = self.forces_n;
        let single = [
            ("force.radius_m", self.radius_m, BePositive),
            ("force.middle_ln", self.middle_ln, BeFinite),
            ("force.range_ln", low_ln, BeFinite),
            // the limits must be in order: values are clamped to the range
            ("the width of force.range_ln", high_ln - low_ln, NotBeNegative),
            ("force.error_ln", self.error_ln, NotBeNegative),
            ("force.forces_n", least_n, BePositive),
            ("the width of force.forces_n", most_n - least_n, NotBeNegative),
        ];
        let lists = [
            ("force.coefficients", &self.coefficients[..]),
            ("force.covariance", &self.covariance),
            ("force.middle_m", &self.middle_m),
        ];
        let lists = lists
            .into_iter()
            .flat_map(|(what, list)| list.iter().map(move |&v| (what, v, BeFinite)));
        single.into_iter().chain(lists)
    }
}
