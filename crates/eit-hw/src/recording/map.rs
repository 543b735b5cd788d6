//! Maps recorded values to the measurements of a protocol.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::hint::CountHint;
use super::layout::Layout;
use crate::error::{HwError, Place};
use crate::frame::{Frame, Quadruple, Quality, check_lengths, unsigned};

/// Selects the measurements of a protocol, in its order, from the recorded or received values of a
/// frame.
///
/// Built once, it maps every frame without allocating.
///
/// ```
/// use eit_hw::{Frame, FrameMap, Layout, Quality};
/// // potentials of three electrodes, current from 0 to 1
/// let layout = Layout::Potentials { drives: vec![[0, 1]], electrodes: 3, driven: true };
/// let wanted = [[0, 1, 0, 2], [1, 0, 0, 2]];
/// let map = FrameMap::new(&layout, 3, Some(&wanted), 2, "tank")?;
/// let mut frame = Frame::new(0, Vec::new());
/// map.apply(&[5.0, 1.0, 3.0], None, &[Quality::GOOD; 3], &mut frame)?;
/// assert_eq!(frame.values, [2.0, -2.0]);
/// # Ok::<(), eit_hw::HwError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FrameMap {
    picks: Vec<Pick>,
    value_count: usize,
    /// Name of the recording or instrument, for messages.
    source: PathBuf,
}

/// One measurement: a recorded value or the difference of two, with a sign.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pick {
    plus: usize,
    minus: Option<usize>,
    sign: f64,
}

impl Pick {
    fn of(self, values: &[f64]) -> f64 {
        self.sign * (values[self.plus] - self.minus.map_or(0.0, |minus| values[minus]))
    }

    fn quality(self, quality: &[Quality]) -> Quality {
        quality[self.plus] | self.minus.map_or(Quality::GOOD, |minus| quality[minus])
    }
}

impl FrameMap {
    /// Creates the map from `value_count` values in this layout to the `count` measurements of a
    /// protocol.
    ///
    /// `quadruples` are those of the protocol, or `None` if it has general current patterns, which
    /// require [`Layout::ProtocolOrder`]. `source` names the recording or instrument in messages.
    ///
    /// # Errors
    /// - [`HwError::CountMismatch`] if the layout is [`Layout::ProtocolOrder`] and `value_count`
    ///   differs from `count`;
    /// - [`HwError::MissingDrive`], [`HwError::MissingMeasurement`] or
    ///   [`HwError::MissingElectrode`] if the layout lacks measurements of the protocol;
    /// - [`HwError::NeedsQuadruples`] if the layout names electrodes and `quadruples` is `None`;
    /// - [`HwError::QuadrupleCount`] if there are not `count` quadruples;
    /// - [`HwError::Inconsistent`] if the layout does not have `value_count` values.
    pub fn new(
        layout: &Layout,
        value_count: usize,
        quadruples: Option<&[Quadruple]>,
        count: usize,
        source: impl AsRef<Path>,
    ) -> Result<Self, HwError> {
        let source = source.as_ref();
        let place = || Place::file(source);
        if let Some(found) = layout.value_count().filter(|&found| found != value_count) {
            let (place, field) = (place(), "layout");
            return Err(HwError::Inconsistent { place, field, found, wanted: value_count });
        }
        if let Some(quadruples) = quadruples
            && quadruples.len() != count
        {
            return Err(HwError::QuadrupleCount { quadruples: quadruples.len(), count });
        }
        let needed = || quadruples.ok_or_else(|| HwError::NeedsQuadruples { place: place() });
        let picks = match layout {
            Layout::ProtocolOrder if value_count == count => {
                (0..count).map(|plus| Pick { plus, minus: None, sign: 1.0 }).collect()
            }
            Layout::ProtocolOrder => {
                return Err(HwError::CountMismatch {
                    place: place(),
                    found: value_count,
                    frames: 1,
                    wanted: count,
                    hint: CountHint::of(value_count, 1, count, None),
                });
            }
            Layout::Quadruples(recorded) => by_quadruple(recorded, needed()?, source)?,
            Layout::Potentials { drives, electrodes, driven } => {
                by_potential(drives, [*electrodes, usize::from(!driven) * 2], needed()?, source)?
            }
        };
        Ok(Self { picks, value_count, source: source.to_path_buf() })
    }

    /// Returns the number of measurements.
    pub fn measurements(&self) -> usize {
        self.picks.len()
    }

    /// Returns the number of recorded values per frame.
    pub fn value_count(&self) -> usize {
        self.value_count
    }

