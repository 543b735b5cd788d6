//! The thread that turns queued frames into messages.

use super::{RosNode, RosPublisher, ZenohSettings};
use crate::change::ChangeFilter;
use crate::error::PublishError;
use crate::outbox::{FrameCopy, ImageCopy, Incident, Next, Outbox, Severity, lock};
use crate::publisher::clock_s;
use crate::ros::{
    DiagnosticArray, DiagnosticStatus, ElectrodeFaultMessage, Header, Image, KeyValue, MarkerArray,
    OccupancyGrid, Pose, PoseStamped, RosMessage, Time, TouchArray, TouchMessage, skin_state,
};
use eit_skin::SkinState;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How often diagnostics and the pose are published, and image subscribers are counted.
const STATE_EVERY: Duration = Duration::from_secs(1);
/// How often the thread wakes without a message.
const TICK: Duration = Duration::from_millis(100);
/// A skin without a frame for this long is reported as stale.
const STALE: Duration = Duration::from_secs(1);
/// Topic on which ROS 2 collects diagnostics.
pub(crate) const DIAGNOSTICS: &str = "diagnostics";

/// Names for diagnostics.
#[derive(Debug, Clone, Default)]
pub(super) struct Names {
    pub(crate) skin: String,
    pub(crate) instrument: String,
}

/// What the sink sees of its thread.
#[derive(Debug, Default)]
pub(super) struct Shared {
    pub(crate) sent: AtomicU64,
    pub(crate) refused: AtomicU64,
    pub(crate) wants_images: AtomicBool,
    /// Number of other programs that publish the same touches.
    pub(crate) rivals: AtomicUsize,
    names: Mutex<Names>,
    /// Extent of images, metres.
    extent_m: Mutex<Option<[f64; 4]>>,
}

impl Shared {
    pub(super) fn set_names(&self, names: Names) {
        *lock(&self.names) = names;
    }

    pub(super) fn set_extent(&self, extent_m: [f64; 4]) {
        *lock(&self.extent_m) = Some(extent_m);
    }

    fn names(&self) -> Names {
        lock(&self.names).clone()
    }
}

/// Frames since the last diagnostics.
#[derive(Debug, Default)]
struct Period {
    frames: u32,
    latency_s: f64,
}

/// Owns the session.
#[derive(Debug)]
pub(super) struct Sender {
    node: RosNode,
    touches: RosPublisher<TouchArray>,
    markers: RosPublisher<MarkerArray>,
    image: RosPublisher<Image>,
    map: RosPublisher<OccupancyGrid>,
    /// Whether somebody subscribes to markers, the image, the map.
    wanted: [bool; 3],
    diagnostics: RosPublisher<DiagnosticArray>,
    pose: Option<(RosPublisher<PoseStamped>, String, Pose)>,
    frame_id: String,
    topic: String,
    filter: ChangeFilter,
    shared: Arc<Shared>,
    /// Message whose memory is reused for each frame.
    message: TouchArray,
    skin_state: SkinState,
    period: Period,
    period_began: Instant,
    /// Number of frames dropped before the period began.
    dropped_before: u64,
    last_frame: Instant,
    faulty: String,
    incident: Option<Incident>,
}

impl Sender {
    pub(super) fn new(
        mut node: RosNode,
        topic: &str,
        settings: &ZenohSettings,
        shared: Arc<Shared>,
    ) -> Result<Self, PublishError> {
        let pose = match &settings.pose {
            None => None,
            Some((parent, pose)) => {
                Some((node.advertise(&format!("{topic}/pose"))?, parent.clone(), *pose))
            }
        };
        Ok(Self {
            touches: node.advertise(&format!("{topic}/touches"))?,
            markers: node.advertise(&format!("{topic}/markers"))?,
            image: node.advertise(&format!("{topic}/image"))?,
            map: node.advertise(&format!("{topic}/map"))?,
            wanted: [false; 3],
            diagnostics: node.advertise(DIAGNOSTICS)?,
            node,
            pose,
            frame_id: settings.frame_id.clone(),
            topic: topic.to_owned(),
            filter: ChangeFilter::new(settings.change, settings.heartbeat),
            shared,
            message: TouchArray::default(),
            // no frame yet
            skin_state: SkinState::NoData,
            period: Period::default(),
            period_began: Instant::now(),
            dropped_before: 0,
            last_frame: Instant::now(),
            faulty: String::new(),
            incident: None,
        })
    }

