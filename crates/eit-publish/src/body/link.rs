//! A body on the network.

use super::state::{BodyNews, BodyState, Origin};
use super::{BodySettings, Latency};
use crate::error::PublishError;
use crate::publisher::clock_s;
use crate::ros::{
    Attachment, BodyTouchArray, DiagnosticArray, Header, MarkerArray, PatchState, PoseStamped,
    RosMessage as _, TF_STATIC, TfMessage, Time, TouchArray, TransformStamped, from_cdr, type_hash,
};
use crate::zenoh_sink::{DIAGNOSTICS, RosNode, RosPublisher};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use zenoh::Wait as _;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

/// Messages that wait to be joined; more than that are dropped and counted.
const CAPACITY: usize = 8192;
/// How often to check for silence.
const TICK: Duration = Duration::from_millis(20);
/// Longest time between two lists; without changes, a list shows that the body is alive.
const HEARTBEAT: Duration = Duration::from_millis(100);
/// How often poses and diagnostics are published.
const POSES_EVERY: Duration = Duration::from_secs(1);

struct Arrived {
    patch: usize,
    sample: Sample,
    arrived: Instant,
    arrived_s: f64,
}

/// Receives the patches of a body, joins them, and publishes the list (feature `zenoh`).
#[derive(Debug)]
pub struct Body {
    state: BodyState,
    hash: String,
    arrivals: Receiver<Arrived>,
    overflowed: Arc<AtomicU64>,
    news: VecDeque<BodyNews>,
    period: Duration,
    listed: Option<Instant>,
    outlet: Option<Outlet>,
    refused: u64,
    /// Declared last, so that subscribers end first.
    _subscribers: Vec<Subscriber<()>>,
    node: RosNode,
}

/// What is published.
#[derive(Debug)]
struct Outlet {
    list: RosPublisher<BodyTouchArray>,
    markers: RosPublisher<MarkerArray>,
    /// Whether somebody subscribes to markers.
    wants_markers: bool,
    poses: Vec<(RosPublisher<PoseStamped>, PoseStamped)>,
    transforms: RosPublisher<TfMessage>,
    diagnostics: RosPublisher<DiagnosticArray>,
    names: Vec<String>,
    posed: Option<Instant>,
}

impl Body {
    /// Opens the session and subscribes to every patch.
    ///
    /// # Errors
    ///
    /// A session that cannot be opened.
    pub fn open(settings: &BodySettings) -> Result<Self, PublishError> {
        let mut node = RosNode::open(&settings.session, settings.domain, "eit_body")?;
        let (sender, arrivals) = sync_channel(CAPACITY);
        let overflowed = Arc::new(AtomicU64::new(0));
        let hash = type_hash(TouchArray::TYPE)
            .ok_or_else(|| PublishError::MessageType { name: TouchArray::TYPE.to_owned() })?;
        let subscribers = settings.patches.iter().enumerate().map(|(number, patch)| {
            // any hash: another version of the message is told from silence
            let key = format!(
                "{}/{}/touches/eit_skin_msgs::msg::dds_::TouchArray_/*",
                settings.domain, patch.topic
            );
            subscribe(&node, &key, number, sender.clone(), Arc::clone(&overflowed))
        });
        let subscribers = subscribers.collect::<Result<_, _>>()?;
        let outlet = match &settings.topic {
            Some(topic) => Some(Outlet::new(&mut node, topic, settings)?),
            None => None,
        };
        Ok(Self {
            state: BodyState::new(settings, Instant::now()),
            hash,
            arrivals,
            overflowed,
            news: VecDeque::new(),
            period: settings.period,
            listed: None,
            outlet,
            refused: 0,
            _subscribers: subscribers,
            node,
        })
    }

    /// Waits for the next change or event, for at most `timeout`, which may be [`Duration::MAX`].
    pub fn next(&mut self, timeout: Duration) -> Option<BodyNews> {
        // not an end, which a long time would put beyond what a clock holds
        let start = Instant::now();
        loop {
            if let Some(news) = self.news.pop_front() {
                return Some(news);
            }
            while let Ok(arrived) = self.arrivals.try_recv() {
                self.take(&arrived);
            }
            let now = Instant::now();
            self.state.silences(now, &mut self.news);
            let since = self.listed.map(|listed| now.duration_since(listed));
            let rest = self.period.max(HEARTBEAT);
            let least = if self.state.has_changed() { self.period } else { rest };
            if since.is_none_or(|since| since >= least) {
                self.list(now);
                continue;
            }
            if !self.news.is_empty() {
                continue;
            }
            let left = timeout.saturating_sub(now.duration_since(start));
            if left.is_zero() {
                return None;
            }
            let next_list = least.saturating_sub(since.unwrap_or_default());
            let wait = TICK.min(left).min(next_list);
            match self.arrivals.recv_timeout(wait) {
                Ok(arrived) => self.take(&arrived),
                Err(RecvTimeoutError::Timeout) => {}
                // never: the subscribers hold senders
                Err(RecvTimeoutError::Disconnected) => std::thread::sleep(wait),
            }
        }
    }

    /// Returns the name of a patch from the settings.
    pub fn name(&self, patch: usize) -> &str {
        self.state.name(patch)
    }

    /// Names the patches whose touches are not known; `None` if all are.
    #[cfg(feature = "foxglove")]
    pub(crate) fn not_known(&self) -> Option<String> {
        self.state.not_known()
    }

