//! The thread that reads an instrument and reconnects to it.

use eit_core::event;
use std::io::ErrorKind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::settings::SessionSettings;
use super::silence::Silence;
use super::stream::Stream;
use crate::driver::decoded::Decoded;
use crate::driver::interface::{Driver, connect};
use crate::driver::queue::Queue;
use crate::driver::setup::Identity;
use crate::driver::source::Event;
use crate::error::HwError;
use crate::transport::{Endpoint, Link};

/// Shortest time between two looks for other users of the port, which take some milliseconds.
const LOOK_EVERY: Duration = Duration::from_secs(30);

/// State of the reader thread.
pub(super) struct Reader {
    pub(super) driver: Box<dyn Driver>,
    pub(super) endpoint: Endpoint,
    pub(super) settings: SessionSettings,
    pub(super) queue: Arc<Queue>,
    pub(super) quit: Arc<AtomicBool>,
    pub(super) identity: Identity,
    pub(super) stream: Stream,
    pub(super) silence: Silence,
    /// Time of the last frame before the connection was lost, until the next frame.
    pub(super) lost_since: Option<Instant>,
    /// Number of lost frames so far.
    pub(super) lost: u64,
    /// When other users of the port were looked for last.
    pub(super) looked: Option<Instant>,
}

/// Why a connection ended.
enum End {
    Quit,
    Lost(String, HwError),
    Overflow,
}

impl Reader {
    pub(super) fn run(mut self, link: Link) {
        let ended = self.serve(link);
        self.count_disconnected(Instant::now());
        self.queue.end(ended.err());
    }

    /// Reads and reconnects until the session is stopped or fails.
    fn serve(&mut self, mut link: Link) -> Result<(), HwError> {
        loop {
            match self.follow(&mut link) {
                End::Quit => {
                    // failing to stop a device that is gone does not matter
                    let _ = self.driver.stop(&mut link);
                    return Ok(());
                }
                End::Overflow => {
                    let _ = self.driver.stop(&mut link);
                    let endpoint = self.endpoint.to_string();
                    let capacity = self.settings.capacity;
                    return Err(HwError::Overflow { endpoint, capacity });
                }
                End::Lost(reason, error) => {
                    event!(WARN, "lost the instrument", reason = reason.as_str());
                    self.queue.push(Event::Disconnected { reason });
                    drop(link);
                    self.lost_since.get_or_insert(self.silence.since());
                    match self.find_again(error)? {
                        Some(found) => link = found,
                        None => return Ok(()),
                    }
                }
            }
        }
    }

    /// Names other programs that have the port open, since they take bytes: not more often than necessary.
    fn name_other_users(&mut self, now: Instant) {
        if self.looked.is_some_and(|looked| now.duration_since(looked) < LOOK_EVERY) {
            return;
        }
        self.looked = Some(now);
        let others = self.endpoint.other_users();
        if !others.is_empty() {
            let others = others.join(", ");
            self.queue.push(Event::Notice(format!(
                "the port is also open in {others}: each byte goes to one of them; close the others"
            )));
        }
    }

    /// Whether the session was stopped.
    fn quits(&self) -> bool {
        self.quit.load(Ordering::Relaxed)
    }

    /// Reads until the connection ends.
    fn follow(&mut self, link: &mut Link) -> End {
        let mut buffer = [0; 8192];
        let mut noise = Noise::default();
        self.silence.start(Instant::now());
        while !self.quits() {
            let received = match self.driver.idle(link).and_then(|()| link.read(&mut buffer)) {
                Ok(received) => received,
                Err(_) if self.quits() => return End::Quit,
                Err(error) => return End::Lost(error.to_string(), error),
            };
            if received > 0 {
                noise.add(received);
                self.queue.count(|statistics| statistics.bytes += received as u64);
            }
            let (frames, end) = self.decode(&buffer[..received]);
            match end {
                Some(TakeEnd::Overflow) => return End::Overflow,
                Some(TakeEnd::Restarted) => {
                    return self.lost(ErrorKind::Other, "the instrument has restarted".into());
                }
                None => {}
            }
            let now = Instant::now();
            let lost = self.queue.statistics().lost;
            if std::mem::replace(&mut self.lost, lost) < lost {
                self.name_other_users(now);
            }
            if frames > 0 {
                noise = Noise::default();
                let silent_s = self.silence.frame(now);
                self.count_silence(silent_s);
                self.count_disconnected(now);
            } else if let Some(end) = self.wait(&noise, now) {
                return end;
            }
        }
        let silent_s = self.silence.end(Instant::now());
        self.count_silence(silent_s);
        End::Quit
    }

    /// Passes on what bytes decode to: the number of frames, and why the connection ends.
    fn decode(&mut self, bytes: &[u8]) -> (u32, Option<TakeEnd>) {
        let (mut frames, mut end) = (0, None);
        let (queue, stream) = (&self.queue, &mut self.stream);
        // a pause, too, says something: it ends frames of several lines
        self.driver.receive(bytes, &mut |decoded| {
            frames += u32::from(matches!(decoded, Decoded::Frame(_)));
            // what follows belongs to another connection
            if end.is_none() {
                end = take(queue, stream, decoded);
            }
        });
        (frames, end)
    }

