//! `eit devices`: lists serial ports, or identifies the scene's instrument.

use super::Answer;
use crate::cli::DevicesArgs;
use crate::error::CliError;
use eit_skin::scene::Scene;
use serde_json::{Value, json};

/// Lists the ports or, with a scene, identifies its instrument.
pub(crate) fn run(args: &DevicesArgs) -> Result<Answer, CliError> {
    if let Some(scene) = &args.scene {
        return ask(&Scene::load(scene)?, args.port.as_deref());
    }
    let ports = eit_hw::serial_ports()?;
    let mut lines = Vec::new();
    let mut list = Vec::new();
    for port in &ports {
        let usb = port.usb.as_ref();
        let name = usb.and_then(|usb| usb.name.clone());
        let serial = usb.and_then(|usb| usb.serial.clone());
        let ids = usb.map(|usb| format!("{:04x}:{:04x}", usb.vendor, usb.product));
        lines.push(format!(
            "{}  {}",
            port.path,
            [ids.as_deref(), name.as_deref(), serial.as_deref()]
                .into_iter()
                .flatten()
                .collect::<Vec<_>>()
                .join("  ")
        ));
        list.push(json!({ "port": port.path, "usb": ids, "name": name, "serial": serial }));
    }
    let text = match lines.is_empty() {
        true => {
            "no serial ports: plug the instrument in; for one on a network use tcp:host:port".into()
        }
        false => lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n"),
    };
    Ok(Answer { text, json: json!({ "ports": list }) })
}

fn ask(scene: &Scene, port: Option<&str>) -> Result<Answer, CliError> {
    let instrument = scene.instrument()?;
    let endpoint = instrument.endpoint(port)?;
    let setup = eit_hw::driver::identify(&mut *instrument.driver()?, &endpoint)?;
    let unit = match setup.unit {
        eit_hw::Unit::Volt => "volt",
        eit_hw::Unit::Ohm => "ohm",
        eit_hw::Unit::Arbitrary => "arbitrary",
    };
    let rate =
        setup.frame_rate_hz.map_or(String::new(), |rate| format!(", {rate} frames per second"));
    let kind = if setup.complex { "complex" } else { "real" };
    let text = format!(
        "{endpoint}: {} (driver {}), {} {kind} values per frame{rate}, unit {unit}",
        setup.identity, setup.identity.driver, setup.value_count
    );
    let json: Value = json!({
        "port": endpoint.to_string(),
        "driver": setup.identity.driver,
        "instrument": setup.identity.name,
        "serial": setup.identity.serial,
        "values": setup.value_count,
        "complex": setup.complex,
        "unit": unit,
        "frame_rate_hz": setup.frame_rate_hz,
    });
    Ok(Answer { text, json })
}
