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
mod running;
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
#[cfg(all(unix, feature = "serial"))]
use std::time::{Duration, Instant};

use self::fault::Faults;
use self::port::Host;
use self::running::Running;
use crate::error::HwError;
use crate::transport::Endpoint;

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

/// The counts as its thread keeps them.
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
            .spawn(move || Running::new(device, host, Faults::new(faults)).run(&stop, &count))
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
