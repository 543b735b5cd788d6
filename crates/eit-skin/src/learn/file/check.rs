//! Validates the content of a file of `eit learn`: the program writes it so, but a checksum does not stop
//! anyone from writing something else.

use super::{Content, HeldOut};
use crate::error::SkinError;
use crate::scene::{Must, check_numbers};
use eit_inverse::learn::{ForceCurve, MapSettings};

/// Name of a number, its value, and its allowed range.
type Check = (&'static str, Option<f64>, Must);

impl Content {
    /// Rejects lists of inconsistent length, and numbers that cannot be used in computations.
    pub(super) fn check(&self) -> Result<(), SkinError> {
        self.check_lengths()?;
        check_numbers(self.numbers()).map_err(|e| e.within("content"))?;
        let sign = self.orientation.sign;
        if sign.abs() != 1.0 {
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
            ("untouched", self.untouched.len(), presses),
            ("levels", self.levels.len(), channels),
        ];
        let sessions = match self.sessions.len() {
            0 => None,
            found => Some(("sessions", found, presses)),
        };
        let frames = self.frames.iter().chain(&self.untouched);
        let frames = frames.map(|frame| ("a frame", frame.len(), channels));
        let covariance = self.force.as_ref().map(|force| &force.covariance);
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
        let MapSettings { length_m, noise, weak, gain_pull } = self.map;
        let single = [
            ("interval_s", Some(self.interval_s), Positive),
            ("bell_m", Some(self.bell_m), Positive),
            ("orientation.sign", Some(self.orientation.sign), Finite),
            ("orientation.turn_rad", Some(self.orientation.turn_rad), Finite),
            ("map.length_m", Some(length_m), Positive),
            ("map.noise", Some(noise), Positive),
            ("map.weak", Some(weak), Must::Within((0.0..=1.0, "from 0 to 1"))),
            ("map.gain_pull", gain_pull, Positive),
            ("stated.mild", Some(self.stated.mild), Positive),
            ("stated.floor_m2", Some(self.stated.floor_m2), NotNegative),
            ("stated.wide", Some(self.stated.wide), Positive),
            ("stated.beside", Some(self.stated.beside[0]), NotNegative),
            ("stated.beside", Some(self.stated.beside[1]), NotNegative),
            ("held_out.shown", Some(self.held_out.shown), NotNegative),
        ];
        let HeldOut { model, presses, middle, .. } = self.held_out;
        let errors = model.into_iter().chain([presses, middle]);
        let errors = errors.flat_map(|way| [way.median_m, way.mean_m]);
        let shift = self.shift_m.iter().chain(&self.orientation.middle_m);
        let places = self.places_m.iter().flatten();
        single
            .into_iter()
            .chain(shift.map(|&x| ("shift_m", Some(x), Finite)))
            .chain(self.levels.iter().map(|&level| ("levels", Some(level), Finite)))
            .chain(self.untouched.iter().flatten().map(|&v| ("untouched", Some(v), Finite)))
            .chain(places.map(|&x| ("places_m", Some(x), Finite)))
            .chain(self.frames.iter().flatten().map(|&value| ("frames", Some(value), Finite)))
            .chain(self.forces_n.iter().flatten().map(|&force| ("forces_n", Some(force), Positive)))
            .chain(errors.map(|error| ("errors", Some(error), NotNegative)))
            .chain(self.force.iter().flat_map(force_numbers))
    }
}

fn force_numbers(curve: &ForceCurve) -> impl Iterator<Item = Check> {
    use Must::{Finite, NotNegative, Positive};
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
