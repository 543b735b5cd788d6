//! Emulated instruments: the device side of every protocol.
//!
//! An [`Emulator`] runs a [`Device`] behind a TCP port or, with the feature `serial` on Unix,
//! behind a pseudo-terminal, which programs open like any serial port. It answers commands, keeps
//! its settings, sends frames at the configured rate with values from the caller, and damages what
//! it sends according to a [`FaultPlan`]. With [`FaultPlan::line_baud`], both directions are as
//! slow as a serial line of that rate.

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

/// Maximum number of bytes waiting for a host that does not read; more are lost, as on a line
/// without flow control.
const MOST_PENDING: usize = 1 << 20;

/// Size of a device's transmit buffer on a slow line.
const TRANSMIT_BUFFER: usize = 1024;

/// Counts kept by an emulator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct EmulatorStatistics {
    /// Bytes sent, after faults.
    pub sent: u64,
    /// Bytes received.
    pub received: u64,
    /// Number of faults: bytes dropped, changed or inserted, pauses, unplugs.
    pub faults: u64,
}

#[derive(Debug, Default)]
struct Counters {
    sent: AtomicU64,
    received: AtomicU64,
    faults: AtomicU64,
}

/// A running emulator; dropping it unplugs the instrument.
///
/// ```
/// use eit_hw::driver::Board;
/// use eit_hw::emulator::{BoardDevice, Emulator, FaultPlan, Listen};
///
/// let board = Board::preset("serial-16")?;
/// let device = BoardDevice::new(board, 50.0, Box::new(|_, _, values| values.fill(0.5)));
/// let listen = Listen::Tcp("127.0.0.1:0".into());
/// let mut emulator = Emulator::start(Box::new(device), &listen, FaultPlan::default())?;
/// println!("connect to {}", emulator.endpoint());
/// emulator.stop();
/// # Ok::<(), eit_hw::HwError>(())
/// ```
#[derive(Debug)]
pub struct Emulator {
    endpoint: Endpoint,
    quit: Arc<AtomicBool>,
    counters: Arc<Counters>,
    thread: Option<JoinHandle<()>>,
}

impl Emulator {
    /// Starts an emulated device.
    ///
    /// # Errors
    /// [`HwError::Setting`] for an invalid fault plan, [`HwError::Open`] if the port cannot be
    /// created.
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

    /// Returns the endpoint that a driver connects to.
    pub fn endpoint(&self) -> &Endpoint {
        &self.endpoint
    }

    /// Returns the counts so far.
    pub fn statistics(&self) -> EmulatorStatistics {
        EmulatorStatistics {
            sent: self.counters.sent.load(Ordering::Relaxed),
            received: self.counters.received.load(Ordering::Relaxed),
            faults: self.counters.faults.load(Ordering::Relaxed),
        }
    }

    /// Stops the emulator and its thread.
    pub fn stop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            #[cfg(all(unix, feature = "serial"))]
            self.drain(&thread);
            // the thread does not panic unless the caller's source of values does
            let _ = thread.join();
        }
    }
}

#[cfg(all(unix, feature = "serial"))]
impl Emulator {
    /// Reads and discards what waits in the pseudo-terminal until the thread has ended. Without a
    /// host, a full pseudo-terminal blocks its writer forever.
    fn drain(&self, thread: &JoinHandle<()>) {
        let Endpoint::Serial { path, .. } = &self.endpoint else { return };
        // the thread checks every 2 ms; after this time it must be blocked
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
        // bytes sent while no host is connected are lost
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
