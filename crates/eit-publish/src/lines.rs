//! Writes lines in a thread of its own.

use crate::error::PublishError;
use crate::line::EventLine;
use crate::outbox::worker::Worker;
use crate::outbox::{Next, Outbox, lock};
use crate::publisher::clock_s;
use eit_skin::eit_hw::driver::Event;
use eit_skin::text::event_text;
use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// How often the thread wakes without a line.
const TICK: Duration = Duration::from_millis(500);

/// A writer that may be slow: it costs lines of live frames, each counted, and no time.
#[derive(Debug)]
pub(crate) struct LineSink {
    pub(crate) worker: Worker,
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    is_closed: AtomicBool,
    error: Mutex<Option<io::Error>>,
}

impl LineSink {
    /// Starts the thread; `is_latest`: a reader that is behind gets the newest frame only.
    pub(crate) fn new(
        mut out: Box<dyn Write + Send>,
        is_latest: bool,
    ) -> Result<Self, PublishError> {
        let shared = Arc::new(Shared::default());
        let outbox = Arc::new(Outbox::default());
        outbox.keep_latest(is_latest);
        let seen = Arc::clone(&shared);
        let worker = Worker::start("eit lines", outbox, move |outbox| {
            if let Err(error) = write(&mut *out, outbox, is_latest) {
                seen.is_closed.store(true, Ordering::Relaxed);
                // a reader that has closed its pipe is no error
                let error = Some(error).filter(|e| e.kind() != ErrorKind::BrokenPipe);
                *lock(&seen.error) = error;
            }
        });
        Ok(Self { worker: worker.map_err(PublishError::Thread)?, shared })
    }

    /// Queues a line; returns once why writing has failed.
    pub(crate) fn line(&self, line: &[u8], is_frame: bool) -> Result<(), PublishError> {
        if self.is_closed() {
            return Ok(lock(&self.shared.error).take().map_or(Ok(()), Err)?);
        }
        self.worker.outbox.line(line, is_frame);
        Ok(())
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.shared.is_closed.load(Ordering::Relaxed)
    }
}

/// Writes until the queue has ended, each line at once; says in its place what was dropped.
fn write(out: &mut dyn Write, outbox: &Outbox, is_latest: bool) -> io::Result<()> {
    let mut told = 0;
    loop {
        let line = match outbox.next(TICK) {
            Next::Over => return Ok(()),
            Next::Line(line) => line,
            _ => continue,
        };
        let dropped = outbox.statistics().dropped_frames;
        if dropped > told && !is_latest {
            let frames = dropped - std::mem::replace(&mut told, dropped);
            let text = event_text(&Event::Skipped { frames }).unwrap_or_default();
            let (event, host_time_s) = ("skipped", Some(clock_s()));
            let frames = Some(frames);
            let skipped =
                EventLine { event, text: &text, host_time_s, frames, ..Default::default() };
            let mut skipped = serde_json::to_vec(&skipped)?;
            skipped.push(b'\n');
            out.write_all(&skipped)?;
        }
        out.write_all(&line)?;
        out.flush()?;
        outbox.recycle_line(line);
    }
}
