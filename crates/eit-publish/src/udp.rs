//! Lines as datagrams.

use crate::error::PublishError;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs as _, UdpSocket};

/// Sends each line as a datagram, without its line end, and never waits: a network that is gone costs
/// lines, which are counted, and not the frames of the skin.
#[derive(Debug)]
pub struct UdpSink {
    socket: UdpSocket,
    address: SocketAddr,
    sent: u64,
    unsent: u64,
    last_error: Option<io::Error>,
}

impl UdpSink {
    /// To HOST:PORT; nobody needs to listen there yet.
    ///
    /// # Errors
    ///
    /// An address that is none or is not found; no socket.
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
            // told of the datagram before this one, which was not sent: somebody may listen by now
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

    /// Where datagrams go.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Lines that the system took; UDP does not say who received them.
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// Lines that it did not take.
    pub fn unsent(&self) -> u64 {
        self.unsent
    }

    /// Why it did not take the last of them.
    pub fn last_error(&self) -> Option<&io::Error> {
        self.last_error.as_ref()
    }
}
