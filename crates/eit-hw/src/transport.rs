//! Bytes to and from an instrument: serial ports (feature `serial`) and TCP.

use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use crate::error::HwError;

/// Longest wait of one read: so fast does a reader thread see that it should stop.
const POLL: Duration = Duration::from_millis(20);
/// Longest time a command may take to leave.
const WRITE_LIMIT: Duration = Duration::from_secs(2);
const CONNECT_LIMIT: Duration = Duration::from_secs(3);

/// Where an instrument is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// A serial port with 8 data bits, no parity, one stop bit and no flow control.
    Serial {
        /// Its path or name, such as `/dev/ttyACM0` or `COM3`.
        path: String,
        /// Bits a second; USB CDC devices ignore it.
        baud: u32,
        /// Whether the line DTR is raised or lowered on opening; `None` leaves it. Some boards wait
        /// for it, others restart on it.
        dtr: Option<bool>,
    },
    /// A TCP server, `host:port`.
    Tcp {
        /// Its address.
        address: String,
    },
}

impl Endpoint {
    /// The endpoint that a text names: `tcp:host:port`, else a serial port with this rate.
    ///
    /// # Errors
    /// [`HwError::Setting`] for an empty name, a TCP address without port, or a rate of 0.
    pub fn parse(text: &str, baud: u32) -> Result<Self, HwError> {
        let refuse =
            |wanted| Err(HwError::Setting { name: "port", value: format!("{text:?}"), wanted });
        if let Some(address) = text.strip_prefix("tcp:") {
            let port = address.rsplit_once(':').filter(|(host, _)| !host.is_empty());
            return match port.map(|(_, port)| port.parse::<u16>()) {
                Some(Ok(_)) => Ok(Self::Tcp { address: address.to_owned() }),
                _ => refuse("`tcp:host:port`, such as `tcp:192.168.0.5:5000`"),
            };
        }
        if text.trim().is_empty() {
            return refuse("a serial port such as `/dev/ttyACM0` or `COM3`, or `tcp:host:port`");
        }
        if baud == 0 {
            return Err(HwError::Setting { name: "baud", value: "0".into(), wanted: "a rate" });
        }
        Ok(Self::Serial { path: text.to_owned(), baud, dtr: None })
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial { path, .. } => f.write_str(path),
            Self::Tcp { address } => write!(f, "tcp:{address}"),
        }
    }
}

trait Port: Read + Write + Send {}
impl<T: Read + Write + Send> Port for T {}

/// An open connection to an instrument.
pub struct Link {
    endpoint: Endpoint,
    port: Box<dyn Port>,
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
    /// [`HwError::Open`] with what the system says and what to try.
    pub fn open(endpoint: &Endpoint) -> Result<Self, HwError> {
        let port = match endpoint {
            Endpoint::Serial { path, baud, dtr } => serial(path, *baud, *dtr),
            Endpoint::Tcp { address } => tcp(address),
        };
        match port {
            Ok(port) => Ok(Self { endpoint: endpoint.clone(), port }),
            Err(source) => {
                let mend = advice(endpoint, source.kind());
                Err(HwError::Open { endpoint: endpoint.to_string(), source, mend })
            }
        }
    }

    /// Where it leads.
    pub fn endpoint(&self) -> &Endpoint {
        &self.endpoint
    }

    /// Bytes that have arrived, 0 where none came within about 20 ms.
    ///
    /// # Errors
    /// [`HwError::Lost`] once the other side is gone.
    pub fn read(&mut self, buffer: &mut [u8]) -> Result<usize, HwError> {
        match self.port.read(buffer) {
            Ok(0) => Err(self.lost(io::Error::new(ErrorKind::UnexpectedEof, "closed"))),
            Ok(count) => Ok(count),
            Err(error) if is_wait(&error) => Ok(0),
            Err(error) => Err(self.lost(error)),
        }
    }

    /// Sends all bytes.
    ///
    /// # Errors
    /// [`HwError::Lost`] where the other side is gone or takes nothing for 2 s.
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
        self.port
            .flush()
            .or_else(|error| if is_wait(&error) { Ok(()) } else { Err(self.lost(error)) })
    }

    /// Throws bytes away until none come for `quiet`, at most for `most`; whether it got quiet.
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

fn advice(endpoint: &Endpoint, kind: ErrorKind) -> &'static str {
    match (endpoint, kind) {
        (_, ErrorKind::Unsupported) => "build eit-hw with its feature `serial`",
        (Endpoint::Serial { .. }, ErrorKind::NotFound) => "plug it in, or name another port",
        (Endpoint::Serial { .. }, ErrorKind::PermissionDenied) => {
            "let your user use serial ports (on Linux: join the group `dialout`)"
        }
        (Endpoint::Serial { .. }, _) => "close other programs that use the port",
        (Endpoint::Tcp { .. }, _) => "check the address, and that the instrument is on",
    }
}

fn tcp(address: &str) -> io::Result<Box<dyn Port>> {
    let mut last = io::Error::new(ErrorKind::NotFound, "the name has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_LIMIT) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(POLL))?;
                stream.set_write_timeout(Some(POLL))?;
                return Ok(Box::new(stream));
            }
            Err(error) => last = error,
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
    // what a former owner of the port left; a device still sending is drained by its driver
    port.clear(serialport::ClearBuffer::Input).map_err(io::Error::from)?;
    Ok(Box::new(port))
}

#[cfg(not(feature = "serial"))]
fn serial(_: &str, _: u32, _: Option<bool>) -> io::Result<Box<dyn Port>> {
    Err(io::Error::new(ErrorKind::Unsupported, "no serial ports in this build"))
}

/// A serial port of this computer.
#[cfg(feature = "serial")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortDescription {
    /// Its path or name.
    pub path: String,
    /// USB vendor, product and serial number, where it is on USB and the system tells.
    pub usb: Option<UsbDescription>,
}

/// What a USB device says about itself.
#[cfg(feature = "serial")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbDescription {
    /// Vendor identifier.
    pub vendor: u16,
    /// Product identifier.
    pub product: u16,
    /// Serial number.
    pub serial: Option<String>,
    /// Maker and product as text.
    pub name: Option<String>,
}

/// The serial ports of this computer, by name. Without libudev a Linux may list ports that have no
/// hardware.
///
/// # Errors
/// [`HwError::Open`] where the system does not list them.
#[cfg(feature = "serial")]
pub fn serial_ports() -> Result<Vec<PortDescription>, HwError> {
    let listed = serialport::available_ports().map_err(|error| HwError::Open {
        endpoint: "serial ports".into(),
        source: error.into(),
        mend: "name the port in the scene",
    })?;
    let usb = |kind: serialport::SerialPortType| match kind {
        serialport::SerialPortType::UsbPort(usb) => Some(UsbDescription {
            vendor: usb.vid,
            product: usb.pid,
            serial: usb.serial_number,
            name: match (usb.manufacturer, usb.product) {
                (Some(maker), Some(product)) => Some(format!("{maker} {product}")),
                (maker, product) => maker.or(product),
            },
        }),
        _ => None,
    };
    let mut ports: Vec<_> = listed
        .into_iter()
        .map(|port| PortDescription { path: port.port_name, usb: usb(port.port_type) })
        .collect();
    ports.sort_by(|one, other| one.path.cmp(&other.path));
    Ok(ports)
}
