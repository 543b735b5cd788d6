//! A running instrument: one reader thread, a bounded queue, reconnection.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::quality::Marker;
use super::queue::{Overflow, Queue, Statistics};
use super::{Driver, Found, Identity, RawFrame, Setup};
use crate::error::HwError;
use crate::frame::{Frame, Quadruple, Quality};
use crate::recording::{FrameMap, Projection};
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

/// Waits between attempts to find an instrument again: each is twice the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backoff {
    /// The first wait.
    pub first_s: f64,
    /// The longest.
    pub most_s: f64,
    /// After so long the session ends with the last error; infinite: never.
    pub give_up_s: f64,
}

impl Default for Backoff {
    /// 0.1 s to 5 s, without end.
    fn default() -> Self {
        Self { first_s: 0.1, most_s: 5.0, give_up_s: f64::INFINITY }
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
        positive("reconnect.first_s", backoff.first_s)?;
        positive("reconnect.most_s", backoff.most_s)?;
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
    /// [`HwError`] of the settings, the connection or the set-up; [`FrameMap::new`]'s where the
    /// instrument does not measure the protocol.
    pub fn open(
        mut driver: Box<dyn Driver>,
        endpoint: &Endpoint,
        settings: SessionSettings,
    ) -> Result<Self, HwError> {
        settings.validate()?;
        let mut link = Link::open(endpoint)?;
        let setup = driver.connect(&mut link)?;
        let stream = Stream::new(&setup, &settings, endpoint)?;
        driver.start(&mut link)?;
        let queue = Arc::new(Queue::new(settings.capacity, settings.overflow));
        let quit = Arc::new(AtomicBool::new(false));
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

    /// Counts so far.
    pub fn statistics(&self) -> Statistics {
        self.queue.statistics()
    }

    /// Stops the instrument and the thread; events that wait can still be taken.
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

/// Raw frames to frames in protocol order.
struct Stream {
    map: Option<FrameMap>,
    marker: Marker,
    value_count: usize,
    complex: bool,
    /// The counter and clock of the epoch's first frame.
    first: Option<(Option<u64>, Option<f64>)>,
    epoch: u32,
    next_sequence: u64,
    /// Sequence of the epoch's first frame.
    base: u64,
}

impl Stream {
    fn new(
        setup: &Setup,
        settings: &SessionSettings,
        endpoint: &Endpoint,
    ) -> Result<Self, HwError> {
        let map = match &settings.quadruples {
            None => None,
            Some(wanted) => {
                let name = endpoint.to_string();
                let source = Path::new(&name);
                let count = wanted.len();
                Some(FrameMap::new(&setup.layout, setup.value_count, Some(wanted), count, source)?)
            }
        };
        Ok(Self {
            map,
            marker: Marker::new(setup.limits, setup.value_count),
            value_count: setup.value_count,
            complex: setup.complex,
            first: None,
            epoch: 0,
            next_sequence: 0,
            base: 0,
        })
    }

    /// After a reconnection.
    fn renew(&mut self, setup: &Setup) {
        self.marker = Marker::new(setup.limits, setup.value_count);
        self.first = None;
        self.epoch = self.epoch.saturating_add(1);
        self.base = self.next_sequence;
    }

    /// The frame, and how many were lost before it; `None` where it does not fit the set-up.
    fn frame(&mut self, raw: &RawFrame<'_>, spare: Option<Frame>) -> Option<(Frame, u64)> {
        if raw.values.len() != self.value_count
            || raw.imaginary.len() != if self.complex { self.value_count } else { 0 }
        {
            return None;
        }
        let host_time_s =
            SystemTime::now().duration_since(UNIX_EPOCH).ok().map(|time| time.as_secs_f64());
        self.marker.mark(raw);
        let count = self.map.as_ref().map_or(self.value_count, FrameMap::measurements);
        let mut frame = spare.unwrap_or_else(|| Frame {
            values: vec![0.0; count],
            imaginary: self.complex.then(|| vec![0.0; count]),
            quality: vec![Quality::GOOD; count],
            sequence: 0,
            epoch: 0,
            device_time_s: None,
            host_time_s: None,
        });
        // a frame that somebody else built may have another size
        frame.values.resize(count, 0.0);
        frame.quality.resize(count, Quality::GOOD);
        if self.complex {
            frame.imaginary.get_or_insert_default().resize(count, 0.0);
        } else {
            frame.imaginary = None;
        }
        self.write(raw, &mut frame)?;
        let &mut (first_count, first_time) =
            self.first.get_or_insert((raw.counter, raw.device_time_s));
        let sequence = match (raw.counter, first_count) {
            (Some(counter), Some(first)) => {
                self.base.saturating_add(counter.saturating_sub(first)).max(self.next_sequence)
            }
            _ => self.next_sequence,
        };
        let lost = sequence - self.next_sequence;
        self.next_sequence = sequence.saturating_add(1);
        frame.sequence = sequence;
        frame.epoch = self.epoch;
        frame.device_time_s = raw.device_time_s.zip(first_time).map(|(now, first)| now - first);
        frame.host_time_s = host_time_s;
        Some((frame, lost))
    }

    fn write(&self, raw: &RawFrame<'_>, frame: &mut Frame) -> Option<()> {
        let quality = &self.marker.quality;
        let Some(map) = &self.map else {
            frame.values.copy_from_slice(raw.values);
            frame.quality.copy_from_slice(quality);
            if let Some(imaginary) = &mut frame.imaginary {
                imaginary.copy_from_slice(raw.imaginary);
            }
            return Some(());
        };
        let parts = self.complex.then_some(raw.imaginary);
        let (values, flags) = (&mut frame.values, &mut frame.quality);
        map.apply_into(raw.values, parts, quality, Projection::Real, values, flags).ok()?;
        if let Some(imaginary) = &mut frame.imaginary {
            let projection = Projection::Imaginary;
            map.apply_into(raw.values, parts, quality, projection, imaginary, flags).ok()?;
        }
        Some(())
    }
}

/// What the thread owns.
struct Reader {
    driver: Box<dyn Driver>,
    endpoint: Endpoint,
    settings: SessionSettings,
    queue: Arc<Queue>,
    quit: Arc<AtomicBool>,
    identity: Identity,
    stream: Stream,
}

/// Why a connection is over.
enum End {
    Quit,
    Lost(String, HwError),
    Overflow,
}

impl Reader {
    fn run(mut self, mut link: Link) {
        loop {
            match self.follow(&mut link) {
                End::Quit => {
                    // a device that is gone need not be stopped
                    let _ = self.driver.stop(&mut link);
                    return self.queue.end(None);
                }
                End::Overflow => {
                    let _ = self.driver.stop(&mut link);
                    let endpoint = self.endpoint.to_string();
                    let capacity = self.settings.capacity;
                    return self.queue.end(Some(HwError::Overflow { endpoint, capacity }));
                }
                End::Lost(reason, error) => {
                    self.queue.push(Event::Disconnected { reason });
                    drop(link);
                    match self.find_again(error) {
                        Ok(Some(found)) => link = found,
                        Ok(None) => return self.queue.end(None),
                        Err(error) => return self.queue.end(Some(error)),
                    }
                }
            }
        }
    }

    fn quits(&self) -> bool {
        self.quit.load(Ordering::Relaxed)
    }

    /// Reads until the connection is over.
    fn follow(&mut self, link: &mut Link) -> End {
        let mut buffer = [0; 8192];
        let (mut last, mut stalled) = (Instant::now(), false);
        while !self.quits() {
            let received = match self.driver.idle(link).and_then(|()| link.read(&mut buffer)) {
                Ok(received) => received,
                Err(error) => return End::Lost(error.to_string(), error),
            };
            let (mut frames, mut end) = (0, None);
            let (queue, stream) = (&self.queue, &mut self.stream);
            if received > 0 {
                queue.count(|statistics| statistics.bytes += received as u64);
                self.driver.receive(&buffer[..received], &mut |found| {
                    frames += u32::from(matches!(found, Found::Frame(_)));
                    end = end.take().or(take(queue, stream, found));
                });
            }
            match end {
                Some(TakeEnd::Overflow) => return End::Overflow,
                Some(TakeEnd::Restarted) => {
                    let source = std::io::Error::other("the instrument has restarted");
                    let endpoint = self.endpoint.to_string();
                    let error = HwError::Lost { endpoint, source };
                    return End::Lost("the instrument has restarted".into(), error);
                }
                None => {}
            }
            if frames > 0 {
                (last, stalled) = (Instant::now(), false);
            } else if !stalled && last.elapsed().as_secs_f64() > self.settings.stall_s {
                stalled = true;
                self.queue.push(Event::Stalled { for_s: last.elapsed().as_secs_f64() });
            }
        }
        End::Quit
    }

    /// Looks for the instrument with growing waits; `None` where the session was stopped.
    fn find_again(&mut self, mut error: HwError) -> Result<Option<Link>, HwError> {
        let Some(backoff) = self.settings.reconnect else { return Err(error) };
        let (start, mut wait_s) = (Instant::now(), backoff.first_s);
        loop {
            let until =
                Instant::now() + Duration::from_secs_f64(wait_s.min(backoff.most_s).min(3600.0));
            while Instant::now() < until {
                if self.quits() {
                    return Ok(None);
                }
                std::thread::sleep(Duration::from_millis(5));
            }
            match self.attempt() {
                Ok(link) => {
                    self.queue.count(|statistics| statistics.reconnections += 1);
                    self.queue.push(Event::Reconnected { epoch: self.stream.epoch });
                    return Ok(Some(link));
                }
                Err(fatal @ HwError::Identity { .. }) => return Err(fatal),
                Err(other) => error = other,
            }
            if start.elapsed().as_secs_f64() > backoff.give_up_s {
                return Err(error);
            }
            wait_s = (2.0 * wait_s).min(backoff.most_s);
        }
    }

    fn attempt(&mut self) -> Result<Link, HwError> {
        let mut link = Link::open(&self.endpoint)?;
        let setup = self.driver.connect(&mut link)?;
        if setup.identity != self.identity {
            return Err(HwError::Identity {
                endpoint: self.endpoint.to_string(),
                wanted: self.identity.to_string(),
                found: setup.identity.to_string(),
            });
        }
        self.driver.start(&mut link)?;
        self.stream.renew(&setup);
        Ok(link)
    }
}

enum TakeEnd {
    Overflow,
    Restarted,
}

/// Takes one thing that the driver found.
fn take(queue: &Queue, stream: &mut Stream, found: Found<'_>) -> Option<TakeEnd> {
    match found {
        Found::Frame(raw) => {
            let Some((frame, lost)) = stream.frame(&raw, queue.spare()) else {
                queue.count(|statistics| statistics.lost += 1);
                queue.push(Event::Gap { frames: 1 });
                return None;
            };
            if lost > 0 {
                queue.count(|statistics| statistics.lost += lost);
                queue.push(Event::Gap { frames: lost });
            }
            return (!queue.push(Event::Frame(frame))).then_some(TakeEnd::Overflow);
        }
        Found::Cut => {
            stream.next_sequence = stream.next_sequence.saturating_add(1);
            queue.count(|statistics| statistics.lost += 1);
            queue.push(Event::Gap { frames: 1 });
        }
        Found::Damaged { bytes } => queue.count(|statistics| statistics.damaged_bytes += bytes),
        Found::Notice(text) => {
            queue.push(Event::Notice(text.to_owned()));
        }
        Found::Restarted => return Some(TakeEnd::Restarted),
    }
    None
}
