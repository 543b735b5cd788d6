//! Plays a recording as if it were an instrument.
//!
//! One file, because order of events, pace and mapping share the state of the replay.

use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

use super::setup::Setup;
use super::source::{Event, FrameSource, Statistics};
use crate::error::HwError;
use crate::frame::{Frame, Quadruple};
use crate::recording::FrameMap;
#[cfg(feature = "mcap")]
use {
    super::setup::{Identity, Limits},
    crate::capture::{CaptureReader, Entry, SessionRecord},
    crate::recording::{Layout, Unit},
};

/// Speed at which a recording is played.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Pace {
    /// Delivers each frame on request: as fast as the consumer, or step by step.
    #[default]
    OnDemand,
    /// A multiple of the recorded speed; 1 is real time. Timed by the instrument's clock or,
    /// without one and where it goes back or ahead by more than a minute, by the host's. Backward
    /// steps of the host's clock are ignored, and so are those above ten seconds, because the clock
    /// may have been set; so neither a wrong clock nor a long pause makes a replay wait. Frames
    /// without a time are delivered on request.
    Speed(f64),
}

/// Memory that the frames may take that are read ahead for the reference of an epoch.
const MOST_AHEAD_BYTES: usize = 8 << 20;
/// Longest step of the instrument's clock that counts as elapsed time, in seconds.
const MOST_DEVICE_STEP_S: f64 = 60.0;
/// Longest step of the host's clock that counts as elapsed time, in seconds; it was set if longer.
const MOST_HOST_STEP_S: f64 = 10.0;

/// A consumer that was busy for longer, such as with its set-up, gets what follows at the wanted speed, and no burst.
const MOST_LATE: Duration = Duration::from_millis(100);

/// Times of a frame by the instrument's and the host's clock, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Times {
    device_s: Option<f64>,
    host_s: Option<f64>,
}

impl Times {
    fn of(frame: &Frame) -> Self {
        let finite = |time_s: Option<f64>| time_s.filter(|time_s| time_s.is_finite());
        Self { device_s: finite(frame.device_time_s), host_s: finite(frame.host_time_s) }
    }

    /// Returns the time elapsed since an earlier frame; 0 if no clock shows it.
    fn since(self, before: Self) -> f64 {
        let step_s = |now: Option<f64>, before: Option<f64>, most_s| {
            now.zip(before).map(|(now, before)| now - before).filter(|s| (0.0..=most_s).contains(s))
        };
        step_s(self.device_s, before.device_s, MOST_DEVICE_STEP_S)
            .or_else(|| step_s(self.host_s, before.host_s, MOST_HOST_STEP_S))
            .unwrap_or(0.0)
    }
}

/// The events that a [`Replay`] plays.
type Events = Box<dyn Iterator<Item = Result<Event, HwError>> + Send>;

/// A recording as a [`FrameSource`]: bit-identical frames, with the recorded gaps, epochs, notes and
/// references, at any speed.
pub struct Replay {
    setup: Setup,
    events: Events,
    map: Option<FrameMap>,
    pace: Pace,
    /// When the first frame was delivered, recorded seconds since then, and times of the last frame.
    start: Option<(Instant, f64, Times)>,
    /// Events that were read and not delivered yet.
    ahead: VecDeque<Result<Event, HwError>>,
    /// Whether to deliver [`Event::Reference`].
    has_references: bool,
    last: Option<(u64, u32)>,
    statistics: Statistics,
    spare: Vec<Frame>,
    is_over: bool,
}

impl std::fmt::Debug for Replay {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Replay").field("setup", &self.setup).finish_non_exhaustive()
    }
}

