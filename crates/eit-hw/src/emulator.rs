//! Instruments that are programs: the same bytes from the other side.
//!
//! An [`Emulator`] runs a [`Device`] behind a TCP port or, with the feature `serial` on Unix, behind
//! a pseudo-terminal, which a program opens like any serial port. It answers commands, keeps its
//! set-up, sends frames at the frame rate with values of the caller, and damages what it sends
//! after a [`FaultPlan`]. With
//! [`FaultPlan::line_baud`] both directions are as slow as a serial line of that rate.

mod boards;
mod device;
mod eits1;
mod fault;
mod line;
mod port;
mod sciospec;

pub use boards::BoardDevice;
pub use device::{Device, ValueSource};
pub use eits1::Eits1Device;
pub use fault::FaultPlan;
pub use port::Listen;
pub use sciospec::{PotentialSource, SciospecDevice};

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use self::fault::Faults;
use self::line::Line;
use self::port::Host;
use crate::error::HwError;
use crate::transport::Endpoint;

/// Bytes that wait for a host that does not read; more are lost, as on a line without flow control.
const MOST_PENDING: usize = 1 << 20;

/// Bytes that a device on a slow line has ready to go.
const TRANSMIT_BUFFER: usize = 1024;

/// What an emulator has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EmulatorStatistics {
    /// Bytes sent, after faults.
    pub sent: u64,
    /// Bytes received.
    pub received: u64,
    /// Faults made: bytes dropped, changed or inserted, pauses, unplugs.
    pub faults: u64,
}

#[derive(Debug, Default)]
struct Counters {
    sent: AtomicU64,
    received: AtomicU64,
    faults: AtomicU64,
}

/// A running emulator; dropping it unplugs the instrument.
#[derive(Debug)]
pub struct Emulator {
    endpoint: Endpoint,
    quit: Arc<AtomicBool>,
    counters: Arc<Counters>,
    thread: Option<JoinHandle<()>>,
}

impl Emulator {
    /// Starts a device.
    ///
    /// # Errors
    /// [`HwError::Setting`] for a fault plan that cannot be, [`HwError::Open`] where the port cannot
    /// be made.
    pub fn start(
        device: Box<dyn Device>,
        listen: &Listen,
        faults: FaultPlan,
    ) -> Result<Self, HwError> {
        faults.validate()?;
        let host = Host::new(listen)?;
        let endpoint = host.endpoint();
        let quit = Arc::new(AtomicBool::new(false));
        let counters = Arc::new(Counters::default());
        let (stop, count) = (Arc::clone(&quit), Arc::clone(&counters));
        let thread = std::thread::Builder::new()
            .name("eit-emulator".into())
            .spawn(move || run(device, host, Faults::new(faults), &stop, &count))
            .map_err(|source| HwError::Open {
                endpoint: endpoint.to_string(),
                source,
                mend: "run fewer threads".into(),
            })?;
        Ok(Self { endpoint, quit, counters, thread: Some(thread) })
    }

    /// Where a driver finds it.
    pub fn endpoint(&self) -> &Endpoint {
        &self.endpoint
    }

    /// Counts so far.
    pub fn statistics(&self) -> EmulatorStatistics {
        EmulatorStatistics {
            sent: self.counters.sent.load(Ordering::Relaxed),
            received: self.counters.received.load(Ordering::Relaxed),
            faults: self.counters.faults.load(Ordering::Relaxed),
        }
    }

    /// Ends it.
    pub fn stop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            #[cfg(all(unix, feature = "serial"))]
            self.drain(&thread);
            // it does not panic unless the caller's source of values does
            let _ = thread.join();
        }
    }
}

#[cfg(all(unix, feature = "serial"))]
impl Emulator {
    /// A pseudo-terminal whose host has gone blocks its writer for ever: what waits in it is read and
    /// dropped until the thread has seen that it is to end.
    fn drain(&self, thread: &JoinHandle<()>) {
        let Endpoint::Serial { path, .. } = &self.endpoint else { return };
        // it looks every 2 ms; only a blocked one is still there then
        let patience = Duration::from_millis(50);
        let start = Instant::now();
        while !thread.is_finished() && start.elapsed() < patience {
            std::thread::sleep(Duration::from_millis(1));
        }
        let mut dropped = [0; 4096];
        while !thread.is_finished() {
            let opened = serialport::new(path, 115_200).timeout(patience).open_native();
            let Ok(mut host) = opened else {
                std::thread::sleep(patience);
                continue;
            };
            while !thread.is_finished() && std::io::Read::read(&mut host, &mut dropped).is_ok() {}
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        self.stop();
    }
}

fn run(
    mut device: Box<dyn Device>,
    mut host: Host,
    mut faults: Faults,
    quit: &AtomicBool,
    counters: &Counters,
) {
    let start = Instant::now();
    let mut pending: Vec<u8> = Vec::new();
    let (mut out, mut buffer) = (Vec::new(), [0; 4096]);
    let mut silent_until = Duration::ZERO;
    let (mut to_device, mut to_host) =
        (Line::new(faults.line_baud()), Line::new(faults.line_baud()));
    let mut arrived = Vec::new();
    while !quit.load(Ordering::Relaxed) {
        out.clear();
        let received = host.read(&mut buffer);
        let wrong_rate =
            faults.line_baud().zip(host.baud()).is_some_and(|(one, other)| one != other);
        counters.received.fetch_add(received as u64, Ordering::Relaxed);
        let now = start.elapsed();
        if wrong_rate {
            faults.garble(&mut buffer[..received]);
        }
        to_device.push(&buffer[..received], now);
        arrived.clear();
        to_device.arrived(now, &mut arrived);
        if !arrived.is_empty() {
            device.receive(&arrived, now, &mut out);
        }
        // a device waits while its line is busy
        if faults.line_baud().is_none() || to_host.waiting() < TRANSMIT_BUFFER {
            device.poll(now, &mut out);
        }
        let effect = faults.damage(&mut out);
        counters.faults.fetch_add(effect.faults, Ordering::Relaxed);
        // while nobody listens, what is sent is gone
        if host.is_open() && pending.len() + to_host.waiting() < MOST_PENDING {
            to_host.push(&out, now);
        }
        let before = pending.len();
        to_host.arrived(now, &mut pending);
        if wrong_rate {
            faults.garble(&mut pending[before..]);
        }
        if let Some(pause) = effect.pause {
            silent_until = now + pause;
        }
        if effect.unplug {
            pending.clear();
            to_device.clear();
            to_host.clear();
            host.unplug();
            device.power_cycle();
            sleep(faults.unplugged(), quit);
            host.plug();
        }
        if now >= silent_until && !pending.is_empty() {
            let sent = host.write(&pending);
            counters.sent.fetch_add(sent as u64, Ordering::Relaxed);
            pending.drain(..sent);
        }
        if !host.is_open() {
            pending.clear();
            to_host.clear();
        }
    }
}

fn sleep(time: Duration, quit: &AtomicBool) {
    let start = Instant::now();
    while start.elapsed() < time && !quit.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(2));
    }
}
