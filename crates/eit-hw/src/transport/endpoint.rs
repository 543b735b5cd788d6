//! Address of an instrument.

use std::fmt;

use crate::error::HwError;

/// Port or address of an instrument.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Endpoint {
    /// A serial port with 8 data bits, no parity, one stop bit and no flow control.
    Serial {
        /// Path or name of the port, such as `/dev/ttyACM0` or `COM3`.
        path: String,
        /// Baud rate; USB CDC devices ignore it.
        baud: u32,
        /// State of the DTR line on opening: raised or lowered; `None` leaves it unchanged. Some
        /// boards wait for it, others restart on it.
        dtr: Option<bool>,
    },
    /// A TCP server, `host:port`.
    Tcp {
        /// Address of the server.
        address: String,
    },
}

impl Endpoint {
    /// Parses `tcp:host:port`, or otherwise the name of a serial port, which is used at this baud
    /// rate.
    ///
    /// # Errors
    /// [`HwError::Setting`] for an empty name, a TCP address without port, or a rate of 0.
    pub fn parse(text: &str, baud: u32) -> Result<Self, HwError> {
        let refuse = |wanted| Err(HwError::setting("port", format!("{text:?}"), wanted));
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
        HwError::require(baud > 0, "baud", baud, "more than 0")?;
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
