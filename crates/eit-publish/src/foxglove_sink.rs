//! The skin for Foxglove, in its own schemas: a scene, a grid and a log; live, or recorded as MCAP.

#[cfg(feature = "zenoh")]
mod body;
mod draw;

#[cfg(feature = "zenoh")]
pub use body::FoxgloveBody;

use crate::SkinShape;
use crate::error::PublishError;
use crate::outbox::worker::{QueuedSink, Worker};
use crate::outbox::{FrameCopy, ImageCopy, Next, Outbox, Severity, SinkStatistics, lock};
use crate::publisher::clock_s;
use draw::Painter;
use eit_skin::SkinState;
use foxglove::messages::{Grid, Log, SceneUpdate, Timestamp, log};
use foxglove::{Channel, Context, FoxgloveError, McapWriterHandle, WebSocketServerHandle};
use std::fs::File;
use std::io::{self, BufWriter};
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How often the outline is repeated: Foxglove shows a new client only what is sent from then on.
const OUTLINE_EVERY: Duration = Duration::from_secs(1);
/// How often the thread wakes without a message.
const TICK: Duration = Duration::from_millis(100);
/// Shortest time between frames, for live clients and recordings alike; the eye sees no more.
const SCENE_EVERY: Duration = Duration::from_millis(15);

/// How a skin is shown in Foxglove.
#[derive(Debug, Clone)]
pub struct FoxgloveSettings {
    /// HOST:PORT of the server (port 0: any free port); `None` for no server.
    pub server: Option<String>,
    /// File to record the same messages to; it must not exist yet.
    pub recording: Option<PathBuf>,
    /// Prefix of the topics, followed by `/scene`, `/image` and `/log`.
    pub topic: String,
    /// Name of the skin's coordinate frame.
    pub frame_id: String,
}

impl Default for FoxgloveSettings {
    /// A server at 127.0.0.1:8765, no recording, topics below `/skin`, frame `skin`.
    fn default() -> Self {
        Self {
            server: Some("127.0.0.1:8765".to_owned()),
            recording: None,
            topic: "/skin".to_owned(),
            frame_id: "skin".to_owned(),
        }
    }
}

/// Shows a skin in Foxglove (feature `foxglove`).
///
/// Frames go through a queue to a thread of their own, as with `ZenohSink`. The server has no access control:
/// whoever reaches its address can watch. It runs on 127.0.0.1 unless told otherwise.
#[derive(Debug)]
pub struct FoxgloveSink {
    shape: Arc<Mutex<Option<SkinShape>>>,
    clients: Arc<AtomicUsize>,
    address: Option<SocketAddr>,
    is_recording: bool,
    worker: Worker,
}

impl FoxgloveSink {
    /// Starts the server and creates the recording.
    ///
    /// # Errors
    ///
    /// An address that cannot be used, or a recording that exists.
    pub fn new(settings: &FoxgloveSettings) -> Result<Self, PublishError> {
        let context = Context::new();
        let mut address = None;
        let server = match &settings.server {
            None => None,
            Some(place) => {
                let (server, bound) = serve(&context, place)?;
                address = Some(bound);
                Some(server)
            }
        };
        let recording = match &settings.recording {
            None => None,
            Some(path) => Some(
                context
                    .mcap_writer()
                    .create_new_buffered_file(path)
                    .map_err(|error| failed(&path.display().to_string(), error))?,
            ),
        };
        let shape = Arc::new(Mutex::new(None));
        let clients = Arc::new(AtomicUsize::new(0));
        let is_recording = recording.is_some();
        let topic = settings.topic.trim_end_matches('/');
        let sender = Sender {
            scene: context.channel_builder(format!("{topic}/scene")).build(),
            image: context.channel_builder(format!("{topic}/image")).build(),
            log: context.channel_builder(format!("{topic}/log")).build(),
            _context: context,
            server,
            recording,
            painter: Painter::new(&settings.frame_id),
            shape: Arc::clone(&shape),
            clients: Arc::clone(&clients),
            outlined: None,
            last_scene: None,
            state: SkinState::Sound,
        };
        let worker = Worker::start("eit foxglove", Arc::default(), |outbox| sender.run(outbox))
            .map_err(PublishError::Thread)?;
        Ok(Self { shape, clients, address, is_recording, worker })
    }

    /// Address of the server.
    pub fn address(&self) -> Option<SocketAddr> {
        self.address
    }

    /// Returns the numbers of frames offered, and of those dropped because sending could not keep up.
    pub fn statistics(&self) -> SinkStatistics {
        self.worker.outbox.statistics()
    }

    /// Returns whether images are needed: a client is connected, or a recording is made.
    pub fn wants_images(&self) -> bool {
        self.is_recording || self.clients.load(Ordering::Relaxed) > 0
    }

    /// Sends what is queued, completes the recording and stops the server, within two seconds.
    pub fn finish(&mut self) {
        self.worker.finish();
    }
}

impl QueuedSink for FoxgloveSink {
    fn worker(&self) -> &Worker {
        &self.worker
    }

