//! The server: accepts browsers and broadcasts lines to them.

use super::connection::answer;
use super::recorder::{Recorder, Recording, RecordingEvent};
use super::request::Access;
use crate::error::PublishError;
use crate::outbox::lock;
use crate::shape::SkinShape;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs as _, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Maximum number of browsers.
const MOST_BROWSERS: usize = 16;
/// Maximum number of connections of any kind; each has a thread.
const MOST_CONNECTIONS: usize = 64;
/// Pause after a failed accept (for example no file handles left), which would otherwise fail again at once.
const AFTER_FAILURE: Duration = Duration::from_millis(50);
/// Lines queued per browser; a slower browser misses some.
const WAITING_LINES: usize = 64;
/// Shortest mean time between frames or images; the eye sees no more.
const FRAME_EVERY: Duration = Duration::from_micros(33_333);
const IMAGE_EVERY: Duration = FRAME_EVERY;
/// Maximum number of frames that are sent at once after a delay.
const LATE_FRAMES: u32 = 4;
/// How long shutdown waits for the last lines to be sent.
const LAST_LINES: Duration = Duration::from_millis(300);

pub(super) type Line = Arc<[u8]>;

/// Serves the page until it is dropped.
#[derive(Debug)]
pub struct WebServer {
    shared: Arc<Shared>,
    address: SocketAddr,
    next_frame: Option<Instant>,
    next_image: Option<Instant>,
}

/// State shared by the server's threads.
#[derive(Debug)]
pub(super) struct Shared {
    pub(crate) access: Access,
    /// Present if the page can record.
    pub(crate) recorder: Option<Recorder>,
    /// First line for every browser: the skin, once it is known.
    skin: Mutex<Option<Line>>,
    /// Last event, until a frame follows: what a browser that connects now waits for.
    event: Mutex<Option<Line>>,
    browsers: Mutex<Vec<Browser>>,
    /// Number of threads that still send to a browser.
    sending: AtomicUsize,
    connections: AtomicUsize,
    is_over: AtomicBool,
}

/// A connected browser, identified by its number.
#[derive(Debug)]
struct Browser {
    number: usize,
    lines: SyncSender<Line>,
}

/// A browser's slot, freed on drop.
pub(super) struct BrowserSlot<'a> {
    shared: &'a Shared,
    number: usize,
    pub(crate) lines: Receiver<Line>,
}

impl Drop for BrowserSlot<'_> {
    fn drop(&mut self) {
        self.shared.browsers().retain(|browser| browser.number != self.number);
        self.shared.sending.fetch_sub(1, Ordering::Relaxed);
    }
}

/// One of the allowed connections, released on drop.
struct Connection(Arc<Shared>);

impl Connection {
    /// Returns `None` if the maximum is reached.
    fn new(shared: &Arc<Shared>) -> Option<Self> {
        // counted first: if rejected, dropping it decrements the count again
        let before = shared.connections.fetch_add(1, Ordering::Relaxed);
        let connection = Self(Arc::clone(shared));
        (before < MOST_CONNECTIONS).then_some(connection)
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.0.connections.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Shared {
    fn browsers(&self) -> MutexGuard<'_, Vec<Browser>> {
        lock(&self.browsers)
    }

    /// Reserves a slot for a browser; returns `None` if all are taken.
    pub(super) fn place(&self) -> Option<BrowserSlot<'_>> {
        let mut browsers = self.browsers();
        if browsers.len() >= MOST_BROWSERS {
            return None;
        }
        let number = (0..).find(|number| browsers.iter().all(|other| other.number != *number))?;
        let (sender, lines) = sync_channel(WAITING_LINES);
        browsers.push(Browser { number, lines: sender });
        self.sending.fetch_add(1, Ordering::Relaxed);
        Some(BrowserSlot { shared: self, number, lines })
    }

