//! Merges presses of an earlier file with those of a table.

use super::{Frame, LearnedSkin, PressFrames};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use eit_inverse::InverseError;
use eit_inverse::learn::Presses;
use ndarray::{Array2, ArrayView1, Axis};

/// Frames that differ by less than this fraction of their norm are identical: a file may lose the last digit
/// of a number, and any instrument's noise is far larger.
const SAME_FRAME: f64 = 1e-12;

/// Presses of an earlier file, then those of the table, in the coordinates of the table.
pub(super) struct Joined {
    /// Measurements that count.
    pub channels: Vec<usize>,
    pub table: Presses,
    /// The untouched skin before each press, `[press, channel]`.
    pub untouched: Array2<f64>,
    pub forces_n: Vec<Option<f64>>,
    /// Number of presses from the earlier file.
    pub earlier: usize,
    /// Name of each press in messages.
    names: Vec<String>,
    place: String,
}

impl Joined {
    /// Rejects an earlier file that is incompatible with these presses, frames without a change, and
    /// duplicate frames.
    pub(crate) fn new(
        fitted: &FittedFrames,
        pressed: &PressFrames,
        frame: Frame,
        earlier: Option<&LearnedSkin>,
    ) -> Result<Self, SkinError> {
        let used = &fitted.frames.used;
        let channels: Vec<usize> = (0..used.len()).filter(|&i| used[i]).collect();
        let mut frames = pressed.differences(&channels);
        let mut untouched = pressed.references.select(Axis(1), &channels);
        let mut places_m = pressed.places_m.clone();
        let mut forces_n = pressed.forces_n.clone();
        let mut names: Vec<String> = (0..pressed.len()).map(|k| pressed.name(k)).collect();
        if let Some(k) = frames.rows().into_iter().position(|row| row.iter().all(|v| *v == 0.0)) {
            let message = "its frames equal the reference, as if nothing had touched the skin";
            return Err(SkinError::input(message).within(&names[k]));
        }
        let mut sessions = Vec::new();
        if let Some(earlier) = earlier {
            earlier.check(&fitted.skin)?;
            earlier.check_beside(&channels, frame)?;
            let join = |old: &Array2<f64>, new: &Array2<f64>| {
                ndarray::concatenate(Axis(0), &[old.view(), new.view()])
                    .map_err(|e| SkinError::Failure(format!("joining presses: {e}")))
            };
            frames = join(&earlier.presses.frames, &frames)?;
            untouched = join(&earlier.untouched, &untouched)?;
            let old = earlier.presses.places_m.iter();
            let old = old.map(|place| eit_core::vector::sub(*place, earlier.shift_m));
            places_m = old.chain(places_m).collect();
            forces_n = [earlier.forces_n.clone(), forces_n].concat();
            let old =
                (1..=earlier.forces_n.len()).map(|k| format!("press {k} of the earlier file"));
            names = old.chain(names).collect();
            sessions = earlier.sessions_before(pressed.len());
        }
        let earlier = earlier.map_or(0, |earlier| earlier.forces_n.len());
        let place = pressed.place.clone();
        let joined = Self {
            channels,
            table: Presses { frames, places_m, sessions },
            untouched,
            forces_n,
            earlier,
            names,
            place,
        };
        match same_frames(&joined.table.frames) {
            Some([one, other]) => Err(SkinError::input(format!(
                "it has the same frame as {}, and a press that is both learnt and tested appears to have \
                 no error: keep one of them",
                joined.names[one]
            ))
            .within(&joined.names[other])),
            None => Ok(joined),
        }
    }

    /// Frames and what is subtracted from each, `[measurement]`; those of the earlier file are added to the
    /// reference of these frames.
    pub(crate) fn pairs<'a>(
        &'a self,
        fitted: &'a FittedFrames,
        pressed: &'a PressFrames,
    ) -> impl Iterator<Item = [Vec<f64>; 2]> + 'a {
        let reference = &fitted.frames.reference;
        let rows = self.table.frames.rows().into_iter().take(self.earlier);
        let old = rows.map(|row| {
            let mut values = reference.clone();
            self.channels.iter().zip(row).for_each(|(&i, difference)| values[i] += difference);
            [values, reference.clone()]
        });
        old.chain(pressed.pairs())
    }

    /// Adds the name of the press to an error that contains its index.
    pub(crate) fn named(&self, error: InverseError) -> SkinError {
        let press = match error {
            InverseError::NonFiniteData { frame: press, .. }
            | InverseError::EmptyPress { press }
            | InverseError::NonFinitePlace { press, .. }
            | InverseError::OutsideSkin { touch: press, .. } => self.names.get(press),
            _ => Some(&self.place),
        };
        SkinError::from(error).within(press.unwrap_or(&self.place))
    }

    /// The same for an error that may be of another kind.
    pub(crate) fn located(&self, error: SkinError) -> SkinError {
        match error {
            SkinError::Inverse(error) => self.named(error),
            error => error,
        }
    }
}

impl LearnedSkin {
    /// Sessions of these presses, then of new ones, which are a session of their own.
    fn sessions_before(&self, new: usize) -> Vec<u32> {
        let mut sessions = self.presses.sessions.clone();
        sessions.resize(self.presses.places_m.len(), 0);
        if new > 0 {
            let last = sessions.iter().copied().max().unwrap_or(0);
            sessions.resize(sessions.len() + new, last.saturating_add(1));
        }
        sessions
    }

    /// Rejects presses whose frames or places have another meaning.
    fn check_beside(&self, channels: &[usize], frame: Frame) -> Result<(), SkinError> {
        if self.channels != channels {
            return Err(SkinError::input(format!(
                "the earlier file uses {} of {} measurements, these frames use {}, and not the same ones: \
                 exclude the same electrodes, or learn without that file",
                self.channels.len(),
                self.measurements,
                channels.len()
            )));
        }
        let message = match (self.frame, frame) {
            (Frame::Fitted, Frame::Scene) => {
                "the places of the earlier file were fitted to the scene, but those of the table are \
                 the scene's: fit the frame here, too"
            }
            (Frame::Scene, Frame::Fitted) => {
                "the places of the earlier file are the scene's, but those of the table are to be \
                 fitted: fit both, or neither"
            }
            _ => return Ok(()),
        };
        Err(SkinError::input(message))
    }
}

/// Finds two equal rows.
fn same_frames(frames: &Array2<f64>) -> Option<[usize; 2]> {
    let length = |row: ArrayView1<'_, f64>| row.dot(&row).sqrt();
    let mut sorted: Vec<(f64, usize)> =
        frames.rows().into_iter().enumerate().map(|(k, row)| (length(row), k)).collect();
    sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    for (at, &(least, one)) in sorted.iter().enumerate() {
        let limit = SAME_FRAME * least;
        // equal frames have equal lengths
        for &(_, other) in sorted[at + 1..].iter().take_while(|(l, _)| l - least <= 2.0 * limit) {
            let (a, b) = (frames.row(one), frames.row(other));
            let squared: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
            if squared.sqrt() <= limit {
                return Some([one.min(other), one.max(other)]);
            }
        }
    }
    None
}