impl Replay {
    /// Plays the recording at `path`, with the memory of one chunk and, at the start of each epoch, of 8 MB
    /// that are read ahead for its reference.
    ///
    /// `quadruples` are the measurements of the scene's protocol and define the order of the
    /// values; with `None`, frames are delivered as recorded.
    ///
    /// # Errors
    /// [`HwError::Setting`] for a pace that is not above 0; those of
    /// [`capture::read`](crate::capture::read) if the recording cannot be read; those of
    /// [`FrameMap::new`] if it lacks measurements of the protocol.
    #[cfg(feature = "mcap")]
    pub fn open(
        path: impl AsRef<Path>,
        quadruples: Option<&[Quadruple]>,
        pace: Pace,
    ) -> Result<Self, HwError> {
        let path = path.as_ref();
        let (session, setup) = recorded_setup(path)?;
        let place = path.to_path_buf();
        let mut reader = CaptureReader::open(path)?;
        // each run of an appended recording begins at epoch 0
        let (mut first_epoch, mut epoch, mut is_begun) = (0_u32, 0_u32, false);
        let mut is_read = false;
        let events = std::iter::from_fn(move || {
            loop {
                let event = match reader.next_entry() {
                    Err(error) => return Some(Err(error)),
                    // what is missing or damaged is known at the end only
                    Ok(None) if std::mem::replace(&mut is_read, true) => return None,
                    Ok(None) => match reader.damage().note() {
                        Some(note) => Event::Notice(note.to_string()),
                        None => return None,
                    },
                    Ok(Some(Entry::Frame(mut frame))) => {
                        frame.epoch = first_epoch.saturating_add(frame.epoch);
                        (epoch, is_begun) = (frame.epoch, true);
                        Event::Frame(frame)
                    }
                    Ok(Some(Entry::Note(text))) => Event::Notice(text),
                    Ok(Some(Entry::Session(other))) if other.quadruples != session.quadruples => {
                        return Some(Err(HwError::Container {
                            place: crate::Place::file(&place),
                            what: format!(
                                "sessions of {} and {} measurements do not match",
                                session.quadruples.len(),
                                other.quadruples.len()
                            ),
                            mend: "record each set-up in its own file",
                        }));
                    }
                    Ok(Some(Entry::Session(other))) if is_begun && !other.continues => {
                        first_epoch = epoch.saturating_add(1);
                        continue;
                    }
                    Ok(Some(Entry::Reference(taken))) if !taken.sequences.is_empty() => {
                        let epoch = first_epoch.saturating_add(taken.epoch);
                        Event::Reference { epoch, sequences: taken.sequences, until: taken.until }
                    }
                    // touches, and references whose frames are not known, are computed again
                    Ok(Some(_)) => continue,
                };
                return Some(Ok(event));
            }
        });
        let replay = Self::of_events(setup, Box::new(events), quadruples, pace, path)?;
        Ok(Self { has_references: true, ..replay })
    }

    /// Plays these frames.
    ///
    /// # Errors
    /// Those of [`open`](Self::open), except for reading.
    pub fn of_frames(
        setup: Setup,
        frames: impl Iterator<Item = Frame> + Send + 'static,
        quadruples: Option<&[Quadruple]>,
        pace: Pace,
    ) -> Result<Self, HwError> {
        let events = Box::new(frames.map(|frame| Ok(Event::Frame(frame))));
        Self::of_events(setup, events, quadruples, pace, Path::new("replay"))
    }

    fn of_events(
        setup: Setup,
        events: Events,
        quadruples: Option<&[Quadruple]>,
        pace: Pace,
        place: &Path,
    ) -> Result<Self, HwError> {
        if let Pace::Speed(times) = pace {
            let is_speed = times > 0.0 && times.is_finite();
            HwError::require(is_speed, "speed", times, "a number above 0")?;
        }
        let map = quadruples.map(|wanted| {
            FrameMap::new(&setup.layout, setup.value_count, Some(wanted), wanted.len(), place)
        });
        Ok(Self {
            setup,
            events,
            map: map.transpose()?,
            pace,
            start: None,
            ahead: VecDeque::new(),
            has_references: false,
            last: None,
            statistics: Statistics::default(),
            spare: Vec::new(),
            is_over: false,
        })
    }

    /// States the frame rate, hertz, if the recording does not: frames without times are then as far apart.
    pub fn with_frame_rate(mut self, frame_rate_hz: Option<f64>) -> Self {
        self.setup.frame_rate_hz = self.setup.frame_rate_hz.or(frame_rate_hz);
        self
    }

    /// Leaves out [`Event::Reference`]: the reference is taken again.
    pub fn without_references(mut self) -> Self {
        self.has_references = false;
        self
    }

    /// Returns the number of frames in the recorded reference of the first epoch; `None` without one, or if
    /// it is not found ahead.
    pub fn reference_frames(&mut self) -> Option<usize> {
        self.find_reference(None).map(|(sequences, _)| sequences.len())
    }

