//! Files of several arrays: chooses the one with the frames, within bounds of memory.

use std::path::Path;

use super::ReadOptions;
use super::array::Array;
use super::number::Kind;
use crate::error::{ArrayFault, HwError, Place, shortened};
use crate::frame::Quality;
use crate::recording::{Format, FrameOrientation, Note, Recording};

/// What is known of an array before its numbers are read.
pub(super) struct Listed {
    pub name: String,
    pub shape: Vec<usize>,
    /// What it is, if not an array of numbers.
    pub other: Option<&'static str>,
}

/// The array with the frames.
pub(super) struct Chosen<'a> {
    listed: &'a Listed,
    /// Its place in the list.
    pub index: usize,
    frames_are: Option<FrameOrientation>,
    /// Whether there is something to tell.
    is_choice: bool,
}

/// Chooses the array that [`ReadOptions::array`] names, or else the only array of numbers, or else
/// the only one that fits [`ReadOptions::measurements`], or else the only table.
///
/// # Errors
/// [`HwError::NoArray`] if none holds numbers, [`HwError::WhichArray`] if it cannot be told.
pub(super) fn choose<'a>(
    list: &'a [Listed],
    options: &ReadOptions,
    path: &Path,
) -> Result<Chosen<'a>, HwError> {
    let place = || Place::file(path);
    let numbers: Vec<usize> = (0..list.len()).filter(|&at| list[at].other.is_none()).collect();
    let which = |fault| HwError::WhichArray { place: place(), fault, arrays: names(list) };
    if numbers.is_empty() {
        return Err(HwError::NoArray { place: place(), others: names(list) });
    }
    let orientation = |at: usize| {
        let count = options.measurements?;
        orientation(&list[at].shape, count, options.frames_are)
    };
    let only = |fits: &dyn Fn(usize) -> bool| {
        let mut fitting = numbers.iter().copied().filter(|&at| fits(at));
        (fitting.next(), fitting.next().is_some())
    };
    let is_table = |at: usize| list[at].shape.iter().filter(|&&size| size > 1).count() > 1;
    let index = if let Some(name) = &options.array {
        let named = numbers.iter().copied().find(|&at| list[at].name == *name);
        named.ok_or_else(|| which(ArrayFault::Missing { name: shortened(name) }))?
    } else if let [only] = numbers[..] {
        only
    } else {
        let wanted = options.measurements;
        match (wanted, only(&|at| orientation(at).is_some()), only(&is_table)) {
            (_, (Some(fits), false), _) | (_, (None, _), (Some(fits), false)) => fits,
            (Some(wanted), (Some(_), true), _) => {
                return Err(which(ArrayFault::SeveralFit { wanted }));
            }
            (Some(wanted), ..) => return Err(which(ArrayFault::NoneFits { wanted })),
            (None, ..) => return Err(which(ArrayFault::Several)),
        }
    };
    let frames_are = options.frames_are.or_else(|| orientation(index));
    let is_turned = frames_are != options.frames_are && frames_are != Some(FrameOrientation::Rows);
    let is_choice = numbers.len() > 1 || is_turned;
    Ok(Chosen { listed: &list[index], index, frames_are, is_choice })
}

impl Chosen<'_> {
    /// Returns the frames of the array, which has been read; a note says what was chosen.
    pub(super) fn recording(
        self,
        array: Array<'_>,
        format: Format,
        options: &ReadOptions,
        path: &Path,
    ) -> Result<Recording, HwError> {
        let options = ReadOptions { frames_are: self.frames_are, ..options.clone() };
        let mut recording = array.recording(format, &options, path)?;
        if self.is_choice {
            let by_columns = self.frames_are == Some(FrameOrientation::Columns);
            let Listed { name, shape, .. } = self.listed;
            let (name, shape) = (shortened(name), shape.clone());
            recording.notes.push(Note::Array { name, shape, by_columns });
        }
        Ok(recording)
    }
}

/// Returns how frames of `count` measurements lie in an array of this shape; `None` if not at all.
fn orientation(
    shape: &[usize],
    count: usize,
    stated: Option<FrameOrientation>,
) -> Option<FrameOrientation> {
    use FrameOrientation::{Columns, Matrix, Rows};
    let is = |first: usize, second: usize| first.checked_mul(second) == Some(count);
    let fits = |orientation| match (orientation, shape) {
        (Rows, &[values]) => values == count,
        // a frame may take several rows, one for each drive
        (Rows, &[rows, columns]) => columns == count || is(rows, columns),
        (Rows, &[_, drives, electrodes]) => is(drives, electrodes),
        (Columns, &[rows, _]) => rows == count,
        (Matrix, &[rows, columns]) => is(rows, columns),
        _ => false,
    };
    let known = stated.map_or(vec![Rows, Columns], |stated| vec![stated]);
    known.into_iter().find(|&orientation| fits(orientation))
}

/// Names and shapes for a message: `v` [5, 208], `s` (a struct).
fn names(list: &[Listed]) -> String {
    const MOST: usize = 8;
    let name = |listed: &Listed| {
        let name = shortened(&listed.name).replace(char::is_control, "?");
        match listed.other {
            Some(what) => format!("`{name}` ({what})"),
            None => format!("`{name}` {:?}", listed.shape),
        }
    };
    let mut names: Vec<String> = list.iter().take(MOST).map(name).collect();
    if list.len() > MOST {
        names.push(format!("{} more", list.len() - MOST));
    }
    names.join(", ")
}

/// Checks that `raw_bytes` of an array may be unpacked, and its `count` numbers of one or two parts read.
///
/// # Errors
/// [`HwError::TooLarge`] if that takes more memory than a [`Recording`] may.
pub(super) fn check_memory(
    kind: Kind,
    raw_bytes: usize,
    [count, parts]: [usize; 2],
    file: &[u8],
    path: &Path,
) -> Result<(), HwError> {
    // with the file itself, at most 64 MB and ten times the file
    const LEAST_BYTES: usize = 60_000_000;
    const TIMES_FILE: usize = 9;
    let most = LEAST_BYTES.saturating_add(TIMES_FILE.saturating_mul(file.len()));
    // whole numbers are never missing
    let flags = if kind.is_float() { size_of::<Quality>() } else { 0 };
    let needed = count.checked_mul(size_of::<f64>() * parts + flags);
    if needed.and_then(|needed| needed.checked_add(raw_bytes)).is_some_and(|sum| sum <= most) {
        return Ok(());
    }
    Err(HwError::TooLarge {
        place: Place::file(path),
        most_mb: most as u64 / 1_000_000,
        file_mb: 1e-6 * file.len() as f64,
    })
}
