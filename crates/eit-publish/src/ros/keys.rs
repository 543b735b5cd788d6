//! Keys, liveliness tokens and attachments of `rmw_zenoh`.

use super::definition::type_hash;
use crate::error::PublishError;
use twox_hash::XxHash3_128;

/// Reliability (reliable), durability (volatile), history (keep the last, 10) and defaults for the rest. Each is
/// written out: what an empty one means has changed between versions of `rmw_zenoh`.
const QUALITY: &str = "1:2:1,10:,:,:,,";
/// The same for the topic of fixed transforms, which ROS 2 expects to be kept for those who subscribe later (transient local). They
/// are repeated instead.
const KEPT: &str = "1:1:1,10:,:,:,,";
/// Topic of fixed transforms, such as those of the patches of a body.
pub(crate) const TF_STATIC: &str = "tf_static";

/// Identity of a ROS 2 publisher of one topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint {
    /// Zenoh key of its messages.
    pub key: String,
    /// Zenoh key of the liveliness token that announces the publisher.
    pub token: String,
    /// Identity of the publisher: the 128 bits of XXH3 of its token, least significant byte first.
    pub gid: [u8; 16],
}

impl Endpoint {
    /// Describes publisher number `number` of a node.
    ///
    /// `session` is the zenoh identity of the session in hexadecimal digits, `topic` a name such as
    /// `skin/arm/touches`, `message_type` one such as `std_msgs/msg/String`.
    ///
    /// # Errors
    ///
    /// [`PublishError::Topic`] for a name that ROS 2 does not allow, [`PublishError::MessageType`] for a type
    /// without a definition here.
    pub fn new(
        domain: u32,
        session: &str,
        node: &str,
        number: u32,
        topic: &str,
        message_type: &str,
    ) -> Result<Self, PublishError> {
        check_topic(topic)?;
        let topic = topic.trim_start_matches('/');
        let unknown = || PublishError::MessageType { name: message_type.to_owned() };
        let hash = type_hash(message_type).ok_or_else(unknown)?;
        // as DDS names types
        let (package, name) = message_type.split_once("/msg/").ok_or_else(unknown)?;
        let dds = format!("{package}::msg::dds_::{name}_");
        let key = format!("{domain}/{topic}/{dds}/{hash}");
        let named = topic.replace('/', "%");
        let quality = if topic == TF_STATIC { KEPT } else { QUALITY };
        // the node has number 0, the root as its namespace and no enclave
        let token = format!(
            "@ros2_lv/{domain}/{session}/0/{number}/MP/%/%/{node}/%{named}/{dds}/{hash}/{quality}"
        );
        let gid = XxHash3_128::oneshot(token.as_bytes()).to_le_bytes();
        Ok(Self { key, token, gid })
    }

    /// Returns the liveliness token of a node, to which its publishers belong.
    pub fn node_token(domain: u32, session: &str, node: &str) -> String {
        format!("@ros2_lv/{domain}/{session}/0/0/NN/%/%/{node}")
    }
}

/// Checks a topic: words of letters, digits and underscores that do not begin with a digit, separated by
/// slashes; one slash may stand in front.
///
/// # Errors
///
/// [`PublishError::Topic`].
pub fn check_topic(topic: &str) -> Result<(), PublishError> {
    let is_word = |word: &str| {
        word.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
            && word.chars().all(|other| other.is_ascii_alphanumeric() || other == '_')
            // ROS 2 allows one underscore in a row
            && !word.contains("__")
    };
    match topic.strip_prefix('/').unwrap_or(topic).split('/').all(is_word) {
        true => Ok(()),
        false => Err(PublishError::Topic { topic: topic.to_owned() }),
    }
}

/// Metadata of each message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attachment {
    /// Number of the message, from 1.
    pub sequence: i64,
    /// When it was handed to zenoh, nanoseconds since 1970.
    pub time_ns: i64,
    /// Identity of the publisher ([`Endpoint::gid`]).
    pub gid: [u8; 16],
}

impl Attachment {
    /// Length of its encoding.
    pub const BYTES: usize = 33;

    /// Encodes it as zenoh does: two numbers, least significant byte first, then the length of the identity and
    /// the identity.
    pub fn to_bytes(self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.time_ns.to_le_bytes());
        bytes[16] = 16;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    /// Decodes; `None` for bytes that are no attachment.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk()?;
        let (time_ns, rest) = rest.split_first_chunk()?;
        let gid = rest.strip_prefix(&[16])?.try_into().ok()?;
        Some(Self {
            sequence: i64::from_le_bytes(*sequence),
            time_ns: i64::from_le_bytes(*time_ns),
            gid,
        })
    }
}
