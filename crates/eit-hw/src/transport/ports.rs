//! The serial ports of this computer.

use crate::error::HwError;

/// A serial port of this computer.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct PortDescription {
    /// Path or name of the port.
    pub path: String,
    /// USB identification, if the port is on USB and the system provides it.
    pub usb: Option<UsbDescription>,
}

/// Identification reported by a USB device.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct UsbDescription {
    /// Vendor identifier.
    pub vendor: u16,
    /// Product identifier.
    pub product: u16,
    /// Serial number.
    pub serial: Option<String>,
    /// Manufacturer and product as text.
    pub name: Option<String>,
}

/// Returns the serial ports of this computer, sorted by name. Without libudev, Linux may list ports
/// that have no hardware.
///
/// # Errors
/// [`HwError::Open`] if the system cannot list them.
pub fn serial_ports() -> Result<Vec<PortDescription>, HwError> {
    let listed = serialport::available_ports().map_err(|error| HwError::Open {
        endpoint: "serial ports".into(),
        source: error.into(),
        mend: "set the port in the scene".into(),
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