    /// Reports a silence that begins; ends the connection once the silence is too long.
    fn wait(&mut self, noise: &Noise, now: Instant) -> Option<End> {
        if let Some(for_s) = self.silence.begins(&self.settings, now) {
            event!(WARN, "the instrument is silent", for_s = for_s);
            let bytes = noise.bytes(for_s, now);
            self.queue.push(Event::Silent { for_s, bytes });
            if bytes > 0 {
                self.name_other_users(now);
            }
            return None;
        }
        if self.settings.reconnect.is_none() || !self.silence.is_stall(&self.settings, now) {
            return None;
        }
        let for_s = self.silence.for_s(now);
        let although = match noise.bytes(for_s, now) {
            0 => String::new(),
            bytes => format!(", although {bytes} bytes came"),
        };
        let reason = format!("no frame for {for_s:.1} s{although}: setting it up again");
        let silent_s = self.silence.end(now);
        self.count_silence(silent_s);
        Some(self.lost(ErrorKind::TimedOut, reason))
    }

    /// Ends a connection that carries nothing any more.
    fn lost(&self, kind: ErrorKind, reason: String) -> End {
        let source = std::io::Error::new(kind, reason.clone());
        End::Lost(reason, HwError::Lost { endpoint: self.endpoint.to_string(), source })
    }

    /// Counts a silence, unless it is part of the time after a lost connection.
    fn count_silence(&self, silent_s: Option<f64>) {
        if let (Some(for_s), None) = (silent_s, self.lost_since) {
            self.queue.count(|statistics| statistics.silent_s += for_s);
        }
    }

    /// Counts the time after a lost connection.
    fn count_disconnected(&mut self, now: Instant) {
        if let Some(since) = self.lost_since.take() {
            let for_s = now.saturating_duration_since(since).as_secs_f64();
            self.queue.count(|statistics| statistics.disconnected_s += for_s);
        }
    }

    /// Tries to reconnect with growing waits; returns `None` if the session was stopped.
    fn find_again(&mut self, mut error: HwError) -> Result<Option<Link>, HwError> {
        let Some(backoff) = self.settings.reconnect else { return Err(error) };
        let (start, mut wait_s) = (Instant::now(), backoff.initial_s);
        let mut reported = String::new();
        loop {
            let until =
                Instant::now() + Duration::from_secs_f64(wait_s.min(backoff.max_s).min(3600.0));
            while Instant::now() < until {
                if self.quits() {
                    return Ok(None);
                }
                std::thread::sleep(Duration::from_millis(5));
            }
            match self.attempt() {
                Ok(link) => {
                    self.queue.count(|statistics| statistics.reconnections += 1);
                    event!(
                        INFO,
                        "found the instrument again",
                        epoch = self.stream.epoch,
                        after_s = start.elapsed().as_secs_f64(),
                    );
                    self.queue.push(Event::Reconnected { epoch: self.stream.epoch });
                    return Ok(Some(link));
                }
                Err(_) if self.quits() => return Ok(None),
                Err(fatal @ HwError::Identity { .. }) => return Err(fatal),
                Err(other) => {
                    // it is there, but not as it was: the user must know why it is not used
                    let reason = other.to_string();
                    let is_away = matches!(
                        other,
                        HwError::Open { .. } | HwError::Lost { .. } | HwError::NoReply { .. }
                    );
                    if !is_away && reason != reported {
                        self.queue.push(Event::Disconnected { reason: reason.clone() });
                        reported = reason;
                    }
                    error = other;
                }
            }
            if start.elapsed().as_secs_f64() > backoff.give_up_s {
                return Err(error);
            }
            wait_s = (2.0 * wait_s).min(backoff.max_s);
        }
    }

    /// Tries once to reconnect to the same instrument.
    fn attempt(&mut self) -> Result<Link, HwError> {
        let mut link = Link::open_until(&self.endpoint, Arc::clone(&self.quit))?;
        let setup = connect(&mut *self.driver, &mut link)?;
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

/// Bytes that came since the last frame.
#[derive(Default)]
struct Noise {
    bytes: u64,
    last: Option<Instant>,
}

impl Noise {
    fn add(&mut self, bytes: usize) {
        self.bytes += bytes as u64;
        self.last = Some(Instant::now());
    }

    /// Returns their number if they came until now; 0 after the rest of a frame whose sender was unplugged.
    fn bytes(&self, silent_s: f64, now: Instant) -> u64 {
        let is_recent =
            |last: Instant| now.saturating_duration_since(last).as_secs_f64() < 0.5 * silent_s;
        if self.last.is_some_and(is_recent) { self.bytes } else { 0 }
    }
}

/// Why what was decoded ends a connection.
enum TakeEnd {
    Overflow,
    Restarted,
}

/// Passes on what the driver decoded.
fn take(queue: &Queue, stream: &mut Stream, decoded: Decoded<'_>) -> Option<TakeEnd> {
    match decoded {
        Decoded::Frame(raw) => {
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
        Decoded::TruncatedFrame => {
            stream.next_sequence = stream.next_sequence.saturating_add(1);
            queue.count(|statistics| statistics.lost += 1);
            queue.push(Event::Gap { frames: 1 });
        }
        Decoded::Damaged { bytes } => queue.count(|statistics| statistics.damaged_bytes += bytes),
        Decoded::Renumbered => {
            stream.begin_epoch();
            queue.push(Event::Notice("its frame counter has restarted".to_owned()));
            queue.push(Event::Reconnected { epoch: stream.epoch });
        }
        Decoded::Notice(text) => {
            queue.push(Event::Notice(text.to_owned()));
        }
        Decoded::Restarted => return Some(TakeEnd::Restarted),
    }
    None
}
