//! A running instrument: reader thread, bounded queue, reconnection.

mod reader;
mod settings;
mod silence;
mod stream;

pub use settings::{Backoff, SessionSettings};

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use self::reader::Reader;
use self::silence::Silence;
use self::stream::Stream;
use super::interface::{Driver, connect};
use super::queue::Queue;
use super::setup::Setup;
use super::source::{Event, FrameSource, Statistics};
use crate::error::HwError;
use crate::frame::Frame;
use crate::transport::{Endpoint, Link};

/// A running instrument.
///
/// Dropping it stops the instrument and the reader thread.
///
/// ```
/// use eit_hw::driver::{Board, Event, Session, SessionSettings};
/// use eit_hw::emulator::{BoardDevice, Emulator, FaultPlan, Listen};
/// use std::time::Duration;
///
/// let board = Board::preset("serial-16")?;
/// // a real board: `Endpoint::parse("/dev/ttyACM0", board.baud)?` instead of the emulator
/// let device = BoardDevice::new(board.clone(), 50.0, Box::new(|_, _, values| values.fill(0.5)));
/// let listen = Listen::Tcp("127.0.0.1:0".into());
/// let emulator = Emulator::start(Box::new(device), &listen, FaultPlan::default())?;
/// let mut session =
///     Session::open(board.driver()?, emulator.endpoint(), SessionSettings::default())?;
/// let event = session.next_event(Duration::from_secs(5))?;
/// assert!(matches!(event, Some(Event::Frame(frame)) if frame.values.len() == 208));
/// session.stop();
/// # Ok::<(), eit_hw::HwError>(())
/// ```
#[derive(Debug)]
pub struct Session {
    queue: Arc<Queue>,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    setup: Setup,
}

impl Session {
    /// Opens the connection, sets up and starts the instrument, and starts a thread that reads it.
    ///
    /// # Errors
    /// Any [`HwError`] of the settings, the connection or the set-up; those of
    /// [`FrameMap::new`](crate::FrameMap::new) if the instrument does not measure the protocol.
    pub fn open(
        mut driver: Box<dyn Driver>,
        endpoint: &Endpoint,
        settings: SessionSettings,
    ) -> Result<Self, HwError> {
        settings.validate()?;
        let quit = Arc::new(AtomicBool::new(false));
        let mut link = Link::open_until(endpoint, Arc::clone(&quit))?;
        let setup = connect(&mut *driver, &mut link)?;
        let stream = Stream::new(&setup, &settings, endpoint)?;
        driver.start(&mut link)?;
        let queue = Arc::new(Queue::new(settings.capacity, settings.overflow));
        let reader = Reader {
            driver,
            endpoint: endpoint.clone(),
            settings,
            queue: Arc::clone(&queue),
            quit: Arc::clone(&quit),
            identity: setup.identity.clone(),
            silence: Silence::new(setup.frame_rate_hz),
            lost_since: None,
            lost: 0,
            looked: None,
            stream,
        };
        let thread = std::thread::Builder::new()
            .name("eit-instrument".into())
            .spawn(move || reader.run(link))
            .map_err(|source| HwError::Lost { endpoint: endpoint.to_string(), source })?;
        Ok(Self { queue, quit, thread: Some(thread), setup })
    }

    /// Returns the instrument's identity and the format of its frames.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Waits for the next event; returns `None` if none came in time or the session was stopped.
    ///
    /// # Errors
    /// Returns once why the session ended: [`HwError::Overflow`], [`HwError::Lost`] if it does not
    /// reconnect, or [`HwError::Identity`] if another instrument answers.
    pub fn next_event(&self, timeout: Duration) -> Result<Option<Event>, HwError> {
        self.queue.next(timeout)
    }

    /// Returns a frame for reuse of its memory.
    pub fn recycle(&self, frame: Frame) {
        self.queue.recycle(frame);
    }

    /// Number of frames received but not yet taken with [`Session::next_event`].
    pub fn frames_waiting(&self) -> usize {
        self.queue.frames_waiting()
    }

    /// Returns whether the session has ended and every event was taken.
    pub fn is_over(&self) -> bool {
        self.queue.is_over()
    }

    /// Returns the counts so far.
    pub fn statistics(&self) -> Statistics {
        self.queue.statistics()
    }

    /// Stops the instrument and the thread; queued events can still be taken. Takes some tens of
    /// milliseconds, even during reconnection, or up to a second for a TCP address that does not
    /// answer.
    pub fn stop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // the thread does not panic, and if it did there would be nothing left to stop
            let _ = thread.join();
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.stop();
    }
}

impl FrameSource for Session {
    fn setup(&self) -> &Setup {
        Session::setup(self)
    }

    fn next_event(&mut self, timeout: Duration) -> Result<Option<Event>, HwError> {
        Session::next_event(self, timeout)
    }

    fn recycle(&mut self, frame: Frame) {
        Session::recycle(self, frame);
    }

    fn statistics(&self) -> Statistics {
        Session::statistics(self)
    }

    fn frames_waiting(&self) -> usize {
        Session::frames_waiting(self)
    }

    fn is_over(&self) -> bool {
        Session::is_over(self)
    }

    fn stop(&mut self) {
        Session::stop(self);
    }
}
