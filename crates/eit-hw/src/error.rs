//! The error of this crate and the places it points to. One long file: the enum is one list.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::recording::hint::CountHint;

/// Where in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// The file as a whole.
    File,
    /// A line, counted from 1.
    Line(usize),
    /// A byte, counted from 0.
    Byte(usize),
}

/// A file and where in it: `press.csv, line 3`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file, as it was named by the caller.
    pub path: PathBuf,
    /// Where in it.
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
        // a file name may hold a line break, and the message must stay on one line
        let path = self.path.display().to_string().replace(char::is_control, "?");
        match self.at {
            At::File => f.write_str(&path),
            at => write!(f, "{path}, {at}"),
        }
    }
}

/// What a reader or a recording refuses. Each message is one line: where, what, how to mend it.
///
/// Messages name keys of the scene file (`[recording] format`, `frames_are`, `complex`, `component`
/// and `frequency_row`, and some of `[protocol]` and `[electrodes]`) where setting one mends it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HwError {
    /// The system does not let the file be read.
    #[error("{place}: cannot be read: {source}; check the path and its permissions")]
    Read {
        /// The file.
        place: Place,
        /// What the system says.
        source: std::io::Error,
    },
    /// A device, a pipe or a socket where a file is wanted.
    #[error("{place}: is no regular file, but a device or a pipe; name a file")]
    NotAFile {
        /// What was named.
        place: Place,
    },
    /// A folder where the format is one file.
    #[error("{place}: is a folder, but a {format} recording is one file; name the file")]
    Folder {
        /// The folder.
        place: Place,
        /// The format.
        format: &'static str,
    },
    /// A file where the format is a folder.
    #[error("{place}: is one file, but a {format} recording is a folder; name the folder")]
    NotAFolder {
        /// The file.
        place: Place,
        /// The format.
        format: &'static str,
    },
    /// A folder that lacks a file of its format.
    #[error("{place}: has no `{name}`, which a {format} recording needs; copy the whole folder")]
    MissingFile {
        /// The folder.
        place: Place,
        /// The name looked for.
        name: &'static str,
        /// The format.
        format: &'static str,
    },
    /// Two recordings in one folder.
    #[error("{place}: holds frames of `{one}` and of `{other}`; keep one recording in a folder")]
    TwoRecordings {
        /// The folder.
        place: Place,
        /// Name of the one.
        one: String,
        /// Name of the other.
        other: String,
    },
    /// A file of 0 bytes.
    #[error("{place}: is empty (0 bytes); record or export it anew")]
    Empty {
        /// The file.
        place: Place,
    },
    /// A file without one value or whole frame.
    #[error("{place}: no complete frame found ({skipped} cut ones skipped); record it anew")]
    NoFrames {
        /// The file.
        place: Place,
        /// Cut frames that were skipped.
        skipped: usize,
    },
    /// A byte that no text holds.
    #[error(
        "{place}: byte 0x{byte:02X} is not text, so the file is binary or in another encoding; \
         export it as UTF-8 text or set `[recording] format`"
    )]
    NotText {
        /// The first such byte.
        place: Place,
        /// Its value.
        byte: u8,
    },
    /// Text where the format is binary.
    #[error("{place}: is text, but {format} is binary; set `[recording] format` to what it is")]
    NotBinary {
        /// The file.
        place: Place,
        /// The format.
        format: &'static str,
    },
    /// A last line without its end, where a program would have written one.
    #[error(
        "{place}: has no line end, so its last number may be cut; copy the file anew, or end the \
         line if it is whole"
    )]
    NoLineEnd {
        /// The last line.
        place: Place,
    },
    /// A field that is no number.
    #[error("{place}: value {value} is {text:?}, not a number; write 1234.5e-6, with a point")]
    NotANumber {
        /// The line.
        place: Place,
        /// Position in the line, from 1.
        value: usize,
        /// The field, shortened.
        text: String,
    },
    /// A value that is NaN or infinite.
    #[error(
        "{place}: frame {frame}, measurement {measurement} (both counted from 0) is {value}; \
         leave that frame out or repair it"
    )]
    NonFinite {
        /// Line or byte.
        place: Place,
        /// The frame, from 0.
        frame: usize,
        /// The measurement, from 0.
        measurement: usize,
        /// NaN or an infinity.
        value: f64,
    },
    /// A value that no voltage of this instrument has.
    #[error("{place}: {value:e} is no voltage; the file is damaged or not {format}")]
    Implausible {
        /// Where it stands.
        place: Place,
        /// The value.
        value: f64,
        /// The format.
        format: &'static str,
    },
    /// Another number of something than its surroundings ask for.
    #[error("{place}: {found} {what}, but {wanted} wanted; {mend}")]
    Count {
        /// Where.
        place: Place,
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        wanted: usize,
        /// How to mend it.
        mend: &'static str,
    },
    /// A header or table field that does not hold what it should.
    #[error("{place}: {field} is {text:?}, {wanted} wanted; {mend}")]
    Field {
        /// Where.
        place: Place,
        /// Which field.
        field: &'static str,
        /// What it holds, shortened.
        text: String,
        /// What it should hold.
        wanted: &'static str,
        /// How to mend it.
        mend: &'static str,
    },
    /// A stored shape that is no frame and no list of frames.
    #[error(
        "{place}: has the shape {shape:?}; one frame is [measurement], several are \
         [frame, measurement]"
    )]
    Shape {
        /// The file.
        place: Place,
        /// The shape found.
        shape: Vec<usize>,
    },
    /// A current of 0, by which a voltage would be divided.
    #[error("{place}: the current is 0, so voltage over current is undefined; remove the file")]
    ZeroCurrent {
        /// The line.
        place: Place,
    },
    /// A frequency row that the recording does not have.
    #[error(
        "{place}: has {rows} frequency rows, row {row} (counted from 0) wanted; \
         set `[recording] frequency_row`"
    )]
    FrequencyRow {
        /// The file.
        place: Place,
        /// Row asked for, from 0.
        row: usize,
        /// Rows there are.
        rows: usize,
    },
    /// A key that says how a table of numbers is laid out, for what is none.
    #[error(
        "{place}: `[recording] {key}` is for {meant}, but this is a {format} recording; leave the \
         key out"
    )]
    UnusedKey {
        /// The file or folder.
        place: Place,
        /// The key of `[recording]`.
        key: &'static str,
        /// What the recording is.
        format: &'static str,
        /// What the key is for.
        meant: &'static str,
    },
    /// A format that is recognised, but not read.
    #[error("{place}: is a {format} file, which is not read; export it as CSV or NPY")]
    Unsupported {
        /// The file.
        place: Place,
        /// Its format.
        format: &'static str,
    },
    /// No format fits.
    #[error("{place}: the format is not recognised; set `[recording] format` to one of {known}")]
    Unrecognised {
        /// File or folder.
        place: Place,
        /// Names of the formats.
        known: String,
    },
    /// More than one format fits.
    #[error(
        "{place}: may be {one} or {other}; set `[recording] format = \"{one}\"` or \"{other}\""
    )]
    Ambiguous {
        /// File or folder.
        place: Place,
        /// Name of the one format.
        one: &'static str,
        /// Name of the other.
        other: &'static str,
    },
    /// A format name that does not exist.
    #[error("format {name:?} does not exist; set `[recording] format` to one of {known}")]
    UnknownFormat {
        /// The name given, shortened.
        name: String,
        /// Names of the formats.
        known: String,
    },
    /// The file has another number of values a frame than the scene's protocol.
    #[error(
        "{place}: {found} values a frame in {frames} frame(s), but the scene's protocol has \
         {wanted} measurements; {hint}"
    )]
    CountMismatch {
        /// The file.
        place: Place,
        /// Values a frame in the file.
        found: usize,
        /// Frames in the file.
        frames: usize,
        /// Measurements of the protocol.
        wanted: usize,
        /// What the two counts suggest.
        hint: CountHint,
    },
    /// The caller's list of quadruples is not as long as the caller's count.
    #[error("{quadruples} quadruples given for {count} measurements; give one for each")]
    QuadrupleCount {
        /// Quadruples given.
        quadruples: usize,
        /// Measurements asked for.
        count: usize,
    },
    /// A recording that names electrodes, for a protocol of general current patterns.
    #[error(
        "{place}: names the electrodes of each value, but the scene's protocol has no electrode \
         pairs; use `drive` or `quadruples_file` in `[protocol]`"
    )]
    NeedsQuadruples {
        /// The file.
        place: Place,
    },
    /// The recording does not have a drive of the protocol.
    #[error(
        "{place}: has no drive ({a}, {b}) (electrodes from 0), which the scene's protocol wants; \
         set `[protocol] drive` to what was recorded, such as ({first_a}, {first_b})"
    )]
    MissingDrive {
        /// The file.
        place: Place,
        /// Electrode where current enters.
        a: u32,
        /// Electrode where it leaves.
        b: u32,
        /// First drive of the recording, where current enters.
        first_a: u32,
        /// First drive of the recording, where it leaves.
        first_b: u32,
    },
    /// The recording has the drive, but not this measured pair.
    #[error(
        "{place}: has no measurement {quadruple:?} (a, b, m, n from 0), which the scene's protocol \
         wants; set `[protocol] measure` or `quadruples_file` to what was recorded"
    )]
    MissingMeasurement {
        /// The file.
        place: Place,
        /// The measurement.
        quadruple: [u32; 4],
    },
    /// An electrode number beyond those recorded.
    #[error(
        "{place}: has the electrodes 0 to {last}, but the scene's protocol uses electrode \
         {electrode}; set `[electrodes] count` to {count}",
        last = count.saturating_sub(1)
    )]
    MissingElectrode {
        /// The file.
        place: Place,
        /// Electrode of the protocol, from 0.
        electrode: u32,
        /// Electrodes of the recording.
        count: usize,
    },
    /// A component of complex values that the recording does not have.
    #[error("{place}: holds real values only; set `[recording] component = \"real\"`")]
    NoImaginaryPart {
        /// The file.
        place: Place,
    },
    /// A setting that cannot be.
    #[error("{name} is {value}; {wanted} wanted")]
    Setting {
        /// Which.
        name: &'static str,
        /// Its value.
        value: String,
        /// What it should be.
        wanted: &'static str,
    },
    /// A port or address that cannot be opened.
    #[error("{endpoint}: cannot be opened: {source}; {mend}")]
    Open {
        /// The port or address.
        endpoint: String,
        /// What the system says.
        source: std::io::Error,
        /// What to try.
        mend: String,
    },
    /// A connection that broke while the instrument was set up.
    #[error("{endpoint}: connection lost: {source}; check cable and power")]
    Lost {
        /// The port or address.
        endpoint: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// No answer to a command.
    #[error(
        "{endpoint}: no {wanted} within {waited_s:.1} s; check that the driver is `{driver}`, and the \
         baud rate and power"
    )]
    NoReply {
        /// The port or address.
        endpoint: String,
        /// The driver.
        driver: &'static str,
        /// What was waited for.
        wanted: &'static str,
        /// For how long.
        waited_s: f64,
    },
    /// No answer of an instrument that has said who it is.
    #[error(
        "{endpoint}: the instrument said who it is, but did not answer the command to {command} ({bytes} \
         bytes) within {waited_s:.1} s; the line loses bytes or is slow: use a shorter cable, or check \
         how long a command its buffer holds"
    )]
    Unanswered {
        /// The port or address.
        endpoint: String,
        /// What it was told to do.
        command: &'static str,
        /// Length of the command.
        bytes: usize,
        /// How long was waited.
        waited_s: f64,
    },
    /// Lines came, but of another number of values than the board's.
    #[error(
        "{endpoint}: whole lines of {found} numbers came, but the scene's protocol has {wanted} \
         measurements on the electrodes of this scene, {wanted_numbers} numbers a line; {hint}"
    )]
    LineCount {
        /// The port or address.
        endpoint: String,
        /// Numbers of a whole line.
        found: usize,
        /// Measurements wanted.
        wanted: usize,
        /// Numbers of a line that were wanted.
        wanted_numbers: usize,
        /// What the counts suggest.
        hint: CountHint,
    },
    /// Bytes came, but not those of the driver's protocol.
    #[error("{endpoint}: {bytes} bytes came, but no {wanted}: they are {what}; {mend}")]
    NotUnderstood {
        /// The port or address.
        endpoint: String,
        /// How many came last.
        bytes: usize,
        /// What was waited for.
        wanted: &'static str,
        /// What they look like.
        what: String,
        /// What to try.
        mend: String,
    },
    /// The instrument refuses a command.
    #[error("{endpoint}: the instrument refuses to {command}: {reason}; change that setting")]
    Refused {
        /// The port or address.
        endpoint: String,
        /// What it should do.
        command: &'static str,
        /// Its reason.
        reason: String,
    },
    /// The instrument does not do what it was told.
    #[error(
        "{endpoint}: {setting} was set to {wanted}, but the instrument says {found}; set what it \
         can do"
    )]
    ReadBack {
        /// The port or address.
        endpoint: String,
        /// The setting.
        setting: &'static str,
        /// What was asked for.
        wanted: String,
        /// What it says.
        found: String,
    },
    /// Another instrument answers than before.
    #[error("{endpoint}: is {found} now, but was {wanted}; plug the first one in again")]
    Identity {
        /// The port or address.
        endpoint: String,
        /// The one before.
        wanted: String,
        /// The one now.
        found: String,
    },
    /// More frames than the consumer took.
    #[error(
        "{endpoint}: {capacity} frames wait and none was taken in time; take them faster, or set \
         the queue to keep the latest"
    )]
    Overflow {
        /// The port or address.
        endpoint: String,
        /// Frames the queue holds.
        capacity: usize,
    },
    /// A damaged recording without one whole message.
    #[error("{place}: none of its {bytes} bytes are a whole message: there is nothing to recover")]
    NothingWhole {
        /// Where the trouble is.
        place: Place,
        /// Bytes of the file.
        bytes: u64,
    },
    /// A recording that cannot be written.
    #[error("{place}: cannot be written: {source}; check disk space and permissions")]
    Write {
        /// The file.
        place: Place,
        /// What the system says.
        source: std::io::Error,
    },
    /// A recording that another program is writing.
    #[error(
        "{place}: is being recorded to by another program; end that one, or record to another file"
    )]
    Busy {
        /// The file.
        place: Place,
    },
    /// More values than can be held in memory for a file of this size.
    #[error(
        "{place}: unpacks to more than {most_mb} MB of frames from {file_mb:.1} MB, which looks like a \
         file made to fill the memory; convert it to CSV, which takes little memory, or play it"
    )]
    TooLarge {
        /// The file.
        place: Place,
        /// What would be held.
        most_mb: u64,
        /// The file's size.
        file_mb: f64,
    },
    /// A container of records that is none, or lacks what it needs.
    #[error("{place}: {what}; {mend}")]
    Container {
        /// Where.
        place: Place,
        /// What is wrong.
        what: String,
        /// How to mend it.
        mend: &'static str,
    },
    /// Fields of a [`Recording`](crate::Recording), or slices given to a
    /// [`FrameMap`](crate::FrameMap), that do not fit each other.
    #[error("{place}: `{field}` has {found} entries, but {wanted} wanted; build it in one piece")]
    Inconsistent {
        /// The file.
        place: Place,
        /// Field of the recording.
        field: &'static str,
        /// Entries found.
        found: usize,
        /// Entries wanted.
        wanted: usize,
    },
}

/// At most 40 characters of `text` for a message.
pub(crate) fn shortened(text: &str) -> String {
    const MOST: usize = 40;
    let mut short: String = text.chars().take(MOST).collect();
    if short.len() < text.len() {
        short.push_str("...");
    }
    short
}
