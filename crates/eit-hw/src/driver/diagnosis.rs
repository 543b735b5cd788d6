//! Diagnoses a set-up without an answer: what was received instead, and what to change.

use crate::codec::{eits1, sciospec};
use crate::error::HwError;
use crate::transport::{Endpoint, Link};

/// With fewer bytes there is no diagnosis.
const LEAST_BYTES: usize = 48;
/// Minimum fraction of bytes that are printable or end a line, in text.
const TEXT_SHARE: f64 = 0.98;

/// Adds a diagnosis of what was received instead to the error of a set-up without an answer.
pub(super) fn explain(error: HwError, link: &mut Link) -> HwError {
    let HwError::NoReply { endpoint, driver, wanted, waited_s } = error else { return error };
    let received = link.recorded_input();
    let Some(source) = Source::of(&received).filter(|source| source.driver() != Some(driver))
    else {
        return HwError::NoReply { endpoint, driver, wanted, waited_s };
    };
    let (bytes, what) = (received.len(), source.description(driver));
    let mend = source.remedy(link.endpoint(), driver);
    HwError::NotUnderstood { endpoint, bytes, wanted, what, mend }
}

/// The likely sender of the received bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Eits1,
    Sciospec,
    /// Lines of text, most of them with this many numbers.
    Text {
        numbers: usize,
    },
    /// Text without any line end.
    Endless,
    Noise,
}

impl Source {
    /// Identifies the sender; returns `None` if there are too few bytes to tell.
    fn of(bytes: &[u8]) -> Option<Self> {
        let mut messages = 0;
        eits1::Decoder::new().push(bytes, &mut |event| {
            messages += usize::from(matches!(event, eits1::Event::Message(_)));
        });
        if messages > 0 {
            return Some(Self::Eits1);
        }
        let (mut frames, mut decoder) = (0, sciospec::Decoder::new(sciospec::Output::default()));
        // a short acknowledgement can appear by chance, a data frame cannot
        decoder.push(bytes, &mut |event| {
            frames += usize::from(matches!(event, sciospec::Event::Data(_)));
        });
        if frames > 0 {
            return Some(Self::Sciospec);
        }
        if bytes.len() < LEAST_BYTES {
            return None;
        }
        let is_text = |byte: &&u8| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t');
        let printed = bytes.iter().filter(is_text).count();
        if (printed as f64) < TEXT_SHARE * bytes.len() as f64 {
            return Some(Self::Noise);
        }
        if !bytes.iter().any(|byte| matches!(byte, b'\r' | b'\n')) {
            return Some(Self::Endless);
        }
        Some(Self::Text { numbers: numbers_of_lines(bytes) })
    }

    /// Returns the driver for this sender; `None` for text, as boards differ, and for noise.
    fn driver(self) -> Option<&'static str> {
        match self {
            Self::Eits1 => Some("eits1"),
            Self::Sciospec => Some("sciospec"),
            Self::Text { .. } | Self::Endless | Self::Noise => None,
        }
    }

    fn description(self, driver: &str) -> String {
        match self {
            Self::Eits1 => "EITS-1 messages".into(),
            Self::Sciospec => "data of a Sciospec instrument".into(),
            Self::Endless => "text without an end of line".into(),
            Self::Text { numbers } if driver == "text" => {
                format!("lines of {numbers} numbers, which this board does not send")
            }
            Self::Text { numbers } => format!("lines of text with {numbers} numbers"),
            Self::Noise => "neither text nor a message of any driver".into(),
        }
    }

    fn remedy(self, endpoint: &Endpoint, driver: &str) -> String {
        match (self, endpoint) {
            (Self::Eits1, _) => "set `[instrument] driver = \"eits1\"`".into(),
            (Self::Sciospec, _) => "set `[instrument] driver = \"sciospec\"`".into(),
            (Self::Endless, _) => {
                "check that each frame ends with a line feed, and that the scene names the right board"
                    .into()
            },
            (Self::Text { .. }, _) if driver == "text" => {
                "set `[instrument] driver` to the right board, or `\"csv\"`".into()
            }
            (Self::Text { .. }, _) => {
                "set `[instrument] driver` to the board that sends them, or `\"csv\"`".into()
            }
            (Self::Noise, Endpoint::Serial { baud, .. }) => format!(
                "the baud rate of {baud} is probably wrong: set `[instrument] baud` to the \
                 instrument's"
            ),
            (Self::Noise, Endpoint::Tcp { .. }) => "check what is at this address".into(),
        }
    }
}

/// Returns the most frequent count of numbers per line.
fn numbers_of_lines(bytes: &[u8]) -> usize {
    let text = String::from_utf8_lossy(bytes);
    let mut counts: Vec<usize> = text
        .lines()
        .map(|line| {
            let fields = line.split([',', ';', '\t', ' ', ':']);
            fields
                .filter(|field| field.starts_with(|c: char| c.is_ascii_digit() || c == '-'))
                .count()
        })
        .filter(|&count| count > 0)
        .collect();
    counts.sort_unstable();
    let longest = counts.chunk_by(|a, b| a == b).max_by_key(|run| run.len());
    longest.map_or(0, |run| run[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_told_apart() {
        let lines = "0.25,1.5,-3\r\n".repeat(20);
        assert_eq!(Source::of(lines.as_bytes()), Some(Source::Text { numbers: 3 }));
        assert_eq!(Source::of(b"12,"), None);
        let endless = Source::of("0.25,".repeat(40).as_bytes()).unwrap();
        assert_eq!(endless, Source::Endless);
        assert_eq!(endless.description("text"), "text without an end of line");
        let noise: Vec<u8> = (0..200_u32).map(|i| (i * i * 31 + 128) as u8).collect();
        assert_eq!(Source::of(&noise), Some(Source::Noise));
        let mut wire = vec![0x77, 0];
        let message = eits1::Message {
            kind: eits1::Kind::Text,
            sequence: 0,
            device_time_us: 0,
            flags: 0,
            count: 2,
            payload: b"hi",
        };
        eits1::encode(&message, &mut wire).unwrap();
        assert_eq!(Source::of(&wire), Some(Source::Eits1));
        let mut wire = Vec::new();
        let data = sciospec::DataFrame {
            group: 1,
            drive: Some([1, 2]),
            frequency_row: Some(1),
            time_ms: Some(5),
            potentials_v: [[0.5, 0.0]; 16],
        };
        sciospec::encode_data(&data, &mut wire);
        assert_eq!(Source::of(&wire), Some(Source::Sciospec));
    }
}
