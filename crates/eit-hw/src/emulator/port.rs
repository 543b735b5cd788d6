//! The instrument's end of a connection.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use crate::error::HwError;
use crate::transport::Endpoint;

/// Polling interval of the emulator.
const POLL: Duration = Duration::from_millis(2);

/// Where an emulator accepts connections.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Listen {
    /// A TCP address, such as `127.0.0.1:0` for a free port.
    Tcp(String),
    /// A new pseudo-terminal, reached through a symbolic link at this path, so that the path stays
    /// the same when the instrument is plugged in again. Nothing may exist at the path.
    #[cfg(all(unix, feature = "serial"))]
    PseudoTerminal(std::path::PathBuf),
}

#[derive(Debug)]
pub(super) enum Host {
    Tcp {
        listener: Option<TcpListener>,
        address: std::net::SocketAddr,
        stream: Option<TcpStream>,
    },
    #[cfg(all(unix, feature = "serial"))]
    Terminal {
        link: std::path::PathBuf,
        master: Option<serialport::TTYPort>,
        open: bool,
    },
}

impl Host {
    pub(super) fn new(listen: &Listen) -> Result<Self, HwError> {
        let opened = match listen {
            Listen::Tcp(address) => TcpListener::bind(address).and_then(|listener| {
                listener.set_nonblocking(true)?;
                let address = listener.local_addr()?;
                Ok(Self::Tcp { listener: Some(listener), address, stream: None })
            }),
            #[cfg(all(unix, feature = "serial"))]
            Listen::PseudoTerminal(link) => terminal(link).map(|master| Self::Terminal {
                link: link.clone(),
                master: Some(master),
                open: false,
            }),
        };
        let name = match listen {
            Listen::Tcp(address) => format!("tcp:{address}"),
            #[cfg(all(unix, feature = "serial"))]
            Listen::PseudoTerminal(link) => link.display().to_string(),
        };
        opened.map_err(|source| HwError::Open {
            endpoint: name,
            source,
            mend: "choose another one".into(),
        })
    }

    pub(super) fn endpoint(&self) -> Endpoint {
        match self {
            Self::Tcp { address, .. } => Endpoint::Tcp { address: address.to_string() },
            #[cfg(all(unix, feature = "serial"))]
            Self::Terminal { link, .. } => {
                Endpoint::Serial { path: link.display().to_string(), baud: 115_200, dtr: None }
            }
        }
    }

    /// Returns whether a host is connected.
    pub(super) fn is_open(&self) -> bool {
        match self {
            Self::Tcp { stream, .. } => stream.is_some(),
            #[cfg(all(unix, feature = "serial"))]
            Self::Terminal { open, .. } => *open,
        }
    }

    /// Returns the baud rate set by the host; `None` if there is none.
    pub(super) fn baud(&self) -> Option<u32> {
        match self {
            Self::Tcp { .. } => None,
            #[cfg(all(unix, feature = "serial"))]
            Self::Terminal { master, open, .. } => {
                use serialport::SerialPort;
                master.as_ref().filter(|_| *open).and_then(|master| master.baud_rate().ok())
            }
        }
    }

    /// Reads bytes from the host; returns 0 after a short wait.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> usize {
        match self {
            Self::Tcp { listener, stream, .. } => {
                accept(listener.as_ref(), stream);
                let Some(open) = stream else {
                    std::thread::sleep(POLL);
                    return 0;
                };
                match open.read(buffer) {
                    Ok(count) if count > 0 => count,
                    Err(error) if is_wait(&error) => 0,
                    _ => {
                        *stream = None;
                        0
                    }
                }
            }
            #[cfg(all(unix, feature = "serial"))]
            Self::Terminal { master, open, .. } => {
                let read = master.as_mut().map(|master| master.read(buffer));
                // reading fails while no host has the terminal open
                *open = matches!(&read, Some(Ok(_)))
                    || matches!(&read, Some(Err(error)) if is_wait(error));
                match read {
                    Some(Ok(count)) => count,
                    _ => {
                        if !*open {
                            std::thread::sleep(POLL);
                        }
                        0
                    }
                }
            }
        }
    }

    /// Returns how many of the bytes were taken.
    pub(super) fn write(&mut self, bytes: &[u8]) -> usize {
        let written = match self {
            Self::Tcp { stream, .. } => stream.as_mut().map(|stream| stream.write(bytes)),
            #[cfg(all(unix, feature = "serial"))]
            Self::Terminal { master, .. } => master.as_mut().map(|master| master.write(bytes)),
        };
        match written {
            Some(Ok(count)) => count,
            // a broken connection is detected when reading
            _ => 0,
        }
    }

    pub(super) fn unplug(&mut self) {
        match self {
            Self::Tcp { listener, stream, .. } => (*listener, *stream) = (None, None),
            #[cfg(all(unix, feature = "serial"))]
            Self::Terminal { link, master, open } => {
                // remove the path first: once the terminal is closed, its name may be reused. It
                // does not matter if the path is gone already
                if std::fs::read_link(&*link).is_ok_and(|to| to.starts_with("/dev/pts")) {
                    let _ = std::fs::remove_file(link);
                }
                (*master, *open) = (None, false);
            }
        }
    }

    /// Plugs the instrument in again; if that fails, it stays unplugged.
    pub(super) fn plug(&mut self) {
        match self {
            Self::Tcp { listener, address, .. } => {
                *listener = TcpListener::bind(*address)
                    .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
                    .ok();
            }
            #[cfg(all(unix, feature = "serial"))]
            Self::Terminal { link, master, .. } => *master = terminal(link).ok(),
        }
    }
}

#[cfg(all(unix, feature = "serial"))]
impl Drop for Host {
    fn drop(&mut self) {
        if matches!(self, Self::Terminal { .. }) {
            self.unplug();
        }
    }
}

fn accept(listener: Option<&TcpListener>, stream: &mut Option<TcpStream>) {
    let Some(Ok((new, _))) = listener.map(TcpListener::accept) else { return };
    // one host at a time, as on a serial line; the next one once it has disconnected
    if stream.as_ref().is_some_and(is_there) {
        return;
    }
    let ready = new
        .set_nonblocking(false)
        .and_then(|()| new.set_nodelay(true))
        .and_then(|()| new.set_read_timeout(Some(POLL)))
        .and_then(|()| new.set_write_timeout(Some(POLL)));
    *stream = ready.is_ok().then_some(new);
}

/// Returns whether the other side of a connection is still there.
fn is_there(stream: &TcpStream) -> bool {
    match stream.peek(&mut [0]) {
        Ok(count) => count > 0,
        Err(error) => is_wait(&error),
    }
}

fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Opens a new pseudo-terminal and links its other end at `link`.
#[cfg(all(unix, feature = "serial"))]
fn terminal(link: &std::path::Path) -> io::Result<serialport::TTYPort> {
    use serialport::SerialPort;
    let (mut master, slave) = serialport::TTYPort::pair().map_err(io::Error::from)?;
    master.set_timeout(POLL).map_err(io::Error::from)?;
    let name = slave.name().ok_or_else(|| io::Error::other("the terminal has no name"))?;
    std::os::unix::fs::symlink(name, link)?;
    Ok(master)
}
