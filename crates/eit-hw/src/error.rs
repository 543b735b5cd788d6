//! Errors of this crate, and the places in files they refer to. One long file because the enum is
//! one list.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::recording::hint::CountHint;

/// Position in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum At {
    /// No particular position.
    File,
    /// A line, counted from 1.
    Line(usize),
    /// A byte, counted from 0.
    Byte(usize),
}

/// A file and a position in it: `press.csv, line 3`.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Place {
    /// Path of the file, as the caller gave it.
    pub path: PathBuf,
    /// Position in the file.
    pub at: At,
}

impl Place {
    pub(crate) fn file(path: &Path) -> Self {
        Self { path: path.to_path_buf(), at: At::File }
    }

    pub(crate) fn line(path: &Path, line: usize) -> Self {
        Self { path: path.to_path_buf(), at: At::Line(line) }
    }

    pub(crate) fn byte(path: &Path, byte: usize) -> Self {
        Self { path: path.to_path_buf(), at: At::Byte(byte) }
    }
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => f.write_str("whole file"),
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // a file name may contain a line break, but a message must be one line
        let path = self.path.display().to_string().replace(char::is_control, "?");
        match self.at {
            At::File => f.write_str(&path),
            at => write!(f, "{path}, {at}"),
        }
    }
}

