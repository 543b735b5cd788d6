//! A device at work: from its port through a line to the device, and back.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::fault::Faults;
use super::line::Line;
use super::port::Host;
use super::{Counters, Device};

/// Maximum number of bytes waiting for a host that does not read; more are lost, as on a line
/// without flow control.
const MOST_PENDING: usize = 1 << 20;

/// Size of a device's transmit buffer on a slow line.
const TRANSMIT_BUFFER: usize = 1024;

/// A device, its port, and the line between them.
pub(super) struct Running {
    device: Box<dyn Device>,
    host: Host,
    faults: Faults,
    to_device: Line,
    to_host: Line,
    /// Bytes that have reached the device, and those that wait at the port.
    arrived: Vec<u8>,
    pending: Vec<u8>,
}

impl Running {
    pub(super) fn new(device: Box<dyn Device>, host: Host, faults: Faults) -> Self {
        let [to_device, to_host] = [(); 2].map(|()| Line::new(faults.line_baud()));
        let (arrived, pending) = (Vec::new(), Vec::new());
        Self { device, host, faults, to_device, to_host, arrived, pending }
    }

    /// Runs until told to quit.
    pub(super) fn run(mut self, quit: &AtomicBool, counters: &Counters) {
        let start = Instant::now();
        let (mut out, mut buffer) = (Vec::new(), [0; 4096]);
        let mut silent_until = Duration::ZERO;
        while !quit.load(Ordering::Relaxed) {
            out.clear();
            let received = self.host.read(&mut buffer);
            counters.received.fetch_add(received as u64, Ordering::Relaxed);
            let (now, wrong_rate) = (start.elapsed(), self.has_wrong_rate());
            if wrong_rate {
                self.faults.garble(&mut buffer[..received]);
            }
            self.answer(&buffer[..received], now, &mut out);
            let effect = self.faults.damage(&mut out);
            counters.faults.fetch_add(effect.faults, Ordering::Relaxed);
            self.transmit(&out, now, wrong_rate);
            if let Some(pause) = effect.pause {
                silent_until = now + pause;
            }
            if effect.unplug {
                self.unplug(quit);
            }
            if now >= silent_until && !self.pending.is_empty() {
                let sent = self.host.write(&self.pending);
                counters.sent.fetch_add(sent as u64, Ordering::Relaxed);
                self.pending.drain(..sent);
            }
            if !self.host.is_open() {
                self.pending.clear();
                self.to_host.clear();
            }
        }
    }

    /// Whether the host has opened the port at another rate than the line's.
    fn has_wrong_rate(&self) -> bool {
        self.faults.line_baud().zip(self.host.baud()).is_some_and(|(one, other)| one != other)
    }

    /// Lets the device answer what has arrived.
    fn answer(&mut self, received: &[u8], now: Duration, out: &mut Vec<u8>) {
        self.to_device.push(received, now);
        self.arrived.clear();
        self.to_device.arrived(now, &mut self.arrived);
        if !self.arrived.is_empty() {
            self.device.receive(&self.arrived, now, out);
        }
        // a device waits while its line is busy
        if self.faults.line_baud().is_none() || self.to_host.waiting() < TRANSMIT_BUFFER {
            self.device.poll(now, out);
        }
    }

    /// Puts bytes on the line to the host, and takes those that have arrived by now.
    fn transmit(&mut self, out: &[u8], now: Duration, wrong_rate: bool) {
        // bytes sent while no host is connected are lost
        if self.host.is_open() && self.pending.len() + self.to_host.waiting() < MOST_PENDING {
            self.to_host.push(out, now);
        }
        let before = self.pending.len();
        self.to_host.arrived(now, &mut self.pending);
        if wrong_rate {
            self.faults.garble(&mut self.pending[before..]);
        }
    }

    /// Unplugs the device for a while; it loses its settings, and everything under way is lost.
    fn unplug(&mut self, quit: &AtomicBool) {
        self.pending.clear();
        self.to_device.clear();
        self.to_host.clear();
        self.host.unplug();
        self.device.power_cycle();
        let start = Instant::now();
        while start.elapsed() < self.faults.unplugged() && !quit.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(2));
        }
        self.host.plug();
    }
}