    /// State of every patch.
    pub fn patches(&self) -> Vec<PatchState> {
        self.state.states(Instant::now())
    }

    /// Returns the latencies of messages ([`BodyState::latency`]).
    pub fn latency(&self) -> Option<&Latency> {
        self.state.latency()
    }

    /// Forgets the latencies so far.
    pub fn reset_latency(&mut self) {
        self.state.reset_latency();
    }

    /// Number of messages dropped because they arrived faster than they could be joined, and of lists that
    /// zenoh rejected.
    pub fn dropped(&self) -> [u64; 2] {
        [self.overflowed.load(Ordering::Relaxed), self.refused]
    }

    /// Returns the ROS 2 node that publishes the body's touches.
    pub fn node(&self) -> &RosNode {
        &self.node
    }

    fn list(&mut self, now: Instant) {
        self.listed = Some(now);
        let list = self.state.list(clock_s());
        if let Some(outlet) = &mut self.outlet {
            let published = outlet.publish(&self.state.message(&list, now), &self.state, now);
            self.refused += u64::from(published.is_err());
        }
        self.news.push_back(BodyNews::Touches(list));
    }

    fn take(&mut self, arrived: &Arrived) {
        let patch = arrived.patch;
        let hash = arrived.sample.key_expr().as_str().rsplit('/').next().unwrap_or_default();
        if hash != self.hash {
            let reason = format!("its TouchArray has type hash {hash}, not {}", self.hash);
            self.news.extend(self.state.unreadable(patch, reason));
            return;
        }
        let attachment = arrived.sample.attachment().map(|bytes| bytes.to_bytes());
        let Some(attachment) = attachment.and_then(|bytes| Attachment::from_bytes(&bytes)) else {
            let reason = "its messages lack the attachment of rmw_zenoh 0.2.4 or newer".to_owned();
            self.news.extend(self.state.unreadable(patch, reason));
            return;
        };
        let Arrived { arrived: when, arrived_s, .. } = *arrived;
        match from_cdr::<TouchArray>(&arrived.sample.payload().to_bytes()) {
            Ok(message) => {
                let origin = Origin { attachment, arrived: when, arrived_s };
                self.state.receive(patch, &message, &origin, &mut self.news);
            }
            Err(error) => self.news.extend(self.state.unreadable(patch, error.to_string())),
        }
    }
}

fn subscribe(
    node: &RosNode,
    key: &str,
    patch: usize,
    sender: SyncSender<Arrived>,
    overflowed: Arc<AtomicU64>,
) -> Result<Subscriber<()>, PublishError> {
    node.session()
        .declare_subscriber(key.to_owned())
        .callback(move |sample| {
            let (arrived, arrived_s) = (Instant::now(), clock_s());
            if sender.try_send(Arrived { patch, sample, arrived, arrived_s }).is_err() {
                overflowed.fetch_add(1, Ordering::Relaxed);
            }
        })
        .wait()
        .map_err(|source| PublishError::Zenoh { action: "subscribe to a patch", source })
}

impl Outlet {
    fn new(node: &mut RosNode, topic: &str, settings: &BodySettings) -> Result<Self, PublishError> {
        let list = node.advertise(&format!("{topic}/touches"))?;
        let poses = settings.patches.iter().map(|patch| {
            let publisher = node.advertise(&format!("{}/pose", patch.topic))?;
            let header = Header { stamp: Time::default(), frame_id: settings.frame_id.clone() };
            Ok((publisher, PoseStamped { header, pose: patch.placement.pose() }))
        });
        let poses = poses.collect::<Result<_, PublishError>>()?;
        Ok(Self {
            list,
            markers: node.advertise(&format!("{topic}/markers"))?,
            wants_markers: false,
            poses,
            transforms: node.advertise(TF_STATIC)?,
            diagnostics: node.advertise(DIAGNOSTICS)?,
            names: settings.patches.iter().map(|patch| patch.name.clone()).collect(),
            posed: None,
        })
    }

    /// Publishes a list, and if it is time the poses of the patches and how they are.
    fn publish(
        &mut self,
        list: &BodyTouchArray,
        state: &BodyState,
        now: Instant,
    ) -> Result<(), PublishError> {
        self.list.publish(list)?;
        if self.wants_markers {
            let touches = list.touches.iter().map(|placed| &placed.touch);
            let markers = MarkerArray::of_touches(&list.header, touches, state.not_known());
            self.markers.publish(&markers)?;
        }
        if self.posed.is_some_and(|posed| now.duration_since(posed) < POSES_EVERY) {
            return Ok(());
        }
        self.posed = Some(now);
        let stamp = Time::from_seconds(clock_s());
        for (publisher, message) in &mut self.poses {
            message.header.stamp = stamp;
            publisher.publish(message)?;
        }
        self.wants_markers = self.markers.has_subscriber();
        let transforms =
            self.names.iter().zip(&self.poses).map(|(name, (_, pose))| TransformStamped {
                header: pose.header.clone(),
                child_frame_id: name.clone(),
                translation: <[f64; 3]>::from(pose.pose.position).into(),
                rotation: pose.pose.orientation,
            });
        self.transforms.publish(&TfMessage { transforms: transforms.collect() })?;
        let header = Header { stamp, frame_id: String::new() };
        self.diagnostics.publish(&DiagnosticArray { header, status: state.diagnostics(now) })
    }
}
