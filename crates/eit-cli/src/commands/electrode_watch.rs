//! Electrodes that fail during a recording.

use eit_hw::Frame;
use eit_skin::faults::{ElectrodeFault, StreamMonitor};
use eit_skin::live::REFERENCE_FRAMES;
use eit_skin::scene::Instrument;
use serde_json::{Value, json};

/// Maximum number of faults reported: an electrode with a loose contact fails repeatedly.
const KEPT: usize = 100;

/// Checks each frame after it was recorded, without a model of the skin.
pub(super) struct ElectrodeWatch {
    /// `None` if the protocol cannot be monitored; recording continues without.
    monitor: Option<StreamMonitor>,
    first_s: Option<f64>,
    frames: u64,
    period_s: f64,
    /// Faults in the previous frame.
    before: Vec<ElectrodeFault>,
    seen: Vec<Seen>,
    more: u64,
}

struct Seen {
    fault: ElectrodeFault,
    healed_s: Option<f64>,
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
            seen: Vec::new(),
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
        if now == self.before {
            return Ok(());
        }
        for fault in now.iter().filter(|fault| !self.before.contains(fault)) {
            let (number, words) = (fault.electrode + 1, fault.kind.words());
            tell(&format!("electrode {number} {words}; since {time_s:.2} s"))?;
            match self.seen.len() < KEPT {
                true => self.seen.push(Seen { fault: *fault, healed_s: None }),
                false => self.more += 1,
            }
        }
        for fault in self.before.iter().filter(|fault| !now.contains(fault)) {
            tell(&format!(
                "electrode {} is sound again; since {time_s:.2} s",
                fault.electrode + 1
            ))?;
            let seen = self.seen.iter_mut().find(|seen| seen.fault == *fault);
            seen.into_iter().for_each(|seen| seen.healed_s = Some(time_s));
        }
        self.before.clear();
        self.before.extend_from_slice(now);
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
        let line = |Seen { fault, healed_s }: &Seen| {
            let until =
                healed_s.map_or_else(|| "to the end".to_owned(), |s| format!("to {s:.2} s"));
            let (number, words, since_s) = (fault.electrode + 1, fault.kind.words(), fault.since_s);
            format!("\nelectrode {number} {words}; {since_s:.2} s {until}")
        };
        let mut lines: String = self.seen.iter().map(line).collect();
        if self.more > 0 {
            lines += &format!("\nand {} more faults", self.more);
        }
        lines
    }

    /// Returns the faults as JSON; electrodes are numbered from 1.
    pub(super) fn json(&self) -> Value {
        let of = |Seen { fault, healed_s }: &Seen| {
            json!({
                "electrode": fault.electrode + 1,
                "fault": fault.kind.words(),
                "since_s": fault.since_s,
                "until_s": healed_s,
            })
        };
        self.seen.iter().map(of).collect()
    }
}
