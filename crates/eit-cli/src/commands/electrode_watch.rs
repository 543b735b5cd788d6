//! Electrodes that fail during a recording.

use crate::commands::prelude::*;
use eit_hw::Frame;
use eit_skin::faults::{ElectrodeFault, StreamMonitor};
use eit_skin::live::REFERENCE_FRAMES;
use eit_skin::scene::Instrument;

/// Checks each frame after it was recorded, without a model of the skin.
pub(super) struct ElectrodeWatch {
    /// `None` if the protocol cannot be monitored; recording continues without.
    monitor: Option<StreamMonitor>,
    first_s: Option<f64>,
    frames: u64,
    period_s: f64,
    /// Faults in the previous frame.
    before: Vec<ElectrodeFault>,
    /// The first faults, and when each one ended, in seconds.
    kept: Vec<(ElectrodeFault, Option<f64>)>,
    more: u64,
}

impl ElectrodeWatch {
    pub(super) fn new(instrument: &Instrument) -> Self {
        let (quadruples, electrodes) = (&instrument.quadruples, instrument.electrodes);
        Self {
            monitor: StreamMonitor::new(quadruples, electrodes, REFERENCE_FRAMES).ok(),
            first_s: None,
            frames: 0,
            period_s: instrument.frame_rate_hz.recip(),
            before: Vec::with_capacity(electrodes),
            kept: Vec::new(),
            more: 0,
        }
    }

    /// Starts again after the instrument was lost and found: the old reference is invalid.
    pub(super) fn restart(&mut self) {
        self.monitor.iter_mut().for_each(StreamMonitor::restart);
        self.before.clear();
    }

    /// Checks a frame; calls `tell` for every electrode that fails or recovers.
    pub(super) fn push<E>(
        &mut self,
        frame: &Frame,
        mut tell: impl FnMut(&str) -> Result<(), E>,
    ) -> Result<(), E> {
        let time_s = self.time_s(frame);
        let Some(monitor) = &mut self.monitor else { return Ok(()) };
        let is_good = |i: usize| frame.quality.get(i).is_some_and(|quality| quality.is_good());
        // a frame that cannot be checked is recorded all the same
        if monitor.push(&frame.values, is_good, time_s).is_err() {
            return Ok(());
        }
        let now = monitor.faults();
        for fault in now.iter().filter(|fault| !self.before.contains(fault)) {
            let (number, words) = (fault.electrode + 1, fault.kind.description());
            tell(&format!("electrode {number} {words}; since {time_s:.2} s"))?;
            // an electrode with a loose contact fails repeatedly
            match self.kept.len() < 100 {
                true => self.kept.push((*fault, None)),
                false => self.more += 1,
            }
        }
        for fault in self.before.iter().filter(|fault| !now.contains(fault)) {
            let number = fault.electrode + 1;
            tell(&format!("electrode {number} is sound again; since {time_s:.2} s"))?;
            let kept = self.kept.iter_mut().find(|(kept, _)| kept == fault);
            kept.into_iter().for_each(|(_, until_s)| *until_s = Some(time_s));
        }
        if now != self.before {
            now.clone_into(&mut self.before);
        }
        Ok(())
    }

    /// Time since the first frame, seconds.
    fn time_s(&mut self, frame: &Frame) -> f64 {
        self.frames += 1;
        let clock = frame.device_time_s.or(frame.host_time_s).filter(|time_s| time_s.is_finite());
        let now_s = clock.unwrap_or((self.frames - 1) as f64 * self.period_s);
        now_s - *self.first_s.get_or_insert(now_s)
    }

    /// Describes each fault on a line, for people.
    pub(super) fn lines(&self) -> String {
        let mut lines = String::new();
        for (fault, until_s) in &self.kept {
            let until = until_s.map_or("to the end".to_owned(), |s| format!("to {s:.2} s"));
            let (number, words, since_s) =
                (fault.electrode + 1, fault.kind.description(), fault.since_s);
            lines += &format!("\nelectrode {number} {words}; {since_s:.2} s {until}");
        }
        if self.more > 0 {
            lines += &format!("\nand {} more faults", self.more);
        }
        lines
    }

    /// Returns the faults as JSON; electrodes are numbered from 1.
    pub(super) fn json(&self) -> Value {
        let with_end = |(fault, until_s): &(ElectrodeFault, Option<f64>)| {
            joined(json!({ "until_s": until_s }), fault.json())
        };
        self.kept.iter().map(with_end).collect()
    }
}
