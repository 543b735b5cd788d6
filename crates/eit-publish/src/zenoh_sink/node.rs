//! A node with publishers, as `rmw_zenoh` announces them.

use super::SessionSettings;
use crate::error::PublishError;
use crate::publisher::clock_ns;
use crate::ros::{Attachment, Endpoint, RosMessage, to_cdr};
use std::marker::PhantomData;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait as _};

/// A node of ROS 2 (feature `zenoh`).
#[derive(Debug)]
pub struct RosNode {
    session: Session,
    domain: u32,
    name: String,
    publishers: u32,
    /// Announces the node while it exists.
    _token: LivelinessToken,
}

impl RosNode {
    /// Opens a session and announces a node in it.
    ///
    /// # Errors
    ///
    /// A session that cannot be opened.
    pub fn open(settings: &SessionSettings, domain: u32, name: &str) -> Result<Self, PublishError> {
        let session = settings.open()?;
        let token = Endpoint::node_token(domain, &session.zid().to_string(), name);
        let token = session
            .liveliness()
            .declare_token(token)
            .wait()
            .map_err(|source| PublishError::Zenoh { action: "announce the node", source })?;
        Ok(Self { session, domain, name: name.to_owned(), publishers: 0, _token: token })
    }

    /// The session, for subscribers.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Announces a publisher of a topic.
    ///
    /// # Errors
    ///
    /// A name that ROS 2 does not allow, or a session that is closed.
    pub fn advertise<M: RosMessage>(
        &mut self,
        topic: &str,
    ) -> Result<RosPublisher<M>, PublishError> {
        self.publishers += 1;
        let session = self.session.zid().to_string();
        let endpoint =
            Endpoint::new(self.domain, &session, &self.name, self.publishers, topic, M::TYPE)?;
        let failed = |source| PublishError::Zenoh { action: "announce a topic", source };
        // a receiver that is slow misses messages instead of holding all others up
        let publisher = self
            .session
            .declare_publisher(endpoint.key.clone())
            .congestion_control(CongestionControl::Drop)
            .wait()
            .map_err(failed)?;
        let token =
            self.session.liveliness().declare_token(endpoint.token).wait().map_err(failed)?;
        let gid = endpoint.gid;
        Ok(RosPublisher { publisher, gid, sequence: 0, _token: token, _message: PhantomData })
    }

    /// Closes the session.
    ///
    /// # Errors
    ///
    /// Errors reported by zenoh.
    pub fn close(self) -> Result<(), PublishError> {
        self.session
            .close()
            .wait()
            .map_err(|source| PublishError::Zenoh { action: "close the session", source })
    }
}

/// A publisher of one topic (feature `zenoh`).
#[derive(Debug)]
pub struct RosPublisher<M> {
    publisher: Publisher<'static>,
    gid: [u8; 16],
    /// Number of the last message.
    sequence: i64,
    _token: LivelinessToken,
    _message: PhantomData<fn(M)>,
}

impl<M: RosMessage> RosPublisher<M> {
    /// Publishes a message. Waits at most a millisecond for a slow receiver, which then misses it.
    ///
    /// # Errors
    ///
    /// A message that cannot be encoded, or a session that is closed.
    pub fn publish(&mut self, message: &M) -> Result<(), PublishError> {
        let mut payload = Vec::new();
        to_cdr(message, &mut payload)?;
        self.sequence += 1;
        let attachment = Attachment { sequence: self.sequence, time_ns: clock_ns(), gid: self.gid };
        self.publisher
            .put(payload)
            .attachment(attachment.to_bytes().to_vec())
            .wait()
            .map_err(|source| PublishError::Zenoh { action: "publish", source })
    }

    /// Messages published so far.
    pub fn published(&self) -> i64 {
        self.sequence
    }

    /// Returns whether anybody subscribes; `false` if zenoh cannot tell.
    pub(crate) fn has_subscriber(&self) -> bool {
        self.publisher.matching_status().wait().is_ok_and(|status| status.matching())
    }
}