    /// Returns the first messages for a browser: the skin, the state of the recording, and what is being waited
    /// for, as far as known.
    pub(super) fn greeting(&self) -> impl Iterator<Item = Line> {
        let recording = self.recorder.as_ref().and_then(Recorder::state);
        [lock(&self.skin).clone(), recording, lock(&self.event).clone()].into_iter().flatten()
    }
}

impl WebServer {
    /// Starts a server at HOST:PORT (port 0: any free port). Any address but loopback requires the token in
    /// [`WebServer::url`].
    ///
    /// # Errors
    ///
    /// An invalid address or one in use; no random numbers for a token.
    pub fn new(address: &str) -> Result<Self, PublishError> {
        Self::start(address, false)
    }

    /// Starts a server whose page can start and stop a recording; whoever knows the token in [`WebServer::url`] may do
    /// so. The program acts on [`Publisher::recording_request`](crate::Publisher::recording_request).
    ///
    /// # Errors
    ///
    /// Those of [`WebServer::new`].
    pub fn with_recording(address: &str) -> Result<Self, PublishError> {
        Self::start(address, true)
    }

    fn start(address: &str, can_record: bool) -> Result<Self, PublishError> {
        let refuse = |error| PublishError::Address { address: address.to_owned(), error };
        let found = address.to_socket_addrs().map_err(refuse)?.next();
        let found = found.ok_or_else(|| refuse(io::ErrorKind::NotFound.into()))?;
        let token = token().map_err(|error| refuse(io::Error::other(error)))?;
        let recorder = can_record.then(|| Recorder::new(token.clone()));
        let access = if found.ip().is_loopback() { Access::Loopback } else { Access::Token(token) };
        let listener = TcpListener::bind(found).map_err(refuse)?;
        let shared = Arc::new(Shared {
            access,
            recorder,
            skin: Mutex::default(),
            event: Mutex::default(),
            browsers: Mutex::default(),
            sending: AtomicUsize::new(0),
            connections: AtomicUsize::new(0),
            is_over: AtomicBool::new(false),
        });
        let address = listener.local_addr().map_err(refuse)?;
        let serving = Arc::clone(&shared);
        std::thread::Builder::new()
            .name("eit page".to_owned())
            .spawn(move || listen(&listener, &serving))
            .map_err(refuse)?;
        Ok(Self { shared, address, next_frame: None, next_image: None })
    }

    /// Address to open in a browser, also of another computer if it may ask.
    pub fn url(&self) -> String {
        let address = reachable(self.address);
        match (&self.shared.access, &self.shared.recorder) {
            (Access::Token(token), _) | (_, Some(Recorder { token, .. })) => {
                format!("http://{address}/?token={token}")
            }
            (Access::Loopback, None) => format!("http://{address}/"),
        }
    }

    /// Returns the request of the page since the last call: true to start a recording, false to
    /// stop it.
    pub(crate) fn recording_request(&self) -> Option<bool> {
        self.shared.recorder.as_ref()?.take()
    }

    /// Passes the state of the recording to every page, now and later.
    pub(crate) fn recording(&self, recording: Recording<'_>) -> Result<(), PublishError> {
        let Some(recorder) = &self.shared.recorder else { return Ok(()) };
        let line = serde_json::to_vec(&RecordingEvent { recording })?;
        recorder.set(line[..].into());
        self.tell(&line);
        Ok(())
    }

    /// Sets the skin that the page draws.
    ///
    /// # Errors
    ///
    /// A shape that cannot be encoded as JSON.
    pub(crate) fn skin(&self, shape: &SkinShape) -> Result<(), PublishError> {
        let line = serde_json::to_vec(shape)?;
        *lock(&self.shared.skin) = Some(line[..].into());
        // browsers that are already connected
        self.tell(&line);
        Ok(())
    }

    /// Sends a line to every browser.
    pub(crate) fn tell(&self, line: &[u8]) {
        let mut browsers = self.shared.browsers();
        if browsers.is_empty() {
            return;
        }
        let line: Line = line.into();
        browsers.retain(|browser| {
            !matches!(browser.lines.try_send(Arc::clone(&line)), Err(TrySendError::Disconnected(_)))
        });
    }

