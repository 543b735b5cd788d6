//! Our own emulated device behind TCP, with interference in between.

use super::{SMALL, eit, text, write_scene};
use eit_hw::codec::eits1::Information;
use eit_hw::emulator::{Device, Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Quadruple, Unit};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Duration;

/// Information reported by a device with this number of electrodes.
pub fn information(electrodes: u16, name: &str) -> Information {
    Information {
        electrodes,
        max_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: f32::INFINITY,
        unit: Unit::Volt,
        complex: false,
        name: name.into(),
        serial: "7".into(),
    }
}

/// A faultless device with 8 electrodes.
pub fn device(name: &str) -> Box<dyn Device> {
    let source = |sequence: u64, quadruples: &[Quadruple], values: &mut [f64]| {
        for (index, (slot, [a, _, m, _])) in values.iter_mut().zip(quadruples).enumerate() {
            let noise = ((sequence * 40 + index as u64) as f64 * 0.618).sin();
            // reciprocal
            *slot = 0.01 / f64::from(1 + a.abs_diff(*m).min(8 - a.abs_diff(*m))) + 1e-7 * noise;
        }
    };
    Box::new(Eits1Device::new(information(8, name), Box::new(source)))
}

/// A device that is manipulated while it runs.
pub struct Meddled<F> {
    pub device: Box<dyn Device>,
    pub meddle: F,
}

impl<F: FnMut(Duration, &mut Box<dyn Device>, &mut Vec<u8>) + Send> Device for Meddled<F> {
    fn receive(&mut self, bytes: &[u8], now: Duration, out: &mut Vec<u8>) {
        self.device.receive(bytes, now, out);
    }

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        let mut sent = Vec::new();
        self.device.poll(now, &mut sent);
        (self.meddle)(now, &mut self.device, &mut sent);
        out.extend(sent);
    }

    fn power_cycle(&mut self) {
        self.device.power_cycle();
    }
}

pub fn start(device: Box<dyn Device>) -> Emulator {
    Emulator::start(device, &Listen::Tcp("127.0.0.1:0".into()), FaultPlan::default()).unwrap()
}

/// A scene for [`device`].
pub fn scene(folder: &Path) -> PathBuf {
    let rate = "[instrument]\ndriver = \"eits1\"\nport = \"unused\"\nframe_rate_hz = 100.0\n";
    write_scene(folder, &format!("{SMALL}\n{rate}"))
}

/// Runs `eit record` on it: the program's output, its answer, and the recording.
pub fn record(folder: &Path, emulator: &Emulator, seconds: &str) -> (Output, Value, PathBuf) {
    let (scene, out) = (scene(folder), folder.join("out.mcap"));
    let port = emulator.endpoint().to_string();
    let output = eit(&[
        "record",
        text(&scene),
        "--port",
        &port,
        "--out",
        text(&out),
        "--seconds",
        seconds,
        "--json",
    ]);
    let json = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output, json, out)
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
