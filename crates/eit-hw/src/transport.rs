//! Bytes to and from an instrument: serial ports (feature `serial`) and TCP.

mod advice;
mod endpoint;
#[cfg(feature = "serial")]
mod ports;
mod users;

pub use endpoint::Endpoint;
#[cfg(feature = "serial")]
pub use ports::{PortDescription, UsbDescription, serial_ports};

use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use self::advice::advice;
use crate::error::HwError;

/// Longest wait of one read, and thus the delay until a reader thread notices that it should stop.
const POLL: Duration = Duration::from_millis(20);
/// Longest time to send a command.
const WRITE_LIMIT: Duration = Duration::from_secs(2);
/// Time limit and number of attempts for a TCP connection; between attempts a stop is noticed.
const CONNECT_LIMIT: Duration = Duration::from_secs(1);
const CONNECT_TRIES: usize = 3;
/// Number of bytes kept of what was received during set-up.
const MAX_RECORDED: usize = 4096;

trait Port: Read + Write + Send {}
impl<T: Read + Write + Send> Port for T {}

/// An open connection to an instrument.
pub struct Link {
    endpoint: Endpoint,
    port: Box<dyn Port>,
    /// Ends reads and waits when set.
    quit: Arc<AtomicBool>,
    /// The last bytes received; `None` if they are not recorded.
    recorded: Option<Vec<u8>>,
}

impl fmt::Debug for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link").field("endpoint", &self.endpoint).finish_non_exhaustive()
    }
}

impl Link {
    /// Opens the connection.
    ///
    /// # Errors
    /// [`HwError::Open`] with the system's error and what to try.
    pub fn open(endpoint: &Endpoint) -> Result<Self, HwError> {
        Self::open_until(endpoint, Arc::default())
    }

    /// Opens the connection; once `quit` is set, reads and waits end with [`HwError::Lost`].
    pub(crate) fn open_until(endpoint: &Endpoint, quit: Arc<AtomicBool>) -> Result<Self, HwError> {
        let port = match endpoint {
            Endpoint::Serial { path, baud, dtr } => serial(path, *baud, *dtr),
            Endpoint::Tcp { address } => tcp(address, &quit),
        };
        match port {
            Ok(port) => Ok(Self { endpoint: endpoint.clone(), port, quit, recorded: None }),
            Err(source) => {
                let mend = advice(endpoint, &source);
                Err(HwError::Open { endpoint: endpoint.to_string(), source, mend })
            }
        }
    }

    /// Starts recording what is received; keeps the last 4 KiB.
    pub(crate) fn record_input(&mut self) {
        self.recorded = Some(Vec::new());
    }

    /// Returns what was received since [`record_input`](Self::record_input), and stops recording.
    pub(crate) fn recorded_input(&mut self) -> Vec<u8> {
        self.recorded.take().unwrap_or_default()
    }

    /// Returns the endpoint of the connection.
    pub fn endpoint(&self) -> &Endpoint {
        &self.endpoint
    }

    /// Reads bytes that have arrived; returns 0 if none came within about 20 ms.
    ///
    /// # Errors
    /// [`HwError::Lost`] once the other side is gone.
    pub fn read(&mut self, buffer: &mut [u8]) -> Result<usize, HwError> {
        if self.quit.load(Ordering::Relaxed) {
            return Err(self.lost(io::Error::new(ErrorKind::Interrupted, "stopped")));
        }
        match self.port.read(buffer) {
            Ok(0) => Err(self.lost(io::Error::new(ErrorKind::UnexpectedEof, "closed"))),
            Ok(count) => {
                if let Some(recorded) = &mut self.recorded {
                    recorded.extend(&buffer[..count]);
                    let old = recorded.len().saturating_sub(MAX_RECORDED);
                    recorded.drain(..old);
                }
                Ok(count)
            }
            Err(error) if is_wait(&error) => Ok(0),
            Err(error) => Err(self.lost(error)),
        }
    }

    /// Sends all bytes to the operating system.
    ///
    /// # Errors
    /// [`HwError::Lost`] if the other side is gone or accepts nothing for 2 s.
    pub fn write(&mut self, mut bytes: &[u8]) -> Result<(), HwError> {
        let limit = Instant::now() + WRITE_LIMIT;
        while !bytes.is_empty() {
            match self.port.write(bytes) {
                Ok(0) => {
                    return Err(self.lost(io::Error::new(ErrorKind::WriteZero, "nothing taken")));
                }
                Ok(count) => bytes = &bytes[count..],
                Err(error) if is_wait(&error) && Instant::now() < limit => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
        // the kernel has the bytes. Waiting until they are sent could take forever: nothing ends
        // that wait if the other side accepts nothing
        Ok(())
    }

    /// Discards bytes until none come for `quiet`, but for at most `most`; returns whether the line
    /// fell silent.
    ///
    /// # Errors
    /// [`HwError::Lost`] once the other side is gone.
    pub fn drain(&mut self, quiet: Duration, most: Duration) -> Result<bool, HwError> {
        let (start, mut last) = (Instant::now(), Instant::now());
        let mut buffer = [0; 4096];
        while last.elapsed() < quiet {
            if start.elapsed() > most {
                return Ok(false);
            }
            if self.read(&mut buffer)? > 0 {
                last = Instant::now();
            }
        }
        Ok(true)
    }

    fn lost(&self, source: io::Error) -> HwError {
        HwError::Lost { endpoint: self.endpoint.to_string(), source }
    }
}

fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

fn tcp(address: &str, quit: &AtomicBool) -> io::Result<Box<dyn Port>> {
    let mut last = io::Error::new(ErrorKind::NotFound, "the host name has no address");
    let addresses: Vec<SocketAddr> = address.to_socket_addrs()?.collect();
    for _ in 0..CONNECT_TRIES {
        let mut is_slow = false;
        for address in &addresses {
            if quit.load(Ordering::Relaxed) {
                return Err(io::Error::new(ErrorKind::Interrupted, "stopped"));
            }
            match TcpStream::connect_timeout(address, CONNECT_LIMIT) {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    stream.set_read_timeout(Some(POLL))?;
                    stream.set_write_timeout(Some(POLL))?;
                    return Ok(Box::new(stream));
                }
                Err(error) => {
                    is_slow |= error.kind() == ErrorKind::TimedOut;
                    last = error;
                }
            }
        }
        // if the connection is refused now, it will be refused in the next moment, too
        if !is_slow {
            break;
        }
    }
    Err(last)
}

#[cfg(feature = "serial")]
fn serial(path: &str, baud: u32, dtr: Option<bool>) -> io::Result<Box<dyn Port>> {
    let mut builder = serialport::new(path, baud).timeout(POLL);
    builder = match dtr {
        Some(state) => builder.dtr_on_open(state),
        None => builder.preserve_dtr_on_open(),
    };
    let port = builder.open().map_err(io::Error::from)?;
    // discard what a previous user of the port left; a device still sending is drained by its
    // driver
    port.clear(serialport::ClearBuffer::Input).map_err(io::Error::from)?;
    Ok(Box::new(port))
}

#[cfg(not(feature = "serial"))]
fn serial(_: &str, _: u32, _: Option<bool>) -> io::Result<Box<dyn Port>> {
    Err(io::Error::new(ErrorKind::Unsupported, "no serial ports in this build"))
}
