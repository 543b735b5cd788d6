//! Touches, images and diagnostics by zenoh, as a node of ROS 2 would publish them through `rmw_zenoh`.

mod node;
mod sender;
mod session;

pub use node::{RosNode, RosPublisher};
pub(crate) use sender::DIAGNOSTICS;
pub use session::SessionSettings;

use crate::change::ChangeThreshold;
use crate::error::PublishError;
use crate::outbox::SinkStatistics;
use crate::outbox::worker::{QueuedSink, Worker};
use crate::publisher::Start;
use crate::ros::{self, Pose};
use crate::shape::SkinShape;
use sender::{Names, Sender, Shared};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use zenoh::Wait as _;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

/// How a skin is published.
#[derive(Debug, Clone)]
pub struct ZenohSettings {
    /// Prefix of the topics, such as `skin/left_arm`, followed by `/touches`, `/markers`, `/image`, `/map` and `/pose`.
    pub topic: String,
    /// Name of the skin's coordinate frame.
    pub frame_id: String,
    /// ROS 2 domain (`ROS_DOMAIN_ID`).
    pub domain: u32,
    /// Name of the parent frame and the pose of the skin in it, published every second.
    pub pose: Option<(String, Pose)>,
    /// Publish only changes above these thresholds, and heartbeats; `None` publishes every frame.
    pub change: Option<ChangeThreshold>,
    /// Longest time between two published frames while frames arrive.
    pub heartbeat: Duration,
    /// How to connect to the zenoh network.
    pub session: SessionSettings,
}

impl ZenohSettings {
    /// Creates settings for a topic: frame `skin`, domain 0, no pose, every touch that changes, ten heartbeats
    /// a second, and the session of [`SessionSettings::default`].
    pub fn new(topic: impl Into<String>) -> Self {
        Self {
            topic: topic.into(),
            frame_id: "skin".to_owned(),
            domain: 0,
            pose: None,
            change: Some(ChangeThreshold::default()),
            heartbeat: Duration::from_millis(100),
            session: SessionSettings::default(),
        }
    }
}

/// Publishes a skin by zenoh (feature `zenoh`).
///
/// Frames go through a queue to a thread of their own, so that no network delays them. A frame that has waited for four
/// seconds, or behind which 4 096 others wait, is dropped, which [`ZenohSink::statistics`] counts. What zenoh itself drops because a receiver is
/// slow shows as a gap in the sequence numbers that the receiver gets.
#[derive(Debug)]
pub struct ZenohSink {
    topic: String,
    shared: Arc<Shared>,
    worker: Worker,
    /// Hears of other publishers.
    _rivals: Subscriber<()>,
}

impl ZenohSink {
    /// Opens a session and announces the topics. No router or receiver needs to be there yet: zenoh keeps looking.
    ///
    /// # Errors
    ///
    /// Names that ROS 2 does not allow, or endpoints that zenoh cannot parse or listen at.
    pub fn new(settings: &ZenohSettings) -> Result<Self, PublishError> {
        ros::check_topic(&settings.topic)?;
        let topic = settings.topic.trim_start_matches('/').to_owned();
        let node = RosNode::open(
            &settings.session,
            settings.domain,
            &format!("eit_{}", topic.replace('/', "_")),
        )?;
        let shared = Arc::new(Shared::default());
        let rivals = watch_rivals(&node, settings.domain, &topic, Arc::clone(&shared))?;
        let sender = Sender::new(node, &topic, settings, Arc::clone(&shared))?;
        let worker = Worker::start("eit zenoh", Arc::default(), |outbox| sender.run(outbox))
            .map_err(PublishError::Thread)?;
        Ok(Self { topic, shared, worker, _rivals: rivals })
    }

    /// Returns the prefix of the topics.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Returns the numbers of frames offered, and of those dropped because sending could not keep up.
    pub fn statistics(&self) -> SinkStatistics {
        self.worker.outbox.statistics()
    }

    /// Returns the numbers of messages handed to zenoh, and of those that it rejected.
    pub fn sent(&self) -> (u64, u64) {
        (self.shared.sent.load(Ordering::Relaxed), self.shared.refused.load(Ordering::Relaxed))
    }

    /// Returns the number of other programs that publish touches under this topic, as far as they are heard of: whoever subscribes
    /// gets the lists of all of them.
    pub fn rivals(&self) -> usize {
        self.shared.rivals.load(Ordering::Relaxed)
    }

    /// Returns whether anybody subscribes to images.
    pub fn wants_images(&self) -> bool {
        self.shared.wants_images.load(Ordering::Relaxed)
    }

    /// Sends what is queued and closes the session, within two seconds.
    pub fn finish(&mut self) {
        self.worker.finish();
    }
}

impl QueuedSink for ZenohSink {
    fn worker(&self) -> &Worker {
        &self.worker
    }

    fn worker_mut(&mut self) -> &mut Worker {
        &mut self.worker
    }

    fn has_viewer(&self) -> bool {
        self.wants_images()
    }

    fn start(&self, start: &Start<'_>) {
        let names = Names { skin: start.skin.to_owned(), instrument: start.instrument.to_owned() };
        self.shared.set_names(names);
    }

    fn skin(&self, shape: &SkinShape) {
        self.shared.set_extent(shape.extent_m);
    }
}

/// Counts the other publishers of a topic's touches, by the tokens that announce them.
fn watch_rivals(
    node: &RosNode,
    domain: u32,
    topic: &str,
    shared: Arc<Shared>,
) -> Result<Subscriber<()>, PublishError> {
    let own = format!("/{}/", node.session().zid());
    let named = topic.replace('/', "%");
    let tokens = format!("@ros2_lv/{domain}/*/*/*/MP/*/*/*/%{named}%touches/**");
    let count = move |sample: Sample| {
        if sample.key_expr().as_str().contains(&own) {
            return;
        }
        let change = |rivals: usize| match sample.kind() {
            SampleKind::Put => Some(rivals + 1),
            SampleKind::Delete => rivals.checked_sub(1),
        };
        // never fails but for a token that was not heard of
        let _ = shared.rivals.fetch_update(Ordering::Relaxed, Ordering::Relaxed, change);
    };
    let liveliness = node.session().liveliness();
    let subscriber = liveliness.declare_subscriber(tokens).history(true).callback(count).wait();
    subscriber.map_err(|source| PublishError::Zenoh { action: "look for other publishers", source })
}
