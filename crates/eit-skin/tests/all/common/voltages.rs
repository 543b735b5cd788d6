//! Reciprocal voltages without underlying physics, for tests of the fault monitor.

use eit_skin::eit_fem::fabric::Random;
use eit_skin::eit_fem::{PairProtocol, Protocol};
use eit_skin::faults::{FaultKind, FaultMonitor};

pub const ELECTRODES: usize = 16;
pub const MEASUREMENTS: usize = 208;
pub const DT_S: f64 = 0.05;

/// Noise and converter step, which the monitor is told, volts; voltages are 3 mV to 0.25 V.
pub const NOISE_V: f64 = 2e-5;
pub const STEP_V: f64 = 5e-6;

pub struct Bench {
    pub quadruples: Vec<[u32; 4]>,
    pub reference: Vec<f64>,
    pub monitor: FaultMonitor,
    pub random: Random,
    pub time_s: f64,
}

impl Bench {
    pub fn new(seed: u64) -> Self {
        Self::with(seed, &[true; MEASUREMENTS])
    }

    /// With the measurements that count.
    pub fn with(seed: u64, used: &[bool]) -> Self {
        let protocol: Protocol = PairProtocol::default().protocol().unwrap();
        let quadruples = protocol.quadruples().unwrap().to_vec();
        // the distance between two pairs is also that of the exchanged ones
        let voltage = |&[a, _, m, _]: &[u32; 4]| {
            let way = f64::from(a.abs_diff(m));
            way.min(ELECTRODES as f64 - way).powi(-2)
        };
        Self {
            reference: quadruples.iter().map(voltage).collect(),
            monitor: FaultMonitor::new(&protocol, used, &[NOISE_V; MEASUREMENTS], STEP_V).unwrap(),
            quadruples,
            random: Random::new(seed),
            time_s: 0.0,
        }
    }

    pub fn of(&self, electrode: usize) -> Vec<usize> {
        (0..MEASUREMENTS).filter(|&i| self.quadruples[i].contains(&(electrode as u32))).collect()
    }

    /// Voltages under a touch that changes each pair of reciprocals by up to a fifth.
    pub fn frame(&mut self) -> Vec<f64> {
        let mut touched = self.reference.clone();
        for (i, &twin) in self.monitor.reciprocal().iter().enumerate() {
            touched[i] = match twin < i {
                true => touched[twin],
                false => touched[i] * (1.0 - 0.2 * self.random.uniform()),
            };
        }
        self.random.noisy(&touched, NOISE_V)
    }

    pub fn untouched(&mut self) -> Vec<f64> {
        self.random.noisy(&self.reference, NOISE_V)
    }

    /// Pushes a frame whose measurements `broken` are replaced.
    pub fn push(&mut self, broken: &[usize], value: impl Fn(&mut Random, f64) -> f64) {
        let mut frame = self.frame();
        broken.iter().for_each(|&i| frame[i] = value(&mut self.random, frame[i]));
        self.push_frame(&frame, |_| true);
    }

    pub fn push_frame(&mut self, frame: &[f64], is_good: impl Fn(usize) -> bool) {
        self.monitor.push(frame, &self.reference, is_good, self.time_s).unwrap();
        self.monitor.blame(None, self.time_s).unwrap();
        self.time_s += DT_S;
    }

    /// Pushes a frame whose measurements `flagged` are bad.
    pub fn push_flagged(&mut self, flagged: &[usize]) {
        let frame = self.frame();
        self.push_frame(&frame, |i| !flagged.contains(&i));
    }

    pub fn push_healthy(&mut self, frames: usize) {
        (0..frames).for_each(|_| self.push(&[], |_, v| v));
    }

    /// Electrodes that are excluded, with the reason.
    pub fn faults(&self) -> Vec<(usize, FaultKind)> {
        self.monitor.faults().iter().map(|fault| (fault.electrode, fault.kind)).collect()
    }

    /// Checks that exactly these electrodes are named and these measurements excluded.
    pub fn check(&self, faults: &[(usize, FaultKind)], missing: &[usize]) {
        assert_eq!(self.faults(), faults);
        self.check_missing(missing);
    }

    pub fn check_missing(&self, wanted: &[usize]) {
        let missing: Vec<_> = (0..MEASUREMENTS).filter(|&i| self.monitor.is_missing(i)).collect();
        assert_eq!(missing, wanted);
    }
}