    /// Sends an event to every browser, and until a frame follows also to those that connect later.
    pub(crate) fn event(&self, line: &[u8]) {
        *lock(&self.shared.event) = Some(line.into());
        self.tell(line);
    }

    /// Sends a frame if the last one is old enough, or it says what no other will (`is_news`).
    pub(crate) fn frame(&mut self, line: &[u8], is_news: bool) {
        *lock(&self.shared.event) = None;
        if is_due(&mut self.next_frame, FRAME_EVERY) || is_news {
            self.tell(line);
        }
    }

    /// Whether a browser is connected.
    pub(crate) fn has_browser(&self) -> bool {
        !self.shared.browsers().is_empty()
    }

    /// Whether a browser is connected and the last image is old enough.
    pub(crate) fn wants_image(&mut self) -> bool {
        self.has_browser() && is_due(&mut self.next_image, IMAGE_EVERY)
    }
}

/// The address itself, or one of this computer if it stands for all of them: the one by which other networks would be reached.
fn reachable(address: SocketAddr) -> SocketAddr {
    // no datagram is sent to this address, which is for documentation (RFC 5737)
    let found = || {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
        socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9)).ok()?;
        socket.local_addr().ok()
    };
    match address.ip().is_unspecified() {
        true => found().map_or(address, |own| SocketAddr::new(own.ip(), address.port())),
        false => address,
    }
}

impl Drop for WebServer {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        self.shared.browsers().clear();
        // gives browsers that read time to receive the last lines
        let start = Instant::now();
        while self.shared.sending.load(Ordering::Relaxed) > 0 && start.elapsed() < LAST_LINES {
            std::thread::sleep(Duration::from_millis(2));
        }
        // wakes the listening thread
        let _ = TcpStream::connect_timeout(&self.address, Duration::from_millis(100));
    }
}

/// Whether the next one is due. Intervals start when a frame was due, not when it arrived:
/// otherwise a source of 30 frames a second with jitter would be thinned to 15.
fn is_due(next: &mut Option<Instant>, every: Duration) -> bool {
    let now = Instant::now();
    let due = next.unwrap_or(now);
    if now < due {
        return false;
    }
    let longest_ago = now.checked_sub(LATE_FRAMES * every).unwrap_or(now);
    *next = Some((due + every).max(longest_ago));
    true
}

/// 128 random bits.
fn token() -> Result<String, getrandom::Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

fn listen(listener: &TcpListener, shared: &Arc<Shared>) {
    for stream in listener.incoming() {
        if shared.is_over.load(Ordering::Relaxed) {
            return;
        }
        let Ok(stream) = stream else {
            std::thread::sleep(AFTER_FAILURE);
            continue;
        };
        // closes connections above the maximum without reading
        let Some(connection) = Connection::new(shared) else { continue };
        // a browser that disconnects is not an error; without a thread the connection is closed, too
        let _ = std::thread::Builder::new()
            .name("eit browser".to_owned())
            .spawn(move || answer(&stream, &connection.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A source at exactly the maximum rate passes although its frames jitter, and a faster one is
    /// thinned to that rate.
    #[test]
    fn thinning_keeps_the_mean_rate() {
        let every = Duration::from_millis(4);
        for (frame_us, wanted) in [(4_000, 50), (200, 50)] {
            let (start, mut next, mut passed, mut frame) = (Instant::now(), None, 0, 0);
            while start.elapsed() < 50 * every {
                let early_us = if frame % 2 == 0 { frame_us / 3 } else { 0 };
                let time = Duration::from_micros(frame * frame_us + frame_us / 3 - early_us);
                std::thread::sleep(time.saturating_sub(start.elapsed()));
                passed += i32::from(is_due(&mut next, every));
                frame += 1;
            }
            // a busy computer may lose some, and frames that come late at once are four more
            assert!((wanted - 12..=wanted + 5).contains(&passed), "{passed} of {frame}");
        }
    }
}