/// Error of this crate. Each message is one line that says where, what, and how to fix it.
///
/// Where a scene setting fixes the problem, the message names it: `[recording] format`,
/// `frames_are`, `complex`, `component` or `frequency_row`, or a key of `[protocol]` or
/// `[electrodes]`.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HwError {
    /// The file cannot be read.
    #[error("{place}: cannot be read: {source}; check the path and its permissions")]
    Read {
        /// File with the problem, and where in it.
        place: Place,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A folder, device, pipe or socket instead of a file.
    #[error("{place}: is not a regular file but a folder, device, pipe or socket; name a file")]
    NotAFile {
        /// Path as the caller gave it.
        place: Place,
    },
    /// A folder, but the format is a single file.
    #[error("{place}: is a folder, but a {format} recording is one file; name the file")]
    Folder {
        /// Folder with the problem.
        place: Place,
        /// Name of the format, as in a scene.
        format: &'static str,
    },
    /// A file, but the format is a folder.
    #[error("{place}: is a single file, but a {format} recording is a folder; name the folder")]
    NotAFolder {
        /// File with the problem, and where in it.
        place: Place,
        /// Name of the format, as in a scene.
        format: &'static str,
    },
    /// A folder without a file that its format requires.
    #[error("{place}: has no `{name}`, which a {format} recording needs; copy the whole folder")]
    MissingFile {
        /// Folder with the problem.
        place: Place,
        /// Name of the missing file.
        name: &'static str,
        /// Name of the format, as in a scene.
        format: &'static str,
    },
    /// Two recordings in the same folder.
    #[error("{place}: holds frames of `{one}` and of `{other}`; keep one recording per folder")]
    TwoRecordings {
        /// Folder with the problem.
        place: Place,
        /// Name of one recording.
        one: String,
        /// Name of the other recording.
        other: String,
    },
    /// An empty file.
    #[error("{place}: is empty (0 bytes); record or export it again")]
    Empty {
        /// File with the problem, and where in it.
        place: Place,
    },
    /// A file without a value or complete frame.
    #[error(
        "{place}: no complete frame found ({skipped} incomplete ones skipped); record it again"
    )]
    NoFrames {
        /// File with the problem, and where in it.
        place: Place,
        /// Number of incomplete frames that were skipped.
        skipped: usize,
    },
    /// A byte that cannot occur in text.
    #[error(
        "{place}: byte 0x{byte:02X} is not text, so the file is binary or in another encoding; \
         export it as UTF-8 text or set `[recording] format`"
    )]
    NotText {
        /// Position of the first such byte.
        place: Place,
        /// Value of the byte.
        byte: u8,
    },
    /// Text, but the format is binary.
    #[error(
        "{place}: is text, but {format} is binary; set `[recording] format` to the file's format"
    )]
    NotBinary {
        /// File with the problem, and where in it.
        place: Place,
        /// Name of the format, as in a scene.
        format: &'static str,
    },
    /// The last line has no line end, so it may be truncated: programs write one.
    #[error(
        "{place}: has no line end, so its last number may be truncated; copy the file again, or end the \
         line if it is complete"
    )]
    NoLineEnd {
        /// File and last line.
        place: Place,
    },
    /// A field that is not a number.
    #[error("{place}: value {value} is {text:?}, not a number; {}", number_hint(text))]
    NotANumber {
        /// File and line.
        place: Place,
        /// Position of the field in the line, from 1.
        value: usize,
        /// Content of the field, shortened.
        text: String,
    },
    /// A value that is NaN or infinite.
    #[error(
        "{place}: frame {frame}, measurement {measurement} (both counted from 0) is {value}; \
         remove or repair that frame"
    )]
    NonFinite {
        /// File, and line or byte.
        place: Place,
        /// Index of the frame, from 0.
        frame: usize,
        /// Index of the measurement, from 0.
        measurement: usize,
        /// NaN or an infinity.
        value: f64,
    },
    /// A value that cannot be a voltage of this instrument.
    #[error("{place}: {value:e} is not a plausible voltage; the file is damaged or not {format}")]
    Implausible {
        /// Position of the value.
        place: Place,
        /// Value that was rejected.
        value: f64,
        /// Name of the format, as in a scene.
        format: &'static str,
    },
    /// A count that does not match the rest of the file or the scene.
    #[error("{place}: {found} {what}, but expected {wanted}; {mend}")]
    Count {
        /// Where the count was found.
        place: Place,
        /// What was counted.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number expected.
        wanted: usize,
        /// How to fix it.
        mend: &'static str,
    },
    /// A header or table field with an unexpected value.
    #[error("{place}: {field} is {text:?}, expected {wanted}; {mend}")]
    Field {
        /// Where the field is.
        place: Place,
        /// Name of the field.
        field: &'static str,
        /// Content of the field, shortened.
        text: String,
        /// Expected content.
        wanted: &'static str,
        /// How to fix it.
        mend: &'static str,
    },
    /// A stored shape that is neither a frame nor a list of frames.
    #[error(
        "{place}: has the shape {shape:?}; one frame is [measurement], several are \
         [frame, measurement] or [frame, drive, electrode]"
    )]
    Shape {
        /// File with the problem, and where in it.
        place: Place,
        /// The shape found.
        shape: Vec<usize>,
    },
    /// A file of arrays, none of which holds numbers.
    #[error(
        "{place}: holds no array of numbers ({others}); save the matrix [frame, measurement] as a variable of \
         its own, in MATLAB by v = full(s.FIELD); save('frames.mat', 'v', '-v7')"
    )]
    NoArray {
        /// File with the problem.
        place: Place,
        /// What it holds instead.
        others: String,
    },
    /// A file of several arrays, and it is not clear which has the frames.
    #[error(
        "{place}: {fault}: {arrays}; set `[recording] array` to the name of the one with the frames"
    )]
    WhichArray {
        /// File with the problem.
        place: Place,
        /// Why it is not clear.
        fault: ArrayFault,
        /// Names and shapes of the arrays.
        arrays: String,
    },
    /// A current of 0, by which a voltage would be divided.
    #[error("{place}: the current is 0, so voltage over current is undefined; remove the file")]
    ZeroCurrent {
        /// File and line.
        place: Place,
    },
    /// A frequency row that does not exist in the recording.
    #[error(
        "{place}: has {rows} frequency rows, but row {row} (counted from 0) was requested; \
         set `[recording] frequency_row`"
    )]
    FrequencyRow {
        /// File with the problem, and where in it.
        place: Place,
        /// Row requested, from 0.
        row: usize,
        /// Number of rows.
        rows: usize,
    },
    /// A key that applies only to tables of numbers, or to complex values, in another kind of
    /// recording.
    #[error(
        "{place}: `[recording] {key}` is for {meant}, but this is a {format} recording; remove the \
         key"
    )]
    UnusedKey {
        /// File or folder with the problem.
        place: Place,
        /// The key of `[recording]`.
        key: &'static str,
        /// Format of the recording.
        format: &'static str,
        /// What the key applies to.
        meant: &'static str,
    },
    /// A format that is recognised but not supported.
    #[error("{place}: is a {format} file, which is not supported; export it as CSV or NPY")]
    Unsupported {
        /// File with the problem, and where in it.
        place: Place,
        /// Name of the format.
        format: &'static str,
    },
    /// No known format matches.
    #[error("{place}: the format is not recognised; set `[recording] format` to one of {known}")]
    Unrecognised {
        /// File or folder with the problem.
        place: Place,
        /// Names of the known formats.
        known: String,
    },
    /// A file of another program, which is not read.
    #[error("{place}: {what}: {mend}")]
    Foreign {
        /// The file.
        place: Place,
        /// What it is.
        what: &'static str,
        /// What to do.
        mend: &'static str,
    },
    /// More than one format matches.
    #[error(
        "{place}: may be {one} or {other}; set `[recording] format = \"{one}\"` or \"{other}\""
    )]
    Ambiguous {
        /// File or folder with the problem.
        place: Place,
        /// Name of one format.
        one: &'static str,
        /// Name of the other format.
        other: &'static str,
    },
    /// An unknown name of a format.
    #[error("format {name:?} does not exist; set `[recording] format` to one of {known}")]
    UnknownFormat {
        /// Name that is not known, shortened.
        name: String,
        /// Names of the known formats.
        known: String,
    },
    /// The number of values per frame differs from the scene's protocol.
    #[error(
        "{place}: {found} values per frame in {frames} frame(s), but the scene's protocol has \
         {wanted} measurements; {hint}"
    )]
    CountMismatch {
        /// File with the problem, and where in it.
        place: Place,
        /// Values per frame in the file.
        found: usize,
        /// Number of frames in the file.
        frames: usize,
        /// Number of measurements of the protocol.
        wanted: usize,
        /// What the two counts suggest.
        hint: CountHint,
    },
    /// The caller's list of quadruples is not as long as its count of measurements.
    #[error("{quadruples} quadruples given for {count} measurements; give one per measurement")]
    QuadrupleCount {
        /// Number of quadruples given.
        quadruples: usize,
        /// Number of measurements.
        count: usize,
    },
    /// A recording that names electrodes, used with a protocol of general current patterns.
    #[error(
        "{place}: names the electrodes of each value, but the scene's protocol has no electrode \
         pairs; use `drive` or `quadruples_file` in `[protocol]`"
    )]
    NeedsQuadruples {
        /// File with the problem, and where in it.
        place: Place,
    },
    /// The recording lacks a drive of the protocol.
    #[error(
        "{place}: has no drive ({a}, {b}) (electrodes from 0), which the scene's protocol needs; \
         set `[protocol] drive` to what was recorded, such as ({first_a}, {first_b})"
    )]
    MissingDrive {
        /// File with the problem, and where in it.
        place: Place,
        /// Electrode where current enters.
        a: u32,
        /// Electrode where current leaves.
        b: u32,
        /// Electrode where current enters in the recording's first drive.
        first_a: u32,
        /// Electrode where current leaves in the recording's first drive.
        first_b: u32,
    },
    /// The recording has the drive but not this measured pair.
    #[error(
        "{place}: has no measurement {quadruple:?} (a, b, m, n from 0), which the scene's protocol \
         needs; set `[protocol] measure` or `quadruples_file` to what was recorded"
    )]
    MissingMeasurement {
        /// File with the problem, and where in it.
        place: Place,
        /// The missing measurement.
        quadruple: [u32; 4],
    },
    /// The protocol uses an electrode that the recording does not have.
    #[error(
        "{place}: has the electrodes 0 to {last}, but the scene's protocol uses electrode \
         {electrode}; set `[electrodes] count` to {count}",
        last = count.saturating_sub(1)
    )]
    MissingElectrode {
        /// File with the problem, and where in it.
        place: Place,
        /// Electrode of the protocol, from 0.
        electrode: u32,
        /// Number of electrodes in the recording.
        count: usize,
    },
    /// A component of complex values is requested, but the recording is real.
    #[error("{place}: contains only real values; set `[recording] component = \"real\"`")]
    NoImaginaryPart {
        /// File with the problem, and where in it.
        place: Place,
    },
    /// An invalid setting.
    #[error("{name} is {value}; expected {wanted}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// Value of the setting.
        value: String,
        /// Valid values.
        wanted: &'static str,
    },
    /// A port or address that cannot be opened.
    #[error("{endpoint}: cannot be opened: {source}; {mend}")]
    Open {
        /// Serial port or network address.
        endpoint: String,
        /// Error of the operating system.
        source: std::io::Error,
        /// What to try.
        mend: String,
    },
    /// The connection was lost.
    #[error("{endpoint}: connection lost: {source}; check cable and power")]
    Lost {
        /// Serial port or network address.
        endpoint: String,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A command was not answered.
    #[error(
        "{endpoint}: no {wanted} within {waited_s:.1} s; check that {}, and the baud rate and power",
        driver_check(.driver)
    )]
    NoReply {
        /// Serial port or network address.
        endpoint: String,
        /// Name of the driver.
        driver: &'static str,
        /// Expected answer.
        wanted: &'static str,
        /// Time waited, in seconds.
        waited_s: f64,
    },
    /// A command was not answered by an instrument that had identified itself.
    #[error(
        "{endpoint}: the instrument identified itself but did not answer the command to {command} ({bytes} \
         bytes) within {waited_s:.1} s; the line loses bytes or is slow: use a shorter cable, or check \
         how long a command its buffer holds"
    )]
    Unanswered {
        /// Serial port or network address.
        endpoint: String,
        /// What the command tells the instrument to do.
        command: &'static str,
        /// Length of the command.
        bytes: usize,
        /// Time waited, in seconds.
        waited_s: f64,
    },
    /// Lines were received, but with another number of values than expected of the board.
    #[error(
        "{endpoint}: received complete lines of {found} numbers, but the scene's protocol has {wanted} \
         measurements on the electrodes of this scene, that is {wanted_numbers} numbers per line; {hint}"
    )]
    LineCount {
        /// Serial port or network address.
        endpoint: String,
        /// Numbers per complete line received.
        found: usize,
        /// Number of measurements of the protocol.
        wanted: usize,
        /// Numbers per line expected.
        wanted_numbers: usize,
        /// What the counts suggest.
        hint: CountHint,
    },
    /// Bytes were received, but not of the driver's protocol.
    #[error("{endpoint}: received {bytes} bytes, but no {wanted}: they are {what}; {mend}")]
    NotUnderstood {
        /// Serial port or network address.
        endpoint: String,
        /// Number of bytes received last.
        bytes: usize,
        /// Expected answer.
        wanted: &'static str,
        /// What the bytes look like.
        what: String,
        /// What to try.
        mend: String,
    },
    /// The instrument refused a command.
    #[error("{endpoint}: the instrument refused to {command}: {reason}; change that setting")]
    Refused {
        /// Serial port or network address.
        endpoint: String,
        /// What the command tells the instrument to do.
        command: &'static str,
        /// Reason given by the instrument.
        reason: String,
    },
    /// The instrument did not accept a setting.
    #[error(
        "{endpoint}: {setting} was set to {wanted}, but the instrument reports {found}; choose a \
         supported value"
    )]
    ReadBack {
        /// Serial port or network address.
        endpoint: String,
        /// Name of the setting.
        setting: &'static str,
        /// Value requested.
        wanted: String,
        /// Value reported by the instrument.
        found: String,
    },
    /// Another instrument answers than before.
    #[error("{endpoint}: is now {found}, but was {wanted}; plug the original instrument in again")]
    Identity {
        /// Serial port or network address.
        endpoint: String,
        /// Identity of the original instrument.
        wanted: String,
        /// Identity of the new instrument.
        found: String,
    },
    /// The consumer did not take frames fast enough.
    #[error(
        "{endpoint}: the queue of {capacity} frames is full; read frames faster, or set \
         the queue to keep the latest"
    )]
    Overflow {
        /// Serial port or network address.
        endpoint: String,
        /// Number of frames the queue holds.
        capacity: usize,
    },
    /// A damaged recording without a single intact message.
    #[error("{place}: its {bytes} bytes hold no intact message, so there is nothing to recover")]
    NothingWhole {
        /// Recording with the problem.
        place: Place,
        /// Length of the file in bytes.
        bytes: u64,
    },
    /// A recording cannot be written.
    #[error("{place}: cannot be written: {source}; check disk space and permissions")]
    Write {
        /// File with the problem, and where in it.
        place: Place,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A new recording whose name is taken.
    #[error(
        "{place}: exists, and a recording is never overwritten; name another file, or append to it"
    )]
    Exists {
        /// The file, or the first part of a split recording.
        place: Place,
    },
    /// A recording that another program is writing.
    #[error(
        "{place}: another program is recording to it; stop that program, or record to another file"
    )]
    Busy {
        /// File with the problem, and where in it.
        place: Place,
    },
    /// A file that expands to more values than its size justifies.
    #[error(
        "{place}: unpacks to more than {most_mb} MB of frames from {file_mb:.1} MB, like a \
         file made to exhaust memory; convert it to CSV, which needs little memory, or replay it"
    )]
    TooLarge {
        /// File with the problem, and where in it.
        place: Place,
        /// Limit that was exceeded, in megabytes.
        most_mb: u64,
        /// Size of the file in megabytes.
        file_mb: f64,
    },
    /// A frame with more values than a recording can hold.
    #[error(
        "a frame of {values} values cannot be recorded, at most {most}; give a frame a row of its own, or \
         set `[recording] frames_are`"
    )]
    LongFrame {
        /// Number of values of the frame.
        values: usize,
        /// Largest number of values.
        most: usize,
    },
    /// A container of records that is invalid or incomplete, or does not match.
    #[error("{place}: {what}; {mend}")]
    Container {
        /// File with the problem, and where in it.
        place: Place,
        /// Description of the problem.
        what: String,
        /// How to fix it.
        mend: &'static str,
    },
    /// Fields of a [`Recording`](crate::Recording), or slices given to a
    /// [`FrameMap`](crate::FrameMap), of inconsistent lengths.
    #[error(
        "{place}: `{field}` has {found} entries, but expected {wanted}; make the lengths match"
    )]
    Inconsistent {
        /// File with the problem, and where in it.
        place: Place,
        /// Name of the field.
        field: &'static str,
        /// Number of entries found.
        found: usize,
        /// Number of entries expected.
        wanted: usize,
    },
}