    /// Sends until the queue has ended.
    pub(super) fn run(mut self, outbox: &Outbox) {
        self.state(outbox);
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
                    self.incident = Some(incident);
                    self.state(outbox);
                }
                Next::Nothing | Next::Line(_) => {}
                Next::Over => break,
            }
            if self.period_began.elapsed() >= STATE_EVERY {
                self.state(outbox);
            }
        }
        // a session that does not close is closed by the end of the program
        let _ = self.node.close();
    }

    fn frame(&mut self, frame: &FrameCopy) {
        let now = Instant::now();
        self.last_frame = now;
        self.skin_state = frame.state;
        self.period.frames += 1;
        self.period.latency_s += frame.latency_s.unwrap_or(0.0);
        if !self.filter.wants(frame, now) {
            return;
        }
        self.faulty.clear();
        for fault in &frame.faults {
            let separator = if self.faulty.is_empty() { "" } else { ", " };
            self.faulty += &format!("{separator}{}", fault.electrode + 1);
        }
        let message = &mut self.message;
        message.header.stamp = Time::from_seconds(frame.host_time_s.unwrap_or_else(clock_s));
        message.header.frame_id.clone_from(&self.frame_id);
        message.sequence = frame.sequence;
        message.epoch = frame.epoch;
        message.time = frame.time_s;
        message.latency = frame.latency_s.unwrap_or(f64::NAN);
        message.whole = frame.whole;
        message.state = skin_state::number(frame.state);
        message.faulty_electrodes.clear();
        message.faulty_electrodes.extend(frame.faults.iter().map(ElectrodeFaultMessage::from));
        message.touches.clear();
        message.touches.extend(frame.touches.iter().map(TouchMessage::from));
        count(&self.shared, &mut self.touches, &self.message);
        if self.wanted[0] {
            let not_known = frame.state.why_not_known().map(|why| format!("not known: {why}"));
            let TouchArray { header, touches, .. } = &self.message;
            let markers = MarkerArray::of_touches(header, touches.iter(), not_known);
            count(&self.shared, &mut self.markers, &markers);
        }
    }

    fn image(&mut self, image: &ImageCopy) {
        let [height, width] = [image.rows, image.columns].map(|size| size as u32);
        let extent_m = *lock(&self.shared.extent_m);
        if let (true, Some([x0, x1, y0, _])) = (self.wanted[2], extent_m) {
            let rows = image.values.chunks_exact(image.columns.max(1)).rev().flatten();
            let cell = |value: &f32| match value.is_finite() {
                true => (100.0 * (value / image.range).abs().min(1.0)) as i8,
                false => -1,
            };
            let origin = Pose { position: [x0, y0, 0.0].into(), ..Pose::default() };
            let map = OccupancyGrid {
                header: self.header(image.host_time_s),
                map_load_time: self.header(image.host_time_s).stamp,
                resolution: ((x1 - x0) / image.columns.max(1) as f64) as f32,
                width,
                height,
                origin,
                data: rows.map(cell).collect(),
            };
            count(&self.shared, &mut self.map, &map);
        }
        if !self.wanted[1] {
            return;
        }
        let message = Image {
            header: self.header(image.host_time_s),
            height,
            width,
            encoding: "32FC1".to_owned(),
            is_bigendian: 0,
            step: 4 * width,
            data: image.values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        };
        count(&self.shared, &mut self.image, &message);
    }

    fn header(&self, time_s: Option<f64>) -> Header {
        let stamp = Time::from_seconds(time_s.unwrap_or_else(clock_s));
        Header { stamp, frame_id: self.frame_id.clone() }
    }

    /// Publishes diagnostics and pose.
    fn state(&mut self, outbox: &Outbox) {
        self.wanted =
            [self.markers.has_subscriber(), self.image.has_subscriber(), self.map.has_subscriber()];
        let wants_images = self.wanted[1] || self.wanted[2];
        self.shared.wants_images.store(wants_images, Ordering::Relaxed);
        let message = DiagnosticArray {
            header: Header { stamp: Time::from_seconds(clock_s()), frame_id: String::new() },
            status: vec![self.status(outbox)],
        };
        count(&self.shared, &mut self.diagnostics, &message);
        if let Some((publisher, parent, pose)) = &mut self.pose {
            let stamp = Time::from_seconds(clock_s());
            let header = Header { stamp, frame_id: parent.clone() };
            count(&self.shared, publisher, &PoseStamped { header, pose: *pose });
        }
        self.period = Period::default();
        self.dropped_before = outbox.statistics().dropped_frames;
        self.period_began = Instant::now();
    }

    fn status(&self, outbox: &Outbox) -> DiagnosticStatus {
        let Names { skin, instrument } = self.shared.names();
        let statistics = outbox.statistics();
        let seconds = self.period_began.elapsed().as_secs_f64().max(1e-3);
        let frames = f64::from(self.period.frames);
        let silence = self.last_frame.elapsed();
        let dropped = statistics.dropped_frames.saturating_sub(self.dropped_before);
        let incident = self.incident.as_ref();
        let (level, message) = if silence > STALE {
            let why = incident.filter(|what| what.severity == Severity::Error);
            let words = why.map_or(String::new(), |what| format!(": {}", what.text));
            (3, format!("no frame for {:.1} s{words}", silence.as_secs_f64()))
        } else if !self.faulty.is_empty() {
            (1, format!("faulty electrodes: {}", self.faulty))
        } else if let Some(why) = self.skin_state.why_not_known() {
            (if self.skin_state == SkinState::NoData { 3 } else { 1 }, why.to_owned())
        } else if self.shared.rivals.load(Ordering::Relaxed) > 0 {
            (1, "another program publishes these topics, too".to_owned())
        } else if dropped > 0 {
            (1, format!("{dropped} frames dropped before sending"))
        } else {
            (0, "sound".to_owned())
        };
        let value = |key: &str, value: String| KeyValue { key: key.to_owned(), value };
        let mut values = vec![
            value("frames_per_second", format!("{:.1}", frames / seconds)),
            value(
                "mean_latency_ms",
                format!("{:.2}", 1e3 * self.period.latency_s / frames.max(1.0)),
            ),
            value("faulty_electrodes", self.faulty.clone()),
            value("frames", statistics.frames.to_string()),
            value("dropped_frames", statistics.dropped_frames.to_string()),
            value("messages", self.shared.sent.load(Ordering::Relaxed).to_string()),
        ];
        if let Some(incident) = incident {
            values.push(value("last_event", incident.text.clone()));
            values.push(value("last_event_time", format!("{:.3}", incident.host_time_s)));
        }
        DiagnosticStatus {
            level,
            name: format!("{}: EIT skin {skin}", self.topic),
            message,
            hardware_id: instrument,
            values,
        }
    }
}

/// Publishes; a message that zenoh rejects is counted, and the sink continues.
fn count<M: RosMessage>(shared: &Shared, publisher: &mut RosPublisher<M>, message: &M) {
    let counter = match publisher.publish(message) {
        Ok(()) => &shared.sent,
        Err(_) => &shared.refused,
    };
    counter.fetch_add(1, Ordering::Relaxed);
}
