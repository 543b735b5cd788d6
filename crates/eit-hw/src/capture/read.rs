//! Reading of recordings, whole or cut.

use std::collections::HashMap;
use std::path::Path;

use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use ndarray::Array2;

use super::{Entry, MAGIC, SessionRecord, Topic};
use crate::error::{HwError, Place};
use crate::frame::{Frame, Quality};
use crate::readers::Format;
use crate::recording::{Layout, Recording, Unit};

/// Longest chunk that is unpacked; the writer ends them above 1 MiB.
const MOST_CHUNK_BYTES: u64 = 64 << 20;
/// Opcode and length before each record.
const RECORD_HEAD: usize = 9;
const OP_CHUNK: u8 = 0x06;
const OP_DATA_END: u8 = 0x0F;

/// A recording that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Every message, in the order of the file.
    pub entries: Vec<Entry>,
    /// When each was logged, in nanoseconds since 1970.
    pub(super) log_times_ns: Vec<u64>,
    /// What is missing.
    pub damage: Damage,
}

/// What is missing of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// The recording was not finished: its program was killed.
    pub unfinished: bool,
    /// Bytes at the end that are no whole record.
    pub cut_bytes: usize,
    /// Chunks whose checksum or content is wrong; their messages are left out.
    pub bad_chunks: usize,
    /// Messages that cannot be read: of another version, or of a topic that was named in a bad
    /// chunk.
    pub bad_messages: usize,
}

impl Capture {
    /// The frames.
    pub fn frames(&self) -> impl Iterator<Item = &Frame> {
        self.entries.iter().filter_map(|entry| match entry {
            Entry::Frame(frame) => Some(frame),
            _ => None,
        })
    }

    /// The sessions, of which each holds for the frames after it.
    pub fn sessions(&self) -> impl Iterator<Item = &SessionRecord> {
        self.entries.iter().filter_map(|entry| match entry {
            Entry::Session(session) => Some(session),
            _ => None,
        })
    }

    /// The frames as any other recorded file. The instrument's clock is kept where it goes on
    /// through all frames, which it does not over several epochs.
    ///
    /// # Errors
    /// [`HwError::NoFrames`]; [`HwError::Container`] where frames of different sizes or sessions of
    /// different measurements follow each other.
    pub fn recording(&self, path: &Path) -> Result<Recording, HwError> {
        let place = || Place::file(path);
        let differ = |what: String| HwError::Container {
            place: place(),
            what,
            mend: "record each set-up in a file of its own",
        };
        let mut frames = self.frames().peekable();
        let Some(&first) = frames.peek() else {
            return Err(HwError::NoFrames { place: place(), skipped: 0 });
        };
        let (count, complex) = (first.values.len(), first.imaginary.is_some());
        let (mut real, mut imaginary) = (Vec::new(), Vec::new());
        let (mut quality, mut times): (Vec<Quality>, _) = (Vec::new(), Vec::new());
        for frame in frames {
            if frame.values.len() != count || frame.imaginary.is_some() != complex {
                let found = frame.values.len();
                let number = frame.sequence;
                return Err(differ(format!(
                    "frame {number} has {found} values, but those before have {count}"
                )));
            }
            real.extend(&frame.values);
            imaginary.extend(frame.imaginary.iter().flatten());
            quality.extend(&frame.quality);
            times.extend(frame.device_time_s);
        }
        let mut sessions = self.sessions();
        let session = sessions.next().cloned().unwrap_or_default();
        if let Some(other) = sessions.find(|other| other.quadruples != session.quadruples) {
            let (one, other) = (session.quadruples.len(), other.quadruples.len());
            let what = format!("sessions of {one} and {other} measurements differ in them");
            return Err(differ(what));
        }
        let named = session.quadruples.len();
        if named != 0 && named != count {
            let what = format!("frames have {count} values, but the session names {named}");
            return Err(differ(what));
        }
        let rows = real.len() / count.max(1);
        let none = |_| HwError::NoFrames { place: place(), skipped: 0 };
        let table = |values| Array2::from_shape_vec((rows, count), values).map_err(none);
        let layout = match named {
            0 => Layout::AsScene,
            _ => Layout::Quadruples(session.quadruples),
        };
        let parts = if complex { Some(table(imaginary)?) } else { None };
        let unit = Unit::from(session.unit);
        let mut recording = Recording::new(table(real)?, parts, layout, unit, Format::Mcap, path);
        recording.quality = Array2::from_shape_vec((rows, count), quality).map_err(none)?;
        let steady = times.len() == rows && times.is_sorted();
        recording.device_time_s = steady.then_some(times);
        recording.current_a = session.current_a;
        recording.frequency_hz = session.frequency_hz;
        Ok(recording)
    }
}