/// Why it is not clear which array of a file has the frames.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ArrayFault {
    /// None has the name that is stated.
    Missing {
        /// The name, shortened.
        name: String,
    },
    /// None has frames of as many measurements as the protocol.
    NoneFits {
        /// Number of measurements of the protocol.
        wanted: usize,
    },
    /// More than one has such frames.
    SeveralFit {
        /// Number of measurements of the protocol.
        wanted: usize,
    },
    /// There are several, and no protocol.
    Several,
}

impl fmt::Display for ArrayFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing { name } => write!(f, "has no array of numbers named {name:?}"),
            Self::NoneFits { wanted } => {
                write!(f, "no array has frames of the protocol's {wanted} measurements")
            }
            Self::SeveralFit { wanted } => {
                write!(f, "more than one array has frames of the protocol's {wanted} measurements")
            }
            Self::Several => f.write_str("holds several arrays"),
        }
    }
}

impl HwError {
    /// A damaged array of a file of several; `name` may be unknown (empty).
    #[cfg(feature = "arrays")]
    pub(crate) fn damaged_array(place: Place, name: &str, error: impl fmt::Display) -> Self {
        let name = if name.is_empty() { String::new() } else { format!(" `{}`", shortened(name)) };
        let what = format!("the array{name} is damaged ({error})");
        Self::Container { place, what, mend: "copy or save the file again" }
    }

