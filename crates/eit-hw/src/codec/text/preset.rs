//! Formats of public boards, from their firmware; none verified on hardware.

use super::format::{Framing, TextFormat};
use super::number::Number;

impl TextFormat {
    /// OpenEIT / Spectra (ADuCM350): `magnitudes: ` and 32, 192 or 896 magnitudes in ohms, for 8,
    /// 16 or 32 electrodes; `None` for another number. Opposite drive, adjacent measurement. 0.0000
    /// means an open circuit, 134217727.9375 (0x7FFFFFFF with four fractional bits) saturation.
    ///
    /// Source: github.com/OpenEIT/EIT_Firmware.
    pub fn open_eit(electrodes: u32) -> Option<Self> {
        let values_per_line = match electrodes {
            8 => 32,
            16 => 192,
            32 => 896,
            _ => return None,
        };
        Some(Self {
            framing: Framing::Prefix("magnitudes".into()),
            values_per_line,
            saturated_from: Some(134_217_727.0),
            open_up_to: Some(0.0),
            ..Self::default()
        })
    }

    /// EVAL-CN0565 with 16 electrodes, adjacent drive and measurement: `!V` and 208 complex
    /// voltages as unpadded hexadecimal integers, in arbitrary units. The codes have 18 bits.
    ///
    /// Source: Analog Devices' interactive firmware of the CN0565.
    pub fn cn0565() -> Self {
        Self {
            framing: Framing::Prefix("!V".into()),
            values_per_line: 416,
            number: Number::HexInteger,
            complex: true,
            saturated_from: Some(131_071.0),
            ..Self::default()
        }
    }

    /// The skin board `black_sensor` (ESP32): a line `A`, then 16 lines of 16 counts, which include
    /// the driven electrodes.
    ///
    /// The converter has 16 bits, and its largest count means saturation: logs of 2022 hold sound
    /// counts up to 39 000. A later firmware sends the difference from half the scale; its rails
    /// (32 533 in its source) are calibrated per board and are not flagged.
    ///
    /// Source: github.com/richgumy/black_sensor.
    pub fn black_sensor() -> Self {
        Self {
            framing: Framing::StartLine("A".into()),
            lines_per_frame: 16,
            values_per_line: 16,
            saturated_from: Some(65_535.0),
            ..Self::default()
        }
    }

    /// EIT-Microcontroller (ESP32-S2 with ADS1115): 208 lines of volts, then `Done`.
    ///
    /// Source: github.com/RonAaron61/EIT-Microcontroller.
    pub fn eit_microcontroller() -> Self {
        Self {
            framing: Framing::EndLine("Done".into()),
            lines_per_frame: 208,
            values_per_line: 1,
            ..Self::default()
        }
    }

    /// The 16-electrode instrument whose logs are [`Format::SerialLog`](crate::Format): a line `s`,
    /// then 16 lines of 13 decimal numbers; full scale 6.55.
    pub fn serial_16() -> Self {
        Self {
            framing: Framing::StartLine("s".into()),
            lines_per_frame: 16,
            values_per_line: 13,
            saturated_from: Some(6.55),
            ..Self::default()
        }
    }

    /// Plain CSV: one frame of `values` decimal numbers per line.
    pub fn csv(values: usize) -> Self {
        Self { values_per_line: values, ..Self::default() }
    }
}
