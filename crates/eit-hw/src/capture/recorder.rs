//! Records what a source delivers in a thread of its own, before anybody else sees it.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::entry::Entry;
use super::write::CaptureWriter;
use crate::driver::queue::{Overflow, Queue};
use crate::driver::{Event, FrameSource, Setup, Statistics};
use crate::error::HwError;
use crate::frame::Frame;

/// How often the thread looks for orders while no event comes.
const TICK: Duration = Duration::from_millis(50);

/// A source whose frames are recorded when they arrive, however slow its consumer is: beyond `capacity` waiting frames the consumer
/// skips the oldest ([`Event::Skipped`]), and the recording has them.
///
/// Dropping it stops the source and completes the recording.
#[derive(Debug)]
pub struct Recorder {
    setup: Setup,
    queue: Arc<Queue>,
    tape: Tape,
    quit: Arc<AtomicBool>,
    /// Before the first event is taken, so that a recording can begin with it.
    worker: Option<Worker>,
    thread: Option<JoinHandle<Setup>>,
}

/// Begins and ends recordings of a [`Recorder`], also while a loop has borrowed that, and adds to them what is computed from frames.
#[derive(Clone, Debug, Default)]
pub struct Tape {
    state: Arc<Mutex<TapeState>>,
}

#[derive(Debug, Default)]
struct TapeState {
    orders: VecDeque<Order>,
    is_on: bool,
    ended: Option<Result<(), HwError>>,
}

#[derive(Debug)]
enum Order {
    Begin(Box<CaptureWriter>),
    Write(Entry),
    End,
}

impl Tape {
    fn state(&self) -> MutexGuard<'_, TapeState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records from the next frame on; ends a recording that is running.
    pub fn begin(&self, writer: CaptureWriter) {
        let mut state = self.state();
        state.is_on = true;
        state.orders.push_back(Order::Begin(Box::new(writer)));
    }

    /// Adds an entry, made only if something is recorded.
    pub fn write(&self, entry: impl FnOnce() -> Entry) {
        if self.is_on() {
            let order = Order::Write(entry());
            self.state().orders.push_back(order);
        }
    }

    /// Ends the recording; [`Tape::ended`] tells when it is complete.
    pub fn end(&self) {
        self.state().orders.push_back(Order::End);
    }

    /// Whether something is recorded.
    pub fn is_on(&self) -> bool {
        self.state().is_on
    }

    /// Returns once how a recording has ended: complete, or with an error of its file, also in the middle of a run.
    pub fn ended(&self) -> Option<Result<(), HwError>> {
        self.state().ended.take()
    }
}

impl Recorder {
    /// Prepares the thread, which starts when the first event is taken. The source must not skip frames by itself ([`Overflow::Fail`](crate::driver::Overflow::Fail)); `words`
    /// describes events, which are recorded as notes.
    pub fn new(
        source: Box<dyn FrameSource + Send>,
        capacity: usize,
        words: fn(&Event) -> Option<String>,
    ) -> Self {
        let setup = source.setup().clone();
        let queue = Arc::new(Queue::new(capacity, Overflow::KeepLatest));
        let (tape, quit) = (Tape::default(), Arc::new(AtomicBool::new(false)));
        let worker = Worker {
            source,
            queue: Arc::clone(&queue),
            tape: tape.clone(),
            quit: Arc::clone(&quit),
            words,
            writer: None,
        };
        Self { setup, queue, tape, quit, worker: Some(worker), thread: None }
    }

    fn start(&mut self) -> Result<(), HwError> {
        let Some(worker) = self.worker.take() else { return Ok(()) };
        let thread = std::thread::Builder::new()
            .name("eit-recorder".into())
            .spawn(move || worker.run())
            .map_err(|source| HwError::Lost {
                endpoint: self.setup.identity.to_string(),
                source,
            })?;
        self.thread = Some(thread);
        Ok(())
    }

    /// Returns the handle of its recordings.
    pub fn tape(&self) -> Tape {
        self.tape.clone()
    }
}

impl FrameSource for Recorder {
    fn setup(&self) -> &Setup {
        &self.setup
    }

    fn next_event(&mut self, timeout: Duration) -> Result<Option<Event>, HwError> {
        self.start()?;
        self.queue.next(timeout)
    }

    fn recycle(&mut self, frame: Frame) {
        self.queue.recycle(frame);
    }

    fn statistics(&self) -> Statistics {
        self.queue.statistics()
    }

    fn frames_waiting(&self) -> usize {
        self.queue.frames_waiting()
    }

    fn is_over(&self) -> bool {
        self.queue.is_over()
    }

    /// Stops the source, and records everything that has arrived.
    fn stop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        // also one that was never asked has to complete its recording
        let _ = self.start();
        if let Some(setup) = self.thread.take().and_then(|thread| thread.join().ok()) {
            self.setup = setup;
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.stop();
    }
}

/// What the thread owns.
struct Worker {
    source: Box<dyn FrameSource + Send>,
    queue: Arc<Queue>,
    tape: Tape,
    quit: Arc<AtomicBool>,
    words: fn(&Event) -> Option<String>,
    writer: Option<CaptureWriter>,
}

impl std::fmt::Debug for Worker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Worker").field("setup", self.source.setup()).finish_non_exhaustive()
    }
}

impl Worker {
    /// Records until the source ends or the recorder is stopped; returns the last set-up.
    fn run(mut self) -> Setup {
        let mut timeout = TICK;
        let end = loop {
            if self.quit.load(Ordering::Relaxed) && !timeout.is_zero() {
                self.source.stop();
                // what has arrived can be taken at once
                timeout = Duration::ZERO;
            }
            self.follow_orders();
            match self.source.next_event(timeout) {
                Ok(Some(event)) => self.pass(event),
                Ok(None) if timeout.is_zero() || self.source.is_over() => break None,
                Ok(None) => self.write(CaptureWriter::tick),
                Err(error) => break Some(error),
            }
        };
        self.follow_orders();
        self.end();
        self.queue.end(end);
        self.source.setup().clone()
    }

    /// Records an event and passes it on.
    fn pass(&mut self, event: Event) {
        if self.writer.is_some() {
            match (&event, (self.words)(&event)) {
                (Event::Frame(frame), _) => self.write(|writer| writer.frame(frame)),
                (_, Some(words)) => self.write(|writer| writer.note(&words)),
                _ => {}
            }
        }
        self.queue.pass(event, self.source.statistics());
        while let Some(frame) = self.queue.spare() {
            self.source.recycle(frame);
        }
    }

    fn follow_orders(&mut self) {
        while let Some(order) = { self.tape.state().orders.pop_front() } {
            match order {
                Order::Begin(writer) => {
                    self.end();
                    self.writer = Some(*writer);
                    self.tape.state().is_on = true;
                }
                Order::Write(entry) => self.write(|writer| writer.write(&entry)),
                Order::End => self.end(),
            }
        }
    }

    /// Writes; a recording that fails ends.
    fn write(&mut self, what: impl FnOnce(&mut CaptureWriter) -> Result<(), HwError>) {
        if let Some(Err(error)) = self.writer.as_mut().map(what) {
            self.writer = None;
            self.tell(Err(error));
        }
    }

    fn end(&mut self) {
        if let Some(writer) = self.writer.take() {
            self.tell(writer.finish());
        }
    }

    fn tell(&self, ended: Result<(), HwError>) {
        let mut state = self.tape.state();
        (state.is_on, state.ended) = (false, Some(ended));
    }
}