    /// An invalid setting, with its valid values.
    pub(crate) fn setting(name: &'static str, value: impl ToString, wanted: &'static str) -> Self {
        Self::Setting { name, value: value.to_string(), wanted }
    }

    /// The error of a setting unless it is valid.
    pub(crate) fn require(
        is_valid: bool,
        name: &'static str,
        value: impl ToString,
        wanted: &'static str,
    ) -> Result<(), Self> {
        if is_valid { Ok(()) } else { Err(Self::setting(name, value, wanted)) }
    }

    /// A count that does not match: the one found and the one wanted.
    pub(crate) fn count(
        place: Place,
        what: &'static str,
        [found, wanted]: [usize; 2],
        mend: &'static str,
    ) -> Self {
        Self::Count { place, what, found, wanted, mend }
    }
}

/// Explains how to write a number; a decimal comma is named as such.
fn number_hint(text: &str) -> &'static str {
    let parts: Vec<&str> = text.split([',', ' ']).collect();
    match parts.len() > 1 && parts.iter().all(|part| part.parse::<f64>().is_ok()) {
        // `1,5`, or `5 2` from `1,5 2,5`
        true => "write a decimal point, not a comma, as in 1234.5e-6",
        // names of columns
        false if text.starts_with(char::is_alphabetic) => {
            "write numbers like 1234.5e-6, and if this line is a header, remove it"
        }
        false => "write numbers like 1234.5e-6",
    }
}

/// Truncates `text` to 40 characters for a message.
pub(crate) fn shortened(text: &str) -> String {
    const MOST: usize = 40;
    let mut short: String = text.chars().take(MOST).collect();
    if short.len() < text.len() {
        short.push_str("...");
    }
    short
}

/// What to check of a driver that got no answer; the boards that send text have names of their own.
fn driver_check(driver: &str) -> String {
    match driver {
        "text" => "`[instrument] driver` names the right board".to_owned(),
        other => format!("the driver is `{other}`"),
    }
}
