//! Browsers that come and go, and what each of them gets.

use super::request::{Access, read};
use super::{PAGE, SkinShape};
use crate::error::PublishError;
use std::io::{self, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs as _};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Browsers at once.
const MOST_BROWSERS: usize = 16;
/// Lines that wait for a browser; one that is slower misses some.
const WAITING_LINES: usize = 64;
/// Frames and images at most so often: no eye sees more.
const FRAME_EVERY: Duration = Duration::from_millis(33);
const IMAGE_EVERY: Duration = Duration::from_millis(66);
/// A browser that neither asks nor reads for so long is gone.
const PATIENCE: Duration = Duration::from_secs(5);

/// How long the end waits for the last lines to go out.
const LAST_LINES: Duration = Duration::from_millis(300);

type Line = Arc<[u8]>;

/// Serves the page until it is dropped.
#[derive(Debug)]
pub struct WebServer {
    shared: Arc<Shared>,
    address: SocketAddr,
    last_frame: Option<Instant>,
    last_image: Option<Instant>,
}

#[derive(Debug)]
struct Shared {
    access: Access,
    /// What a browser hears first: the skin, once it is known.
    skin: Mutex<Option<Line>>,
    browsers: Mutex<Vec<SyncSender<Line>>>,
    /// Threads that still send.
    sending: AtomicUsize,
    is_over: AtomicBool,
}

impl Shared {
    fn browsers(&self) -> MutexGuard<'_, Vec<SyncSender<Line>>> {
        self.browsers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl WebServer {
    /// At HOST:PORT, port 0 for any that is free; anything but loopback asks for a token, which
    /// [`WebServer::url`] holds.
    ///
    /// # Errors
    ///
    /// An address that is none or is taken; no random numbers for a token.
    pub fn new(address: &str) -> Result<Self, PublishError> {
        let refuse = |error| PublishError::Address { address: address.to_owned(), error };
        let found = address.to_socket_addrs().map_err(refuse)?.next();
        let found = found.ok_or_else(|| refuse(io::ErrorKind::NotFound.into()))?;
        let access = match found.ip().is_loopback() {
            true => Access::Loopback,
            false => Access::Token(token().map_err(|error| refuse(io::Error::other(error)))?),
        };
        let listener = TcpListener::bind(found).map_err(refuse)?;
        let shared = Arc::new(Shared {
            access,
            skin: Mutex::default(),
            browsers: Mutex::default(),
            sending: AtomicUsize::new(0),
            is_over: AtomicBool::new(false),
        });
        let address = listener.local_addr().map_err(refuse)?;
        let serving = Arc::clone(&shared);
        std::thread::spawn(move || listen(&listener, &serving));
        Ok(Self { shared, address, last_frame: None, last_image: None })
    }

    /// What to open in a browser.
    pub fn url(&self) -> String {
        match &self.shared.access {
            Access::Loopback => format!("http://{}/", self.address),
            Access::Token(token) => format!("http://{}/?token={token}", self.address),
        }
    }

    /// The skin that the page draws.
    ///
    /// # Errors
    ///
    /// A shape that JSON cannot hold.
    pub fn skin(&self, shape: &SkinShape) -> Result<(), PublishError> {
        let line = serde_json::to_vec(shape)?;
        *self.shared.skin.lock().unwrap_or_else(PoisonError::into_inner) = Some(line[..].into());
        // who came before it
        self.tell(&line);
        Ok(())
    }

    /// Something that every browser should hear.
    pub(crate) fn tell(&self, line: &[u8]) {
        let mut browsers = self.shared.browsers();
        if browsers.is_empty() {
            return;
        }
        let line: Line = line.into();
        browsers.retain(|browser| {
            !matches!(browser.try_send(Arc::clone(&line)), Err(TrySendError::Disconnected(_)))
        });
    }

    /// A frame, if the last one is old enough.
    pub(crate) fn frame(&mut self, line: &[u8]) {
        if is_due(&mut self.last_frame, FRAME_EVERY) {
            self.tell(line);
        }
    }

    /// Whether somebody looks and the last image is old enough.
    pub(crate) fn wants_image(&mut self) -> bool {
        !self.shared.browsers().is_empty() && is_due(&mut self.last_image, IMAGE_EVERY)
    }
}

impl Drop for WebServer {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        self.shared.browsers().clear();
        // the last lines are on their way to browsers that read
        let start = Instant::now();
        while self.shared.sending.load(Ordering::Relaxed) > 0 && start.elapsed() < LAST_LINES {
            std::thread::sleep(Duration::from_millis(2));
        }
        // wakes the thread that listens
        let _ = TcpStream::connect_timeout(&self.address, Duration::from_millis(100));
    }
}

