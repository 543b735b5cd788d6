//! Handles one connection: reads its request and answers with the page or the events.

use super::PAGE;
use super::request::{Method, read};
use super::server::{BrowserSlot, Shared};
use std::io::{self, BufReader, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

/// Time limit for receiving a request and for sending an answer or a line; slower clients are disconnected. Also the
/// idle time after which a browser gets a heartbeat.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often to check whether a browser has closed its connection.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// A connection with a deadline: a slow trickle of bytes does not extend it.
struct Until<'a> {
    stream: &'a TcpStream,
    end: Instant,
}

impl<'a> Until<'a> {
    /// Sets the deadline to now plus [`PATIENCE`].
    fn patience(stream: &'a TcpStream) -> Self {
        Self { stream, end: Instant::now() + PATIENCE }
    }

    fn left(&self) -> io::Result<Option<Duration>> {
        let left = self.end.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(Some(left)) }
    }
}

impl Read for Until<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(self.left()?)?;
        self.stream.read(bytes)
    }
}

impl Write for Until<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(self.left()?)?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

/// Answers one request.
pub(super) fn answer(stream: &TcpStream, shared: &Shared) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let request = read(BufReader::new(Until::patience(stream)))?;
    let Some(request) = request else {
        return reply(stream, "400 Bad Request", "not a request\n");
    };
    if !shared.access.allows(&request) {
        return reply(stream, "403 Forbidden", "open the address that was printed\n");
    }
    match (request.method, request.path.as_str()) {
        (Method::Get, "/") => {
            let head = "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nConnection: close\r\n\
                Cache-Control: no-store\r\nReferrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\n\
                Content-Security-Policy: default-src 'none'; style-src 'unsafe-inline'; script-src \
                'unsafe-inline'; connect-src 'self'; frame-ancestors 'none'\r\n";
            let page = format!("{head}Content-Length: {}\r\n\r\n{PAGE}", PAGE.len());
            Until::patience(stream).write_all(page.as_bytes())
        }
        (Method::Get, "/events") => match shared.place() {
            Some(place) => send_events(stream, shared, &place),
            None => reply(stream, "503 Service Unavailable", "too many browsers\n"),
        },
        // every browser requests it, and logs an error if it is missing
        (Method::Get, "/favicon.ico") => reply(stream, "204 No Content", ""),
        (Method::Get, _) => reply(stream, "404 Not Found", "no such page\n"),
        (Method::Post, path @ ("/record/start" | "/record/stop")) => match &shared.recorder {
            Some(recorder) if request.has_token(&recorder.token) => {
                recorder.ask(path == "/record/start");
                reply(stream, "202 Accepted", "")
            }
            Some(_) => {
                reply(stream, "403 Forbidden", "recording needs the token of the printed address\n")
            }
            None => reply(stream, "404 Not Found", "nothing can be recorded here\n"),
        },
        (Method::Post | Method::Other, _) => {
            reply(stream, "405 Method Not Allowed", "not a method of this page\n")
        }
    }
}

fn reply(stream: &TcpStream, status: &str, text: &str) -> io::Result<()> {
    let reply = format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{text}",
        text.len()
    );
    Until::patience(stream).write_all(reply.as_bytes())
}

/// Sends lines until the browser disconnects or the server ends.
fn send_events(stream: &TcpStream, shared: &Shared, place: &BrowserSlot<'_>) -> io::Result<()> {
    let head = "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n\
        Connection: close\r\n\r\n";
    Until::patience(stream).write_all(head.as_bytes())?;
    let mut event = Vec::new();
    let mut say = |line: &[u8]| {
        event.clear();
        event.extend_from_slice(b"data: ");
        event.extend_from_slice(line);
        event.extend_from_slice(b"\n\n");
        Until::patience(stream).write_all(&event)
    };
    for line in shared.greeting() {
        say(&line)?;
    }
    let (mut said, mut looked) = (Instant::now(), Instant::now());
    loop {
        match place.lines.recv_timeout(LOOK_EVERY) {
            Ok(line) => {
                say(&line)?;
                said = Instant::now();
            }
            Err(RecvTimeoutError::Timeout) if said.elapsed() >= PATIENCE => {
                say(b"{\"type\":\"still\"}")?;
                said = Instant::now();
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
        if looked.elapsed() >= LOOK_EVERY {
            if is_closed(stream)? {
                return Ok(());
            }
            looked = Instant::now();
        }
    }
}

/// Whether the client has closed the connection; does not consume what it may have sent after its request.
fn is_closed(stream: &TcpStream) -> io::Result<bool> {
    stream.set_nonblocking(true)?;
    let peeked = stream.peek(&mut [0]);
    stream.set_nonblocking(false)?;
    Ok(match peeked {
        Ok(bytes) => bytes == 0,
        Err(error) => error.kind() != ErrorKind::WouldBlock,
    })
}
