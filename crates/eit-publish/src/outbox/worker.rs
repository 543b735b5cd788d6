//! The thread that sends what a sink has queued, and how it ends.

use super::{Outbox, Policy};
use crate::publisher::Start;
use crate::shape::SkinShape;
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long the end waits for the sink to send what is queued.
pub(super) const LAST_MESSAGES: Duration = Duration::from_secs(2);
/// How long it then waits for what is no frame, such as the last line.
const LAST_EVENTS: Duration = Duration::from_secs(1);

/// Shortest time between two images.
const IMAGE_EVERY: Duration = Duration::from_millis(66);

/// A sink with a queue and a thread of its own.
pub(crate) trait QueuedSink {
    fn worker(&self) -> &Worker;
    fn worker_mut(&mut self) -> &mut Worker;
    /// Returns whether anybody looks at images.
    fn has_viewer(&self) -> bool;
    /// Called once before any frame, with what is going to be published.
    fn start(&self, _: &Start<'_>) {}
    /// Called with the shape of the skin when it is known.
    fn skin(&self, _: &SkinShape) {}

    /// Returns whether somebody looks at images and the last one is old enough; then the next one
    /// counts from now.
    fn is_image_due(&mut self) -> bool {
        if !self.has_viewer() {
            return false;
        }
        let last = &mut self.worker_mut().last_image;
        let is_due = last.is_none_or(|last| last.elapsed() >= IMAGE_EVERY);
        if is_due {
            *last = Some(Instant::now());
        }
        is_due
    }
}

/// Says, also if the thread panics, that nobody takes from the queue any more.
struct Done<'a>(&'a Outbox);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.state().is_done = true;
        self.0.changed.notify_all();
    }
}

/// A thread that sends what is queued.
#[derive(Debug)]
pub(crate) struct Worker {
    pub(crate) outbox: Arc<Outbox>,
    thread: Option<JoinHandle<()>>,
    last_image: Option<Instant>,
}

impl Worker {
    /// Starts a thread that runs `send` until [`Next::Over`].
    ///
    /// # Errors
    ///
    /// No thread.
    pub(crate) fn start(
        name: &str,
        outbox: Arc<Outbox>,
        send: impl FnOnce(&Outbox) + Send + 'static,
    ) -> std::io::Result<Self> {
        let queue = Arc::clone(&outbox);
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            let done = Done(&queue);
            send(&queue);
            drop(done);
        })?;
        Ok(Self { outbox, thread: Some(thread), last_image: None })
    }

    /// Ends the thread once it has sent what is queued, or after three seconds, without the frames that are left after
    /// two: a network that hangs does not hang the program. If frames wait for the sink ([`Outbox::wait_for_room`]), so
    /// does this.
    pub(crate) fn finish(&mut self) {
        let Some(thread) = self.thread.take() else { return };
        let start = Instant::now();
        let mut state = self.outbox.state();
        state.is_over = true;
        self.outbox.changed.notify_all();
        while !state.is_done {
            if state.policy != Policy::Wait && start.elapsed() >= LAST_MESSAGES {
                state.drop_frames();
                if start.elapsed() >= LAST_MESSAGES + LAST_EVENTS {
                    return;
                }
            }
            let waited = self.outbox.changed.wait_timeout(state, Duration::from_millis(50));
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        drop(state);
        // it has nothing left to do; a panic of its own is no reason for another
        let _ = thread.join();
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.finish();
    }
}