fn is_due(last: &mut Option<Instant>, every: Duration) -> bool {
    let is_due = last.is_none_or(|last| last.elapsed() >= every);
    if is_due {
        *last = Some(Instant::now());
    }
    is_due
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
        let Ok(stream) = stream else { continue };
        let shared = Arc::clone(shared);
        // a browser that goes away in the middle is no failure
        std::thread::spawn(move || answer(stream, &shared));
    }
}

fn answer(mut stream: TcpStream, shared: &Shared) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    stream.set_nodelay(true)?;
    let Some(request) = read(BufReader::new(&stream))? else {
        return reply(&mut stream, "400 Bad Request", "not a request\n");
    };
    if !shared.access.allows(&request) {
        return reply(&mut stream, "403 Forbidden", "open the address that was printed\n");
    }
    match (request.is_get, request.path.as_str()) {
        (true, "/") => {
            let head = "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nConnection: close\r\n\
                Cache-Control: no-store\r\nReferrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\n\
                Content-Security-Policy: default-src 'none'; style-src 'unsafe-inline'; script-src \
                'unsafe-inline'; connect-src 'self'; frame-ancestors 'none'\r\n";
            write!(stream, "{head}Content-Length: {}\r\n\r\n{PAGE}", PAGE.len())
        }
        (true, "/events") => {
            let (sender, lines) = sync_channel(WAITING_LINES);
            let is_full = {
                let mut browsers = shared.browsers();
                let is_full = browsers.len() >= MOST_BROWSERS;
                if !is_full {
                    browsers.push(sender);
                    shared.sending.fetch_add(1, Ordering::Relaxed);
                }
                is_full
            };
            match is_full {
                true => reply(&mut stream, "503 Service Unavailable", "too many browsers\n"),
                false => {
                    let sent = stream_events(stream, shared, &lines);
                    shared.sending.fetch_sub(1, Ordering::Relaxed);
                    sent
                }
            }
        }
        (true, _) => reply(&mut stream, "404 Not Found", "no such page\n"),
        (false, _) => reply(&mut stream, "405 Method Not Allowed", "GET is all there is\n"),
    }
}

fn reply(stream: &mut TcpStream, status: &str, text: &str) -> io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{text}",
        text.len()
    )
}

fn stream_events(mut stream: TcpStream, shared: &Shared, lines: &Receiver<Line>) -> io::Result<()> {
    let head = "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n\
        Connection: close\r\n\r\n";
    stream.write_all(head.as_bytes())?;
    let mut event = Vec::new();
    let mut say = |line: &[u8]| {
        event.clear();
        event.extend_from_slice(b"data: ");
        event.extend_from_slice(line);
        event.extend_from_slice(b"\n\n");
        stream.write_all(&event)
    };
    let skin = shared.skin.lock().unwrap_or_else(PoisonError::into_inner).clone();
    if let Some(skin) = skin {
        say(&skin)?;
    }
    loop {
        match lines.recv_timeout(PATIENCE) {
            Ok(line) => say(&line)?,
            // shows whether it is still there
            Err(RecvTimeoutError::Timeout) => say(b"{\"type\":\"still\"}")?,
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
    }
}
