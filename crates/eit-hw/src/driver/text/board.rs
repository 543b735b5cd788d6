//! Boards by name, and how to communicate with them.

use crate::codec::text::TextFormat;
use crate::error::HwError;
use crate::frame::Quadruple;
use crate::recording::{Layout, Unit};

/// One step of a board's set-up: what to send, and the expected answer.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Step {
    /// Text to send, including the line end.
    pub send: String,
    /// Text that a following line must contain; `None` to wait for no answer.
    pub expect: Option<String>,
}

/// A board and how to communicate with it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Board {
    /// Name by which scenes choose the board.
    pub name: String,
    /// Baud rate of the serial line.
    pub baud: u32,
    /// Layout of its frames.
    pub format: TextFormat,
    /// Steps that set it up.
    pub steps: Vec<Step>,
    /// Text that requests one frame; `None` if the board streams by itself.
    pub request: Option<String>,
    /// Electrodes of each value.
    pub layout: Layout,
    /// Unit of the scaled values.
    pub unit: Unit,
    /// Seconds within which the first complete frame must arrive; otherwise it is another board or
    /// baud rate.
    pub first_frame_s: f64,
}

impl Board {
    /// Names accepted by [`Board::preset`].
    pub const PRESETS: [&'static str; 7] = [
        "openeit-8",
        "openeit-16",
        "openeit-32",
        "cn0565-16",
        "black-sensor-16",
        "eit-microcontroller-16",
        "serial-16",
    ];

    /// Returns a public board by name; the presets of [`TextFormat`] name the sources. Not verified
    /// on hardware.
    ///
    /// # Errors
    /// [`HwError::Setting`] lists the valid names.
    pub fn preset(name: &str) -> Result<Self, HwError> {
        let open_eit = |electrodes: u32, letter: &str| {
            let format = TextFormat::open_eit(electrodes).unwrap_or_default();
            let order = loops(electrodes, electrodes / 2, false, |a, b, m, n| [a, b, n, m]);
            let board = Self::new(name, 115_200, format, Layout::Quadruples(order));
            // the board's receive buffer holds two bytes, and it answers with a banner
            let steps = vec![Step { send: format!("{letter}\n"), expect: Some("mode".into()) }];
            Self { steps, unit: Unit::Ohm, ..board }
        };
        let adjacent = || loops(16, 1, false, |a, b, m, n| [a, b, m, n]);
        match name {
            "openeit-8" => Ok(open_eit(8, "c")),
            "openeit-16" => Ok(open_eit(16, "d")),
            "openeit-32" => Ok(open_eit(32, "e")),
            "cn0565-16" => {
                let layout = Layout::Quadruples(adjacent());
                let board = Self::new(name, 230_400, TextFormat::cn0565(), layout);
                let send = "C 10,16,1,1,0\n".into();
                let steps = vec![Step { send, expect: Some("!C OK".into()) }];
                Ok(Self { steps, request: Some("V \n".into()), ..board })
            }
            "black-sensor-16" => {
                // row r: source r + 1, sink r; column k: measured pair (k + 1, k)
                let order = loops(16, 1, true, |a, b, m, n| [b, a, n, m]);
                let layout = Layout::Quadruples(order);
                Ok(Self::new(name, 115_200, TextFormat::black_sensor(), layout))
            }
            "eit-microcontroller-16" => {
                let layout = Layout::Quadruples(adjacent());
                let board = Self::new(name, 115_200, TextFormat::eit_microcontroller(), layout);
                Ok(Self { request: Some("D".into()), unit: Unit::Volt, ..board })
            }
            "serial-16" => {
                let order = (0..16_u32)
                    .flat_map(|d| {
                        (2..15).map(move |k| [d, d + 1, d + k, d + k + 1].map(|e| e % 16))
                    })
                    .collect();
                let layout = Layout::Quadruples(order);
                Ok(Self::new(name, 115_200, TextFormat::serial_16(), layout))
            }
            _ => Err(HwError::setting(
                "board",
                format!("{:?}", crate::error::shortened(name)),
                "openeit-8, openeit-16, openeit-32, cn0565-16, black-sensor-16, \
                         eit-microcontroller-16 or serial-16",
            )),
        }
    }

    /// Creates a board that streams frames of this format by itself, with values of unknown scale.
    pub fn new(name: &str, baud: u32, format: TextFormat, layout: Layout) -> Self {
        Self {
            name: name.to_owned(),
            baud,
            format,
            steps: Vec::new(),
            request: None,
            layout,
            unit: Unit::Arbitrary,
            first_frame_s: 5.0,
        }
    }
}

/// Returns drives (a, a + offset) and measured pairs (m, m + 1), both ascending, as most boards
/// loop.
fn loops(
    count: u32,
    offset: u32,
    keep_driven: bool,
    order: impl Fn(u32, u32, u32, u32) -> Quadruple,
) -> Vec<Quadruple> {
    let mut quadruples = Vec::new();
    for a in 0..count {
        let b = (a + offset) % count;
        for m in 0..count {
            let n = (m + 1) % count;
            if keep_driven || ![m, n].iter().any(|e| [a, b].contains(e)) {
                quadruples.push(order(a, b, m, n));
            }
        }
    }
    quadruples
}