    fn worker_mut(&mut self) -> &mut Worker {
        &mut self.worker
    }

    fn has_viewer(&self) -> bool {
        self.wants_images()
    }

    fn skin(&self, shape: &SkinShape) {
        *lock(&self.shape) = Some(shape.clone());
    }
}

/// Owns server and recording.
struct Sender {
    scene: Channel<SceneUpdate>,
    image: Channel<Grid>,
    log: Channel<Log>,
    /// Channels are closed when it is dropped.
    _context: Arc<Context>,
    server: Option<WebSocketServerHandle>,
    recording: Option<McapWriterHandle<BufWriter<File>>>,
    painter: Painter,
    shape: Arc<Mutex<Option<SkinShape>>>,
    clients: Arc<AtomicUsize>,
    outlined: Option<Instant>,
    last_scene: Option<Instant>,
    /// What was known of the skin in the last frame.
    state: SkinState,
}

impl Sender {
    fn run(mut self, outbox: &Outbox) {
        loop {
            match outbox.next(TICK) {
                Next::Frame(frame) => {
                    self.frame(&frame);
                    outbox.recycle(frame);
                }
                Next::Image(image) => {
                    self.image(&image);
                    outbox.recycle_image(image);
                }
                Next::Incident(incident) => {
                    let level = match incident.severity {
                        Severity::Information => log::Level::Info,
                        Severity::Warning => log::Level::Warning,
                        Severity::Error => log::Level::Error,
                    };
                    self.log(level, Some(incident.host_time_s), incident.text);
                }
                Next::Nothing | Next::Line(_) => {}
                Next::Over => break,
            }
            if let Some(server) = &self.server {
                self.clients.store(server.client_count(), Ordering::Relaxed);
            }
        }
        if let Some(recording) = self.recording.take() {
            // what was written is readable without its index, too
            let _ = recording.close();
        }
        if let Some(server) = self.server.take() {
            server.stop().wait_blocking();
        }
    }

    fn log(&self, level: log::Level, time_s: Option<f64>, message: String) {
        write(&self.log, level, timestamp(time_s), message);
    }

    fn frame(&mut self, frame: &FrameCopy) {
        let has_end = frame.touches.iter().any(|touch| touch.state == eit_skin::TouchState::End);
        let is_news = std::mem::replace(&mut self.state, frame.state) != frame.state;
        // an event says that the reference is being taken
        let is_told = !is_news || frame.state == SkinState::Reference;
        if let Some(why) = frame.state.why_not_known().filter(|_| !is_told) {
            self.log(log::Level::Warning, frame.host_time_s, format!("not known: {why}"));
        }
        if !has_end && !is_news && self.last_scene.is_some_and(|last| last.elapsed() < SCENE_EVERY)
        {
            return;
        }
        self.last_scene = Some(Instant::now());
        let time = timestamp(frame.host_time_s);
        if self.outlined.is_none_or(|last| last.elapsed() >= OUTLINE_EVERY)
            && let Some(shape) = &*lock(&self.shape)
        {
            self.outlined = Some(Instant::now());
            self.scene.log_with_time(&self.painter.outline(shape, time), time);
        }
        self.scene.log_with_time(&self.painter.touches(frame, time), time);
    }

    fn image(&mut self, image: &ImageCopy) {
        let extent = lock(&self.shape).as_ref().map(|shape| shape.extent_m);
        let Some(extent) = extent else { return };
        let time = timestamp(image.host_time_s);
        self.image.log_with_time(&self.painter.grid(image, extent, time), time);
    }
}

fn write(channel: &Channel<Log>, level: log::Level, time: Timestamp, message: String) {
    let message = Log {
        timestamp: Some(time),
        level: level.into(),
        message,
        name: "eit".to_owned(),
        file: String::new(),
        line: 0,
    };
    channel.log_with_time(&message, time);
}

/// Starts a server; returns its address, too.
fn serve(
    context: &Arc<Context>,
    place: &str,
) -> Result<(WebSocketServerHandle, SocketAddr), PublishError> {
    let found = resolve(place)?;
    let server = context
        .websocket_server()
        .name("eit")
        .bind(found.ip().to_string(), found.port())
        .start_blocking()
        .map_err(|error| failed(place, error))?;
    let address = SocketAddr::new(found.ip(), server.port());
    Ok((server, address))
}

fn timestamp(time_s: Option<f64>) -> Timestamp {
    Timestamp::saturating_from_epoch_secs_f64(time_s.unwrap_or_else(clock_s))
}

fn resolve(place: &str) -> Result<SocketAddr, PublishError> {
    let refuse = |error| PublishError::Address { address: place.to_owned(), error };
    let found = place.to_socket_addrs().map_err(refuse)?.next();
    found.ok_or_else(|| refuse(io::ErrorKind::NotFound.into()))
}

fn failed(place: &str, error: FoxgloveError) -> PublishError {
    PublishError::Foxglove { place: place.to_owned(), source: Box::new(error) }
}