    /// Reads ahead for the reference of an epoch, or of that of the next frame.
    fn find_reference(&mut self, mut wanted: Option<u32>) -> Option<(&mut Vec<u64>, Option<u64>)> {
        let (mut bytes, mut at) = (0, 0);
        while self.has_references && bytes <= MOST_AHEAD_BYTES {
            if at == self.ahead.len() {
                self.ahead.push_back(self.events.next()?);
            }
            bytes += size_of::<Event>();
            match self.ahead.get(at)?.as_ref().ok()? {
                Event::Frame(frame) if *wanted.get_or_insert(frame.epoch) != frame.epoch => break,
                Event::Frame(frame) => {
                    let parts = frame.values.len() + frame.imaginary.as_ref().map_or(0, Vec::len);
                    bytes += 8 * parts + 2 * frame.quality.len();
                }
                Event::Reference { epoch, .. } if Some(*epoch) == wanted => {
                    return match self.ahead.get_mut(at) {
                        Some(Ok(Event::Reference { sequences, until, .. })) => {
                            Some((sequences, *until))
                        }
                        _ => None,
                    };
                }
                Event::Reference { sequences, .. } => bytes += 8 * sequences.len(),
                Event::Notice(text) => bytes += text.len(),
                _ => {}
            }
            at += 1;
        }
        None
    }

    /// Returns how long until a frame is due; zero if it is due now.
    fn due_in(&mut self, frame: &Frame) -> Duration {
        let Pace::Speed(times) = self.pace else { return Duration::ZERO };
        // pauses between runs are skipped
        if self.last.is_some_and(|(_, epoch)| epoch != frame.epoch) {
            self.start = None;
        }
        let mut now = Times::of(frame);
        if now == Times::default() {
            let rate_hz = self.setup.frame_rate_hz.filter(|hz| *hz > 0.0 && hz.is_finite());
            let Some(rate_hz) = rate_hz else { return Duration::ZERO };
            now.device_s = Some(frame.sequence as f64 / rate_hz);
        }
        let (start, since_s, before) = self.start.get_or_insert_with(|| (Instant::now(), 0.0, now));
        *since_s += now.since(*before);
        *before = now;
        let after = Duration::try_from_secs_f64(*since_s / times).unwrap_or_default();
        let late = start.elapsed().saturating_sub(after);
        if late > MOST_LATE {
            *start += late;
        }
        after.saturating_sub(start.elapsed())
    }

    /// Returns the frame in protocol order; `None` if events that its numbers imply come first.
    fn deliver(&mut self, mut frame: Frame) -> Result<Option<Event>, HwError> {
        let epoch = frame.epoch;
        let news = match self.last.replace((frame.sequence, epoch)) {
            Some((sequence, before)) if before == epoch => {
                let frames = frame.sequence.saturating_sub(sequence).saturating_sub(1);
                self.statistics.lost = self.statistics.lost.saturating_add(frames);
                [(frames > 0).then_some(Event::Gap { frames }), None]
            }
            before => {
                self.statistics.reconnections += u32::from(before.is_some());
                // what remains in its place is empty
                let named = self.find_reference(Some(epoch)).map(|(named, until)| {
                    Event::Reference { epoch, sequences: std::mem::take(named), until }
                });
                [before.map(|_| Event::Reconnected { epoch }), named]
            }
        };
        if news.iter().any(Option::is_some) {
            self.ahead.push_front(Ok(Event::Frame(frame)));
            news.into_iter().rev().flatten().for_each(|event| self.ahead.push_front(Ok(event)));
            return Ok(None);
        }
        if let Some(map) = &self.map {
            let mut mapped = self.spare.pop().unwrap_or_else(|| frame.clone());
            map.apply_to(&frame, &mut mapped)?;
            (mapped.sequence, mapped.epoch) = (frame.sequence, frame.epoch);
            mapped.device_time_s = frame.device_time_s;
            mapped.host_time_s = frame.host_time_s;
            frame = mapped;
        }
        self.statistics.frames += 1;
        self.statistics.flagged +=
            u64::from(frame.quality.iter().any(|quality| !quality.is_good()));
        Ok(Some(Event::Frame(frame)))
    }
}