/// Reads a recording, whole or cut.
///
/// # Errors
/// [`HwError::Read`], and as [`parse`].
pub fn read(path: &Path) -> Result<Capture, HwError> {
    let bytes =
        std::fs::read(path).map_err(|source| HwError::Read { place: Place::file(path), source })?;
    parse(&bytes, path)
}

/// The recording of these bytes; `path` is for messages. Chunks that are whole and right are read,
/// whatever became of the rest.
///
/// # Errors
/// [`HwError::Empty`], and [`HwError::Container`] for what does not start as MCAP.
pub fn parse(bytes: &[u8], path: &Path) -> Result<Capture, HwError> {
    if bytes.is_empty() {
        return Err(HwError::Empty { place: Place::file(path) });
    }
    let start = bytes.len().min(MAGIC.len());
    if bytes[..start] != MAGIC[..start] {
        return Err(HwError::Container {
            place: Place::file(path),
            what: "is no MCAP file".into(),
            mend: "set `[recording] format` to what it is",
        });
    }
    let damage = Damage { unfinished: true, ..Damage::default() };
    let mut capture = Capture { entries: Vec::new(), log_times_ns: Vec::new(), damage };
    let mut channels = HashMap::new();
    let mut rest = &bytes[start..];
    while let Some((head, after)) = rest.split_first_chunk::<RECORD_HEAD>() {
        let [op, length @ ..] = *head;
        // what follows is the index, which repeats what is known
        if op == OP_DATA_END {
            capture.damage.unfinished = !bytes.ends_with(MAGIC) || bytes.len() < 2 * MAGIC.len();
            return Ok(capture);
        }
        let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
        let Some((body, next)) = after.split_at_checked(length) else { break };
        if op == OP_CHUNK {
            let record = &rest[..RECORD_HEAD + length];
            if !chunk(record, body, &mut channels, &mut capture) {
                capture.damage.bad_chunks += 1;
            }
        } else if let Ok(record) = mcap::parse_record(op, body) {
            take(record, &mut channels, &mut capture);
        }
        rest = next;
    }
    capture.damage.cut_bytes = rest.len();
    Ok(capture)
}

/// Takes the messages of a chunk, all or none; whether it was right.
fn chunk(
    record: &[u8],
    body: &[u8],
    channels: &mut HashMap<u16, Option<Topic>>,
    capture: &mut Capture,
) -> bool {
    // after two times; a wrong length must not ask for all memory
    let unpacked = body.get(16..24).and_then(|bytes| bytes.first_chunk::<8>());
    if unpacked.is_none_or(|bytes| u64::from_le_bytes(*bytes) > MOST_CHUNK_BYTES) {
        return false;
    }
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MOST_CHUNK_BYTES as usize);
    let (mut reader, mut left) = (LinearReader::new_with_options(options), record);
    let (entries, damage) = (capture.entries.len(), capture.damage);
    let mut is_right = true;
    while let Some(event) = reader.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(need)) => {
                let (now, after) = left.split_at(need.min(left.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                left = after;
            }
            Ok(LinearReadEvent::Record { opcode, data }) => {
                match mcap::parse_record(opcode, data) {
                    Ok(record) => take(record, channels, capture),
                    Err(_) => is_right = false,
                }
            }
            // a record alone has no end of file: only what came before it counts
            Err(_) if left.is_empty() && capture.entries.len() > entries => break,
            Err(_) => {
                is_right = false;
                break;
            }
        }
    }
    if !is_right {
        capture.entries.truncate(entries);
        capture.log_times_ns.truncate(entries);
        capture.damage = damage;
    }
    is_right
}

fn take(record: Record<'_>, channels: &mut HashMap<u16, Option<Topic>>, capture: &mut Capture) {
    match record {
        Record::Channel(channel) => {
            // others may have written topics of their own
            let topic = Topic::ALL.into_iter().find(|topic| topic.name() == channel.topic);
            channels.insert(channel.id, topic.filter(|_| channel.message_encoding == "json"));
        }
        Record::Message { header, data } => {
            let topic = match channels.get(&header.channel_id) {
                Some(Some(topic)) => Some(*topic),
                // another program's
                Some(None) => return,
                // its channel was named in a chunk that is bad
                None => None,
            };
            match topic.and_then(|topic| Entry::from_json(topic, &data)) {
                Some(entry) => {
                    capture.entries.push(entry);
                    capture.log_times_ns.push(header.log_time);
                }
                None => capture.damage.bad_messages += 1,
            }
        }
        _ => {}
    }
}