    /// Writes the measurements of one frame and their flags to `frame`, whose other fields remain.
    /// The difference of two values has the flags of both.
    ///
    /// `real`, `imaginary` (`None` for real values) and `quality` have
    /// [`value_count`](Self::value_count) entries.
    ///
    /// # Errors
    /// [`HwError::Inconsistent`] for a slice of wrong length; nothing is written then.
    pub fn apply(
        &self,
        real: &[f64],
        imaginary: Option<&[f64]>,
        quality: &[Quality],
        frame: &mut Frame,
    ) -> Result<(), HwError> {
        let fields = [
            ("real", real.len(), self.value_count),
            ("imaginary", imaginary.map_or(self.value_count, <[_]>::len), self.value_count),
            ("quality", quality.len(), self.value_count),
        ];
        check_lengths(&self.source, fields)?;
        self.write(&mut frame.values, |pick| pick.of(real));
        self.write(&mut frame.quality, |pick| pick.quality(quality));
        match imaginary {
            Some(parts) => {
                self.write(frame.imaginary.get_or_insert_default(), |pick| pick.of(parts))
            }
            None => frame.imaginary = None,
        }
        Ok(())
    }

    /// Returns the measurements of a frame, with its numbers and times.
    ///
    /// # Errors
    /// Those of [`apply`](Self::apply).
    pub fn mapped(&self, source: &Frame) -> Result<Frame, HwError> {
        let mut frame = source.clone();
        self.apply_to(source, &mut frame)?;
        Ok(frame)
    }

    /// Applies the map to a frame in the layout of the source.
    pub(crate) fn apply_to(&self, source: &Frame, frame: &mut Frame) -> Result<(), HwError> {
        self.apply(&source.values, source.imaginary.as_deref(), &source.quality, frame)
    }

    fn write<T>(&self, list: &mut Vec<T>, value: impl Fn(Pick) -> T) {
        list.clear();
        list.extend(self.picks.iter().map(|&pick| value(pick)));
    }
}

fn by_quadruple(
    recorded: &[Quadruple],
    wanted: &[Quadruple],
    source: &Path,
) -> Result<Vec<Pick>, HwError> {
    // patterns such as opposite drive contain a measurement in both directions: each is its own
    let mut exact = HashMap::with_capacity(recorded.len());
    let mut place_of = HashMap::with_capacity(recorded.len());
    for (index, &quadruple) in recorded.iter().enumerate() {
        let (key, sign) = unsigned(quadruple);
        exact.entry(quadruple).or_insert(index);
        place_of.entry(key).or_insert((index, sign));
    }
    let missing = |quadruple: Quadruple| {
        let place = Place::file(source);
        let drive = |[a, b, ..]: Quadruple| [a.min(b), a.max(b)];
        match recorded.first() {
            Some(&[first_a, first_b, ..])
                if !recorded.iter().any(|&other| drive(other) == drive(quadruple)) =>
            {
                let [a, b, ..] = quadruple;
                HwError::MissingDrive { place, a, b, first_a, first_b }
            }
            _ => HwError::MissingMeasurement { place, quadruple },
        }
    };
    wanted
        .iter()
        .map(|&quadruple| {
            if let Some(&plus) = exact.get(&quadruple) {
                return Ok(Pick { plus, minus: None, sign: 1.0 });
            }
            let (key, sign) = unsigned(quadruple);
            let (plus, recorded_sign) = *place_of.get(&key).ok_or_else(|| missing(quadruple))?;
            Ok(Pick { plus, minus: None, sign: sign * recorded_sign })
        })
        .collect()
}

/// `left_out`: number of electrodes of a drive without a potential: 0, or the 2 that are driven.
fn by_potential(
    drives: &[[u32; 2]],
    [electrodes, left_out]: [usize; 2],
    wanted: &[Quadruple],
    source: &Path,
) -> Result<Vec<Pick>, HwError> {
    let mut number_of = HashMap::with_capacity(drives.len());
    for (number, &drive) in drives.iter().enumerate() {
        number_of.entry(drive).or_insert(number);
    }
    let checked = |electrode: u32| {
        let index = electrode as usize;
        if index < electrodes {
            return Ok(index);
        }
        let place = Place::file(source);
        Err(HwError::MissingElectrode { place, electrode, count: electrodes })
    };
    wanted
        .iter()
        .map(|&[a, b, m, n]| {
            for driven in [a, b] {
                checked(driven)?;
            }
            let (m, n) = (checked(m)?, checked(n)?);
            let (number, sign) = match (number_of.get(&[a, b]), number_of.get(&[b, a])) {
                (Some(&number), _) => (number, 1.0),
                (None, Some(&number)) => (number, -1.0),
                (None, None) => {
                    let [first_a, first_b] = drives.first().copied().unwrap_or_default();
                    let place = Place::file(source);
                    return Err(HwError::MissingDrive { place, a, b, first_a, first_b });
                }
            };
            let driven = &drives[number][..left_out];
            let in_drive = |electrode: usize| {
                if driven.contains(&(electrode as u32)) {
                    return None;
                }
                let before = driven.iter().filter(|&&e| (e as usize) < electrode).count();
                // none if both driven electrodes are one
                electrode.checked_sub(before).filter(|at| *at < electrodes - left_out)
            };
            let (Some(plus), Some(minus)) = (in_drive(m), in_drive(n)) else {
                let quadruple = [a, b, m as u32, n as u32];
                return Err(HwError::MissingMeasurement { place: Place::file(source), quadruple });
            };
            let first = number * (electrodes - left_out);
            Ok(Pick { plus: first + plus, minus: Some(first + minus), sign })
        })
        .collect()
}
