//! Errors of this crate.

use std::io;

/// Why touches cannot be published.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PublishError {
    /// The address cannot be used.
    #[error("{address}: {error}; give HOST:PORT, such as 127.0.0.1:9000")]
    Address {
        /// Address that was rejected.
        address: String,
        /// What is wrong with it.
        error: io::Error,
    },
    /// No socket for datagrams.
    #[error("{address}: no UDP socket: {error}")]
    Socket {
        /// Destination of the datagrams.
        address: String,
        /// Error of the operating system.
        error: io::Error,
    },
    /// A line could not be written.
    #[error("cannot write a line of touches: {0}")]
    Write(#[from] io::Error),
    /// A line could not be encoded.
    #[error("cannot encode a line of touches: {0}")]
    Encode(#[from] serde_json::Error),
    /// No thread for a sink.
    #[error("cannot start a thread that publishes: {0}")]
    Thread(#[source] io::Error),
    /// A topic that ROS 2 does not allow.
    #[cfg(feature = "zenoh")]
    #[error(
        "{topic}: not a topic of ROS 2; give words of letters, digits and single underscores, separated by \
         slashes, such as skin/left_arm"
    )]
    Topic {
        /// Name that was rejected.
        topic: String,
    },
    /// A message type whose definition is not known here.
    #[cfg(feature = "zenoh")]
    #[error("{name}: no definition of this message type")]
    MessageType {
        /// Name of the message type.
        name: String,
    },
    /// A payload that is not the expected message, or a message that cannot be encoded.
    #[cfg(feature = "zenoh")]
    #[error("not a valid message: {0}")]
    Cdr(#[source] cdr_encoding::Error),
    /// A payload without the header of little-endian CDR.
    #[cfg(feature = "zenoh")]
    #[error("not a message: {bytes} bytes that do not begin with the header of little-endian CDR")]
    CdrHeader {
        /// Length of the payload.
        bytes: usize,
    },
    /// Zenoh failed.
    #[cfg(feature = "zenoh")]
    #[error("zenoh cannot {action}: {source}")]
    Zenoh {
        /// What zenoh was asked to do.
        action: &'static str,
        /// Error reported by zenoh.
        source: zenoh::Error,
    },
    /// The file of a body cannot be used.
    #[cfg(feature = "zenoh")]
    #[error("{path}: {message}")]
    Body {
        /// Path of the file.
        path: String,
        /// What is wrong with it.
        message: String,
    },
    /// The Foxglove server or its recording failed.
    #[cfg(feature = "foxglove")]
    #[error("{place}: {source}")]
    Foxglove {
        /// Address or file.
        place: String,
        /// Error reported by the SDK.
        source: Box<foxglove::FoxgloveError>,
    },
}

impl PublishError {
    /// Returns whether the caller's input is at fault.
    pub fn is_input(&self) -> bool {
        match self {
            Self::Address { .. } => true,
            #[cfg(feature = "zenoh")]
            Self::Topic { .. } | Self::Body { .. } | Self::Zenoh { .. } => true,
            #[cfg(feature = "foxglove")]
            Self::Foxglove { .. } => true,
            _ => false,
        }
    }
}
