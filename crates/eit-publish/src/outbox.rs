//! A bounded queue between the frames of a skin and a sink that may be slow: whoever fills it never waits.

#[cfg(test)]
mod tests;
pub(crate) mod worker;

use eit_skin::faults::ElectrodeFault;
use eit_skin::ndarray::ArrayView2;
use eit_skin::{SkinState, Touch, TouchFrame};
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Largest number of frames and events that wait for the sink, and the longest wait; beyond either,
/// the oldest is dropped. A sink that is fast enough on average sends every frame in spite of pauses and bursts.
const CAPACITY: usize = 4096;
const LONGEST: Duration = Duration::from_secs(4);
/// Factor per image by which the range falls after a smaller image.
const DECAY: f32 = 0.98;

/// A copy of a frame's touches.
#[derive(Debug, Clone, Default)]
pub(crate) struct FrameCopy {
    pub(crate) sequence: u64,
    pub(crate) epoch: u32,
    pub(crate) time_s: f64,
    pub(crate) host_time_s: Option<f64>,
    pub(crate) latency_s: Option<f64>,
    pub(crate) whole: bool,
    pub(crate) state: SkinState,
    pub(crate) faults: Vec<ElectrodeFault>,
    pub(crate) touches: Vec<Touch>,
}

impl FrameCopy {
    /// Copies into the memory of an earlier frame.
    fn copy_from(&mut self, frame: &TouchFrame<'_>) {
        let Self { faults, touches, .. } = std::mem::take(self);
        *self = Self {
            sequence: frame.sequence,
            epoch: frame.epoch,
            time_s: frame.time_s,
            host_time_s: frame.host_time_s,
            latency_s: frame.latency_s,
            whole: frame.whole,
            state: frame.state,
            faults,
            touches,
        };
        self.faults.clear();
        self.faults.extend_from_slice(frame.faults);
        self.touches.clear();
        self.touches.extend_from_slice(frame.touches);
    }
}

/// A copy of an image: siemens, row by row from the top, NaN outside the skin.
#[derive(Debug, Clone, Default)]
pub(crate) struct ImageCopy {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    pub(crate) values: Vec<f32>,
    /// Largest value of recent images, and at least that of the faintest touch, siemens.
    pub(crate) range: f32,
    pub(crate) host_time_s: Option<f64>,
}

/// How serious an event is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Severity {
    Information,
    Warning,
    Error,
}

/// Something that happened between frames.
#[derive(Debug, Clone)]
pub(crate) struct Incident {
    pub(crate) severity: Severity,
    pub(crate) text: String,
    /// Seconds since 1970.
    pub(crate) host_time_s: f64,
}

/// The next message for a sink.
#[derive(Debug)]
pub(crate) enum Next {
    Frame(FrameCopy),
    Image(ImageCopy),
    Incident(Incident),
    /// With its line end.
    Line(Vec<u8>),
    /// Nothing arrived in time.
    Nothing,
    /// No more messages will arrive.
    Over,
}

/// Numbers of messages offered to a sink and dropped by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct SinkStatistics {
    /// Frames offered.
    pub frames: u64,
    /// Number of frames dropped because the sink could not keep up.
    pub dropped_frames: u64,
    /// Number of other messages dropped for the same reason.
    pub dropped_events: u64,
}

#[derive(Debug)]
enum Queued {
    Frame(FrameCopy),
    Incident(Incident),
    Line { line: Vec<u8>, is_frame: bool },
}

impl Queued {
    fn is_frame(&self) -> bool {
        matches!(self, Self::Frame(_) | Self::Line { is_frame: true, .. })
    }
}

/// What becomes of frames that the sink has no time for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Policy {
    /// They wait, and the oldest are dropped.
    #[default]
    DropOldest,
    /// Only the newest waits.
    KeepLatest,
    /// Whoever fills the queue waits: for recordings, whose frames come on demand.
    Wait,
}

#[derive(Debug, Default)]
struct State {
    /// Messages, each with the time since when it waits.
    queue: VecDeque<(Instant, Queued)>,
    /// Memory of frames that were sent.
    free: Vec<FrameCopy>,
    free_lines: Vec<Vec<u8>>,
    policy: Policy,
    /// Only the latest image counts.
    image: Option<ImageCopy>,
    free_image: Option<ImageCopy>,
    host_time_s: Option<f64>,
    /// Range of the last image.
    range: f32,
    statistics: SinkStatistics,
    is_over: bool,
    is_done: bool,
}

/// The queue; both sides hold it.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    state: Mutex<State>,
    changed: Condvar,
}

