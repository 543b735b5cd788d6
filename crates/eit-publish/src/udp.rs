//! Sends lines as datagrams.

use crate::error::PublishError;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs as _, UdpSocket};

/// Sends each line as a datagram, without the line end, and never waits: if the network is down, lines are lost and
/// counted, but frames are not delayed.
///
/// ```
/// use eit_publish::{Publisher, UdpSink};
///
/// let sink = UdpSink::new("127.0.0.1:9000")?;
/// assert_eq!(sink.sent(), 0);
/// let publisher = Publisher::new().with_udp(sink);
/// # drop(publisher);
/// # Ok::<(), eit_publish::PublishError>(())
/// ```
#[derive(Debug)]
pub struct UdpSink {
    socket: UdpSocket,
    address: SocketAddr,
    sent: u64,
    unsent: u64,
    last_error: Option<io::Error>,
}

impl UdpSink {
    /// Creates a sink for HOST:PORT; no receiver needs to be listening yet.
    ///
    /// # Errors
    ///
    /// An invalid or unresolved address, or no socket.
    pub fn new(address: &str) -> Result<Self, PublishError> {
        let refuse = |error| PublishError::Address { address: address.to_owned(), error };
        let found = address.to_socket_addrs().map_err(refuse)?.next();
        let found = found
            .filter(|found| found.port() != 0)
            .ok_or_else(|| refuse(io::Error::new(ErrorKind::InvalidInput, "no host, or port 0")))?;
        Self::open(found)
            .map_err(|error| PublishError::Socket { address: address.to_owned(), error })
    }

    fn open(address: SocketAddr) -> io::Result<Self> {
        let any: SocketAddr = match address {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(any)?;
        socket.connect(address)?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, address, sent: 0, unsent: 0, last_error: None })
    }

    pub(crate) fn send(&mut self, line: &[u8]) {
        let mut outcome = self.socket.send(line);
        if matches!(&outcome, Err(error) if error.kind() == ErrorKind::ConnectionRefused) {
            // this error is about the previous datagram; the current one was not sent, and a receiver may be there by now
            outcome = self.socket.send(line);
        }
        match outcome {
            Ok(_) => self.sent += 1,
            Err(error) => {
                self.unsent += 1;
                self.last_error = Some(error);
            }
        }
    }

    /// Destination of the datagrams.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Lines that the system accepted; UDP does not report whether they were received.
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// Lines that the system did not accept.
    pub fn unsent(&self) -> u64 {
        self.unsent
    }

    /// Error of the last line that was not accepted.
    pub fn last_error(&self) -> Option<&io::Error> {
        self.last_error.as_ref()
    }
}
