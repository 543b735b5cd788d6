//! A running instrument: one reader thread, a bounded queue, reconnection.

mod reader;
mod stream;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use self::reader::Reader;
use self::stream::Stream;
use super::queue::{Overflow, Queue, Statistics};
use super::{Driver, Setup};
use crate::error::HwError;
use crate::frame::{Frame, Quadruple};
use crate::transport::{Endpoint, Link};

/// How a session runs.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionSettings {
    /// Measurements of the scene's protocol, in its order; `None` takes the instrument's own.
    pub quadruples: Option<Vec<Quadruple>>,
    /// Frames that may wait for the consumer.
    pub capacity: usize,
    /// What happens to the next one.
    pub overflow: Overflow,
    /// After so long without a byte or frame, [`Event::Stalled`] is told.
    pub stall_s: f64,
    /// How a lost instrument is looked for; `None`: the session ends.
    pub reconnect: Option<Backoff>,
}

impl Default for SessionSettings {
    /// 64 frames, keeping the latest; 2 s; reconnecting as long as it takes.
    fn default() -> Self {
        Self {
            quadruples: None,
            capacity: 64,
            overflow: Overflow::default(),
            stall_s: 2.0,
            reconnect: Some(Backoff::default()),
        }
    }
}

/// Exponential backoff: waits between attempts to reconnect, each twice the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backoff {
    /// The first wait.
    pub initial_s: f64,
    /// The longest wait.
    pub max_s: f64,
    /// Time after which the session ends with the last error; infinite: never.
    pub give_up_s: f64,
}

impl Default for Backoff {
    /// 0.1 s to 5 s, without end.
    fn default() -> Self {
        Self { initial_s: 0.1, max_s: 5.0, give_up_s: f64::INFINITY }
    }
}

impl SessionSettings {
    /// Whether the settings can be.
    ///
    /// # Errors
    /// [`HwError::Setting`] names the first that cannot.
    pub fn validate(&self) -> Result<(), HwError> {
        let positive = |name, value: f64| {
            if value > 0.0 {
                return Ok(());
            }
            Err(HwError::Setting { name, value: value.to_string(), wanted: "more than 0" })
        };
        if self.capacity == 0 || self.capacity > 1 << 20 {
            let value = self.capacity.to_string();
            return Err(HwError::Setting {
                name: "capacity",
                value,
                wanted: "1 to 1048576 frames",
            });
        }
        positive("stall_s", self.stall_s)?;
        let Some(backoff) = self.reconnect else { return Ok(()) };
        positive("reconnect.initial_s", backoff.initial_s)?;
        positive("reconnect.max_s", backoff.max_s)?;
        positive("reconnect.give_up_s", backoff.give_up_s)
    }
}

/// What a session tells.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A frame in protocol order; give it back with [`Session::recycle`] to spare an allocation.
    Frame(Frame),
    /// So many frames were lost before the next one.
    Gap {
        /// How many.
        frames: u64,
    },
    /// The instrument or driver says something.
    Notice(String),
    /// Nothing has come for so long, though the connection stands. Told once.
    Stalled {
        /// For how long.
        for_s: f64,
    },
    /// The instrument is gone; it is looked for.
    Disconnected {
        /// What happened.
        reason: String,
    },
    /// The instrument was found again and set up anew. A reference frame of another epoch does not
    /// hold: contacts and gains may have changed.
    Reconnected {
        /// The new epoch, that of the frames that follow.
        epoch: u32,
    },
}

/// A running instrument.
///
/// Dropping it stops the instrument and its thread.
#[derive(Debug)]
pub struct Session {
    queue: Arc<Queue>,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    setup: Setup,
}

impl Session {
    /// Opens the connection, sets the instrument up, starts it and a thread that reads it.
    ///
    /// # Errors
    /// [`HwError`] of the settings, the connection or the set-up; [`FrameMap::new`](crate::FrameMap::new)'s where the
    /// instrument does not measure the protocol.
    pub fn open(
        mut driver: Box<dyn Driver>,
        endpoint: &Endpoint,
        settings: SessionSettings,
    ) -> Result<Self, HwError> {
        settings.validate()?;
        let quit = Arc::new(AtomicBool::new(false));
        let mut link = Link::open_until(endpoint, Arc::clone(&quit))?;
        let setup = super::connect(&mut *driver, &mut link)?;
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
            stream,
        };
        let thread = std::thread::Builder::new()
            .name("eit-instrument".into())
            .spawn(move || reader.run(link))
            .map_err(|source| HwError::Lost { endpoint: endpoint.to_string(), source })?;
        Ok(Self { queue, quit, thread: Some(thread), setup })
    }

    /// Who it is and what it sends.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The next event; `None` where none came in time, or the session was stopped.
    ///
    /// # Errors
    /// Once, why the session has ended: [`HwError::Overflow`], [`HwError::Lost`] where it does not
    /// reconnect, [`HwError::Identity`] where another instrument answers.
    pub fn next_event(&self, timeout: Duration) -> Result<Option<Event>, HwError> {
        self.queue.next(timeout)
    }

    /// Gives a frame's memory back.
    pub fn recycle(&self, frame: Frame) {
        self.queue.recycle(frame);
    }

    /// Whether it has ended, and all that it had to tell was taken.
    pub fn is_over(&self) -> bool {
        self.queue.is_over()
    }

    /// Counts so far.
    pub fn statistics(&self) -> Statistics {
        self.queue.statistics()
    }

    /// Stops the instrument and the thread; events that wait can still be taken. Takes some tens of
    /// milliseconds, also while a lost instrument is looked for; on a TCP address that does not
    /// answer, up to a second.
    pub fn stop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // it does not panic, and if it did there is nothing more to stop
            let _ = thread.join();
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.stop();
    }
}
