//! Our own emulated device behind TCP, with interference in between; and `eit emulate`.

use super::*;
use eit_fem::fabric::Random;
use eit_hw::codec::eits1::Information;
use eit_hw::emulator::{Device, Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Quadruple, Unit};
use std::io::{BufRead as _, BufReader};
use std::process::ChildStdin;
use std::sync::{Arc, Mutex};

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

/// A device, and what is done to it and to the bytes that it sends.
struct Meddled<F>(Box<dyn Device>, F);

impl<F: FnMut(Duration, &mut Box<dyn Device>, &mut Vec<u8>) + Send> Device for Meddled<F> {
    fn receive(&mut self, bytes: &[u8], now: Duration, out: &mut Vec<u8>) {
        self.0.receive(bytes, now, out);
    }

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        let mut sent = Vec::new();
        self.0.poll(now, &mut sent);
        (self.1)(now, &mut self.0, &mut sent);
        out.extend(sent);
    }

    fn power_cycle(&mut self) {
        self.0.power_cycle();
    }
}

/// A running [`device`] that is manipulated: by the time, itself, and the bytes that it sends.
pub fn start_meddled<F>(meddle: F) -> Emulator
where
    F: FnMut(Duration, &mut Box<dyn Device>, &mut Vec<u8>) + Send + 'static,
{
    start(Box::new(Meddled(device("skin"), meddle)))
}

pub fn start(device: Box<dyn Device>) -> Emulator {
    Emulator::start(device, &Listen::Tcp("127.0.0.1:0".into()), FaultPlan::default()).unwrap()
}

/// On Linux a loopback address of this process alone, so that no other program takes its free ports.
pub fn own_host() -> std::net::Ipv4Addr {
    let [low, high, ..] = std::process::id().to_le_bytes();
    if cfg!(target_os = "linux") { [127, high, low, 1].into() } else { [127, 0, 0, 1].into() }
}

/// A scene for [`device`].
pub fn scene(folder: &Folder) -> String {
    folder.scene("[instrument]\ndriver = \"eits1\"\nport = \"unused\"\nframe_rate_hz = 100.0\n")
}

/// Runs `eit record` on it and expects an exit code: stderr, the answer, and the recording.
pub fn record(folder: &Folder, from: &Emulator, time_s: u32, code: i32) -> (String, Value, String) {
    let (scene, out, port) = (scene(folder), folder.path("out.mcap"), from.endpoint());
    let line = format!("record {scene} --port {port} --out {out} --seconds {time_s}");
    let output = eit(line + " --json");
    (ended(&output, code), parse(&stdout(&output)), out)
}

/// A running `eit emulate`; stopped when dropped: the system may give the terminal behind its path to another test.
pub struct Emulated(Child);

impl Drop for Emulated {
    fn drop(&mut self) {
        // it may have exited already
        let _ = Command::new("kill").arg(self.0.id().to_string()).status();
        let _ = self.0.wait();
    }
}

/// Starts `eit emulate` on a pseudo-terminal and waits until its port exists.
pub fn emulate(scene: &str, port: &str, more: &str) -> Emulated {
    let mut command = command(format!("emulate {scene} --port {port} {more}"));
    let mut emulated = Emulated(command.stdout(Stdio::null()).spawn().unwrap());
    wait_until(|| {
        assert!(emulated.0.try_wait().unwrap().is_none(), "eit emulate {scene} {more} has ended");
        exists(port)
    });
    emulated
}

/// A folder, and a scene in it with this instrument on a pseudo-terminal.
pub fn scene_at_port(instrument: &str) -> (Folder, String, String) {
    let folder = Folder::new();
    let port = folder.path("skin");
    let scene = folder.scene(&format!("[instrument]\nport = \"{port}\"\n{instrument}\n"));
    (folder, scene, port)
}

/// Starts `eit` with its output on pipes.
pub fn spawn(line: impl AsRef<str>) -> Child {
    command(line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Lines that a child prints until it ends.
pub fn printed(child: &mut Child) -> impl Iterator<Item = String> + use<> {
    BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok)
}

/// Runs cases that mostly wait beside each other.
pub fn side_by_side<T: Send>(cases: impl IntoIterator<Item = T>, test: impl Fn(T) + Sync) {
    let test = &test;
    std::thread::scope(|scope| {
        for case in cases {
            scope.spawn(move || test(case));
        }
    });
}

/// Sends a signal to a child.
pub fn signal(child: &Child, name: &str) {
    let mut kill = Command::new("kill");
    assert!(kill.args([name, &child.id().to_string()]).status().unwrap().success());
}

/// A board that prints a line of whole numbers per frame: converter steps, with noise.
pub struct Board {
    pub frame: Arc<Mutex<Vec<f64>>>,
    /// Standard deviation, steps.
    pub noise: Arc<Mutex<f64>>,
    pub port: String,
    _emulator: Emulator,
}

impl Board {
    pub fn start(rate_hz: f64, frame: Vec<f64>) -> Self {
        let (frame, noise) = (Arc::new(Mutex::new(frame)), Arc::new(Mutex::new(1.0)));
        let (shown, level) = (Arc::clone(&frame), Arc::clone(&noise));
        let (mut sent, mut random) = (0.0, Random::new(5));
        let emulator = start_meddled(move |now, _, out| {
            // lines alone
            out.clear();
            while sent < now.as_secs_f64() * rate_hz {
                let (frame, noise) = (shown.lock().unwrap(), *level.lock().unwrap());
                let mut cell = |value: &f64| match (value + noise * random.normal()).round() {
                    step if step.is_nan() => "nan".to_owned(),
                    step => (step as i64).to_string(),
                };
                let line: Vec<String> = frame.iter().map(&mut cell).collect();
                out.extend(format!("{}\r\n", line.join(",")).bytes());
                sent += 1.0;
            }
        });
        Self { frame, noise, port: emulator.endpoint().to_string(), _emulator: emulator }
    }

    /// From now on it prints this frame.
    pub fn show(&self, frame: Vec<f64>) {
        *self.frame.lock().unwrap() = frame;
    }
}

/// Runs `eit` as someone who reads each line on stderr at once, and may type; returns stdout, exit code and stderr.
pub fn converse(
    line: impl AsRef<str>,
    mut hear: impl FnMut(&str, &Child, &mut ChildStdin),
) -> (String, i32, String) {
    let mut command = command(line);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    // open until the end: otherwise its end would be an answer
    let mut typed = child.stdin.take().unwrap();
    let (sender, lines) = std::sync::mpsc::channel();
    let stderr = BufReader::new(child.stderr.take().unwrap());
    std::thread::spawn(move || stderr.lines().try_for_each(|line| sender.send(line.unwrap())));
    let (end, mut said) = (Instant::now() + LIMIT, String::new());
    while let Ok(line) = lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
        println!("{line}");
        said += &format!("{line}\n");
        hear(&line, &child, &mut typed);
    }
    if Instant::now() >= end {
        child.kill().unwrap();
        panic!("still running after {LIMIT:?}: {said}");
    }
    let output = child.wait_with_output().unwrap();
    (super::stdout(&output), output.status.code().unwrap(), said)
}
