//! Errors of this crate.

use std::io;

/// Why touches cannot be published.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PublishError {
    /// No address that datagrams can go to.
    #[error("{address}: {error}; give HOST:PORT, such as 127.0.0.1:9000")]
    Address {
        /// What was given.
        address: String,
        /// What is wrong with it.
        error: io::Error,
    },
    /// No socket for datagrams.
    #[error("{address}: no UDP socket: {error}")]
    Socket {
        /// Where datagrams should have gone.
        address: String,
        /// What the system says.
        error: io::Error,
    },
    /// A line could not be written.
    #[error("cannot write a line of touches: {0}")]
    Write(#[from] io::Error),
    /// A line could not be encoded.
    #[error("cannot encode a line of touches: {0}")]
    Encode(#[from] serde_json::Error),
}

impl PublishError {
    /// Whether what was given is wrong, rather than what happened.
    pub fn is_input(&self) -> bool {
        matches!(self, Self::Address { .. })
    }
}