/// Locks a mutex, also after a panic of who held it.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Outbox {
    fn state(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    /// Queues a frame. Allocates nothing once as many frames, with as many touches, have been
    /// queued.
    pub(crate) fn frame(&self, frame: &TouchFrame<'_>) {
        let mut state = self.state();
        state.statistics.frames += 1;
        state.host_time_s = frame.host_time_s;
        let now = state.make_room();
        let mut copy = state.free.pop().unwrap_or_default();
        copy.copy_from(frame);
        state.queue.push_back((now, Queued::Frame(copy)));
        self.changed.notify_one();
    }

    /// Queues a line.
    pub(crate) fn line(&self, line: &[u8], is_frame: bool) {
        let mut state = self.state();
        while state.policy == Policy::Wait && state.queue.len() >= CAPACITY && !state.is_done {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.statistics.frames += u64::from(is_frame);
        if is_frame && state.policy == Policy::KeepLatest {
            state.drop_frames();
        }
        let now = state.make_room();
        let mut copy = state.free_lines.pop().unwrap_or_default();
        copy.clear();
        copy.extend_from_slice(line);
        copy.push(b'\n');
        state.queue.push_back((now, Queued::Line { line: copy, is_frame }));
        self.changed.notify_all();
    }

    /// Keeps only the newest frame for a sink that is behind.
    pub(crate) fn keep_latest(&self, is_wanted: bool) {
        self.state().policy = if is_wanted { Policy::KeepLatest } else { Policy::DropOldest };
    }

    /// Makes who fills the queue wait for a sink that wants every frame.
    pub(crate) fn wait_for_room(&self) {
        let mut state = self.state();
        if state.policy == Policy::DropOldest {
            state.policy = Policy::Wait;
        }
    }

    /// Queues the image of the last frame; replaces one that was not sent yet.
    pub(crate) fn image(&self, image: ArrayView2<'_, f64>, faintest_s: f64) {
        let mut state = self.state();
        let finite = image.iter().filter(|value| value.is_finite());
        let largest = finite.fold(faintest_s, |most, value| most.max(value.abs())) as f32;
        state.range = largest.max(DECAY * state.range).max(f32::MIN_POSITIVE);
        let free = state.free_image.take();
        let mut copy = state.image.take().or(free).unwrap_or_default();
        (copy.rows, copy.columns) = image.dim();
        (copy.host_time_s, copy.range) = (state.host_time_s, state.range);
        copy.values.clear();
        copy.values.extend(image.iter().map(|&value| value as f32));
        state.image = Some(copy);
        self.changed.notify_one();
    }

    /// Queues an event.
    pub(crate) fn incident(&self, severity: Severity, text: &str) {
        let incident =
            Incident { severity, text: text.to_owned(), host_time_s: crate::publisher::clock_s() };
        let mut state = self.state();
        let now = state.make_room();
        state.queue.push_back((now, Queued::Incident(incident)));
        self.changed.notify_one();
    }

    /// Returns the next message; waits at most `timeout`.
    pub(crate) fn next(&self, timeout: Duration) -> Next {
        let end = Instant::now() + timeout;
        let mut state = self.state();
        loop {
            if let Some((_, queued)) = state.queue.pop_front() {
                self.changed.notify_all();
                return match queued {
                    Queued::Frame(frame) => Next::Frame(frame),
                    Queued::Incident(incident) => Next::Incident(incident),
                    Queued::Line { line, .. } => Next::Line(line),
                };
            }
            if let Some(image) = state.image.take() {
                return Next::Image(image);
            }
            if state.is_over {
                return Next::Over;
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Next::Nothing;
            }
            let waited = self.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Returns the memory of a sent frame.
    pub(crate) fn recycle(&self, frame: FrameCopy) {
        let mut state = self.state();
        if state.free.len() < CAPACITY {
            state.free.push(frame);
        }
    }

    /// Returns the memory of a line that was written.
    pub(crate) fn recycle_line(&self, line: Vec<u8>) {
        let mut state = self.state();
        if state.free_lines.len() < CAPACITY {
            state.free_lines.push(line);
        }
    }

    /// Returns the memory of a sent image.
    pub(crate) fn recycle_image(&self, image: ImageCopy) {
        self.state().free_image = Some(image);
    }

    /// Returns the numbers of messages offered and dropped so far.
    pub(crate) fn statistics(&self) -> SinkStatistics {
        self.state().statistics
    }
}

impl State {
    /// Drops the oldest messages if the queue is full or they have waited too long, because readers
    /// need current data. Returns the time.
    fn make_room(&mut self) -> Instant {
        let now = Instant::now();
        let is_old = |queued: &(Instant, Queued)| now.duration_since(queued.0) > LONGEST;
        while self.queue.len() >= CAPACITY
            || (self.policy != Policy::Wait && self.queue.front().is_some_and(is_old))
        {
            let Some((_, oldest)) = self.queue.pop_front() else { break };
            self.drop_one(oldest);
        }
        now
    }

    fn drop_one(&mut self, queued: Queued) {
        match queued.is_frame() {
            true => self.statistics.dropped_frames += 1,
            false => self.statistics.dropped_events += 1,
        }
        match queued {
            Queued::Frame(frame) => self.free.push(frame),
            Queued::Line { line, .. } => self.free_lines.push(line),
            Queued::Incident(_) => {}
        }
    }

    /// Drops the frames, and keeps the order of the rest.
    fn drop_frames(&mut self) {
        for _ in 0..self.queue.len() {
            let Some((since, queued)) = self.queue.pop_front() else { break };
            match queued.is_frame() {
                true => self.drop_one(queued),
                false => self.queue.push_back((since, queued)),
            }
        }
    }
}
