//! The queue between the reader thread and the consumer.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::source::{Event, Statistics};
use crate::error::HwError;
use crate::frame::Frame;

/// What happens when the consumer is slower than the instrument.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Overflow {
    /// Drops the oldest frame, counts it, and reports it in its place ([`Event::Skipped`]): for a robot,
    /// which needs current data.
    #[default]
    KeepLatest,
    /// Ends the session with [`HwError::Overflow`]: for a recorder, which must not lose a frame.
    Fail,
}

#[derive(Debug)]
pub(crate) struct Queue {
    state: Mutex<State>,
    news: Condvar,
    overflow: Overflow,
}

#[derive(Debug, Default)]
struct State {
    events: VecDeque<Event>,
    frames: usize,
    /// Maximum number of frames.
    capacity: usize,
    /// Frames whose memory can be reused.
    spare: Vec<Frame>,
    statistics: Statistics,
    /// Why the reader thread has ended.
    end: Option<HwError>,
    ended: bool,
}

impl State {
    /// Drops the frame that has waited longest; one event in its place counts all that are dropped in a row.
    /// Returns whether there was one.
    fn skip_oldest(&mut self) -> bool {
        let is_frame = |event: &Event| matches!(event, Event::Frame(_));
        let Some(oldest) = self.events.iter().position(is_frame) else { return false };
        let before = oldest.checked_sub(1).and_then(|before| self.events.get_mut(before));
        let frame = match before {
            Some(Event::Skipped { frames }) => {
                *frames += 1;
                self.events.remove(oldest)
            }
            _ => {
                let skipped = Event::Skipped { frames: 1 };
                self.events.get_mut(oldest).map(|slot| std::mem::replace(slot, skipped))
            }
        };
        let Some(Event::Frame(frame)) = frame else { return false };
        if self.spare.len() < self.capacity + 2 {
            self.spare.push(frame);
        }
        self.frames -= 1;
        self.statistics.dropped += 1;
        true
    }
}

impl Queue {
    pub(crate) fn new(capacity: usize, overflow: Overflow) -> Self {
        let state = State {
            // frames, and as many other events
            events: VecDeque::with_capacity(2 * capacity + 16),
            spare: Vec::with_capacity(capacity + 2),
            capacity,
            ..State::default()
        };
        Self { state: Mutex::new(state), news: Condvar::new(), overflow }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // nothing panics while it holds the lock
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn count(&self, change: impl FnOnce(&mut Statistics)) {
        change(&mut self.state().statistics);
    }

    pub(crate) fn statistics(&self) -> Statistics {
        self.state().statistics
    }

    /// Returns a recycled frame to fill, if there is one.
    pub(crate) fn spare(&self) -> Option<Frame> {
        self.state().spare.pop()
    }

    pub(crate) fn recycle(&self, frame: Frame) {
        let mut state = self.state();
        if state.spare.len() < state.capacity + 2 {
            state.spare.push(frame);
        }
    }

    /// Adds an event of a source that has these counts.
    #[cfg(feature = "mcap")]
    pub(crate) fn pass(&self, event: Event, counts: Statistics) {
        self.push(event);
        let mut state = self.state();
        state.statistics = Statistics { dropped: state.statistics.dropped, ..counts };
    }

    /// Adds an event; returns whether there was room.
    pub(crate) fn push(&self, event: Event) -> bool {
        let mut state = self.state();
        if let Event::Frame(frame) = &event {
            state.statistics.frames += 1;
            state.statistics.flagged +=
                u64::from(frame.quality.iter().any(|quality| !quality.is_good()));
            if state.frames >= state.capacity && self.overflow == Overflow::Fail {
                return false;
            }
            // more than one after the capacity was lowered
            while state.frames >= state.capacity && state.skip_oldest() {}
            state.frames += 1;
        } else if state.events.len() >= 2 * state.capacity + 16 {
            // unread messages must not fill the memory; frames are limited above
            let oldest = state
                .events
                .iter()
                .position(|event| matches!(event, Event::Notice(_) | Event::Gap { .. }));
            if let Some(oldest) = oldest {
                state.events.remove(oldest);
            }
        }
        state.events.push_back(event);
        drop(state);
        self.news.notify_all();
        true
    }

    /// Number of frames received but not yet taken.
    pub(crate) fn frames_waiting(&self) -> usize {
        self.state().frames
    }

    /// Marks the reader thread as ended.
    pub(crate) fn end(&self, error: Option<HwError>) {
        let mut state = self.state();
        state.end = error;
        state.ended = true;
        drop(state);
        self.news.notify_all();
    }

    /// Returns whether the thread has ended and no event is left.
    pub(crate) fn is_over(&self) -> bool {
        let state = self.state();
        state.ended && state.end.is_none() && state.events.is_empty()
    }

    /// Waits for the next event; returns `None` after `timeout`, or at once if the thread has ended
    /// and no event is left.
    pub(crate) fn next(&self, timeout: Duration) -> Result<Option<Event>, HwError> {
        let start = Instant::now();
        let mut state = self.state();
        loop {
            if let Some(event) = state.events.pop_front() {
                state.frames -= usize::from(matches!(event, Event::Frame(_)));
                return Ok(Some(event));
            }
            if state.ended {
                return state.end.take().map_or(Ok(None), Err);
            }
            let Some(left) = timeout.checked_sub(start.elapsed()).filter(|left| !left.is_zero())
            else {
                return Ok(None);
            };
            state = self.news.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}
