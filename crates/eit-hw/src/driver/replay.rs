//! Plays a recording as if it were an instrument.

pub(super) mod pace;
#[cfg(feature = "mcap")]
mod recorded;

use std::collections::VecDeque;
use std::path::Path;
use std::time::Duration;

use self::pace::{Clock, Pace};
use super::setup::Setup;
use super::source::{Event, FrameSource, Statistics};
use crate::error::HwError;
use crate::frame::{Frame, Quadruple};
use crate::recording::FrameMap;

/// Memory that the frames may take that are read ahead for the reference of an epoch.
const MOST_AHEAD_BYTES: usize = 8 << 20;
/// The events that a [`Replay`] plays.
type Events = Box<dyn Iterator<Item = Result<Event, HwError>> + Send>;

/// A recording as a [`FrameSource`]: bit-identical frames, with the recorded gaps, epochs, notes and
/// references, at any speed.
pub struct Replay {
    setup: Setup,
    events: Events,
    map: Option<FrameMap>,
    clock: Clock,
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

    /// Plays these events. `place` is named where measurements of the protocol are missing.
    fn of_events(
        setup: Setup,
        events: Events,
        quadruples: Option<&[Quadruple]>,
        pace: Pace,
        place: &Path,
    ) -> Result<Self, HwError> {
        let clock = Clock::new(pace)?;
        let map = quadruples.map(|wanted| {
            FrameMap::new(&setup.layout, setup.value_count, Some(wanted), wanted.len(), place)
        });
        Ok(Self {
            setup,
            events,
            map: map.transpose()?,
            clock,
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
                    self.clock.restart();
                    if sequences.is_empty() || !self.has_references {
                        continue;
                    }
                    return Ok(Some(Event::Reference { epoch, sequences, until }));
                }
                event => return Ok(Some(event)),
            };
            // pauses between runs are skipped
            if self.last.is_some_and(|(_, epoch)| epoch != frame.epoch) {
                self.clock.restart();
            }
            let wait = self.clock.due_in(&frame, self.setup.frame_rate_hz);
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
