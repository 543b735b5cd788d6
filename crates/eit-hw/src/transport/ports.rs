//! The serial ports of this computer.

use crate::error::HwError;

/// A serial port of this computer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortDescription {
    /// Its path or name.
    pub path: String,
    /// USB vendor, product and serial number, where it is on USB and the system tells.
    pub usb: Option<UsbDescription>,
}

/// What a USB device says about itself.
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
pub fn serial_ports() -> Result<Vec<PortDescription>, HwError> {
    let listed = serialport::available_ports().map_err(|error| HwError::Open {
        endpoint: "serial ports".into(),
        source: error.into(),
        mend: "name the port in the scene".into(),
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
