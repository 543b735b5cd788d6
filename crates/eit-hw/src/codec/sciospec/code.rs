//! System messages of Sciospec instruments.

/// A system message: the answer to a command, or a status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Code {
    /// 01: the command's syntax was wrong.
    Syntax,
    /// 02: a command was interrupted for more than 10 ms.
    Timeout,
    /// 04: the device has started.
    Booted,
    /// 11: a TCP client has connected.
    TcpConnected,
    /// 81: the command was not executed.
    NotExecuted,
    /// 82: unknown command.
    Unknown,
    /// 83: the command was executed.
    Executed,
    /// 84: the system is ready.
    Ready,
    /// 91 or 92, depending on the source: data was held up.
    HoldUp(u8),
    /// Any other.
    Other(u8),
}

impl Code {
    /// Decodes the byte of a message.
    pub const fn of(byte: u8) -> Self {
        match byte {
            0x01 => Self::Syntax,
            0x02 => Self::Timeout,
            0x04 => Self::Booted,
            0x11 => Self::TcpConnected,
            0x81 => Self::NotExecuted,
            0x82 => Self::Unknown,
            0x83 => Self::Executed,
            0x84 => Self::Ready,
            0x91 | 0x92 => Self::HoldUp(byte),
            other => Self::Other(other),
        }
    }

    /// Returns the byte of this code.
    pub const fn byte(self) -> u8 {
        match self {
            Self::Syntax => 0x01,
            Self::Timeout => 0x02,
            Self::Booted => 0x04,
            Self::TcpConnected => 0x11,
            Self::NotExecuted => 0x81,
            Self::Unknown => 0x82,
            Self::Executed => 0x83,
            Self::Ready => 0x84,
            Self::HoldUp(byte) | Self::Other(byte) => byte,
        }
    }

    /// Returns why a command failed, for codes that say so.
    pub const fn failure(self) -> Option<&'static str> {
        match self {
            Self::Syntax => Some("wrong syntax"),
            Self::Timeout => Some("the command was interrupted"),
            Self::NotExecuted => Some("not executed"),
            Self::Unknown => Some("unknown command"),
            _ => None,
        }
    }
}