impl FrameSource for Replay {
    fn setup(&self) -> &Setup {
        &self.setup
    }

    fn next_event(&mut self, timeout: Duration) -> Result<Option<Event>, HwError> {
        loop {
            let Some(event) = self.ahead.pop_front().or_else(|| self.events.next()) else {
                self.is_over = true;
                return Ok(None);
            };
            let frame = match event.inspect_err(|_| self.is_over = true)? {
                Event::Frame(frame) => frame,
                Event::Reference { epoch, sequences, until } => {
                    // a recording may begin later than the reference it holds: that is no loss, and no pause
                    self.last = self.last.map(|(_, epoch)| (u64::MAX, epoch));
                    self.start = None;
                    if sequences.is_empty() || !self.has_references {
                        continue;
                    }
                    return Ok(Some(Event::Reference { epoch, sequences, until }));
                }
                event => return Ok(Some(event)),
            };
            let wait = self.due_in(&frame);
            std::thread::sleep(wait.min(timeout));
            if wait > timeout {
                self.ahead.push_front(Ok(Event::Frame(frame)));
                return Ok(None);
            }
            if let Some(frame) = self.deliver(frame)? {
                return Ok(Some(frame));
            }
        }
    }

    fn recycle(&mut self, frame: Frame) {
        // only a map needs a frame besides the one that was read
        if self.map.is_some() && self.spare.len() < 2 {
            self.spare.push(frame);
        }
    }

    fn statistics(&self) -> Statistics {
        self.statistics
    }

    fn is_over(&self) -> bool {
        self.is_over
    }
}

/// Reads up to the first frame, for the session and the number of values.
#[cfg(feature = "mcap")]
fn recorded_setup(path: &Path) -> Result<(SessionRecord, Setup), HwError> {
    let mut reader = CaptureReader::open(path)?;
    let mut session = SessionRecord::default();
    let first = loop {
        match reader.next_entry()? {
            Some(Entry::Frame(frame)) => break frame,
            Some(Entry::Session(found)) => session = found,
            Some(_) => {}
            None => return Err(HwError::NoFrames { place: crate::Place::file(path), skipped: 0 }),
        }
    };
    let layout = match session.quadruples.is_empty() {
        true => Layout::ProtocolOrder,
        false => Layout::Quadruples(session.quadruples.clone()),
    };
    let setup = Setup {
        identity: Identity::one_line("replay", &session.instrument, &session.serial),
        layout,
        value_count: first.values.len(),
        complex: first.imaginary.is_some(),
        unit: Unit::from(session.unit),
        frame_rate_hz: session.frame_rate_hz,
        limits: Limits::default(),
    };
    Ok((session, setup))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Clocks that go back, jump to another century or stand still neither stop a replay nor let it run
    /// ahead while the other clock is right.
    #[test]
    fn wrong_clocks_do_not_make_a_replay_wait() {
        let times = |device_s, host_s| Times { device_s, host_s };
        let both = |device_s: f64, host_s: f64| times(Some(device_s), Some(host_s));
        for (before, now, wanted_s) in [
            (both(5.0, 100.0), both(5.01, 100.02), 0.01),
            // a pause of the instrument counts, also where the host's clock was set
            (both(5.0, 100.0), both(45.0, 7.0), 40.0),
            // the instrument's clock is wrong: the host's counts
            (both(5.0, 100.0), both(1e9, 100.5), 0.5),
            (both(5.0, 100.0), both(4.99, 100.5), 0.5),
            (both(5.0, 100.0), both(1e308, 100.5), 0.5),
            // both are
            (both(5.0, 100.0), both(1e9, 1e9), 0.0),
            (both(5.0, 100.0), both(-1e9, -1e9), 0.0),
            // one of them is missing
            (times(None, Some(100.0)), times(None, Some(100.5)), 0.5),
            (times(None, Some(100.0)), times(None, Some(3700.0)), 0.0),
            (times(Some(5.0), None), times(Some(5.5), None), 0.5),
            (times(Some(5.0), None), times(None, Some(7.0)), 0.0),
        ] {
            let found_s = now.since(before);
            assert!((found_s - wanted_s).abs() < 1e-9, "{before:?} {now:?}: {found_s}");
        }
    }
}
