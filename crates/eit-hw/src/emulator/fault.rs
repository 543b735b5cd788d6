//! Faults in what an emulator sends.

use std::time::Duration;

use crate::error::HwError;

/// Faults to simulate, drawn at random from a seed. The default has none.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct FaultPlan {
    /// Random seed.
    pub seed: u64,
    /// Number of bytes sent before the first fault.
    pub spared_bytes: u64,
    /// Probability that a byte is lost.
    pub drop_byte: f64,
    /// Probability that one bit of a byte is flipped.
    pub flip_bit: f64,
    /// Probability that a random byte is inserted before a byte.
    pub insert_byte: f64,
    /// Probability that the line pauses after a byte; what is sent meanwhile arrives late.
    pub pause: f64,
    /// Length of a pause in seconds.
    pub pause_s: f64,
    /// Numbers of bytes sent after which the instrument is unplugged, ascending.
    pub unplug_after_bytes: Vec<u64>,
    /// Seconds until it is plugged in again.
    pub unplugged_s: f64,
    /// Baud rate of the instrument's serial line: bytes take their time, and a host that opens the
    /// pseudo-terminal with another rate sends and receives garbage. `None` accepts any rate, as
    /// USB does.
    pub line_baud: Option<u32>,
}

impl FaultPlan {
    /// Checks the plan.
    ///
    /// # Errors
    /// [`HwError::Setting`] names the first invalid setting.
    pub fn validate(&self) -> Result<(), HwError> {
        for (name, value, most) in [
            ("drop_byte", self.drop_byte, 1.0),
            ("flip_bit", self.flip_bit, 1.0),
            ("insert_byte", self.insert_byte, 1.0),
            ("pause", self.pause, 1.0),
            ("pause_s", self.pause_s, 3600.0),
            ("unplugged_s", self.unplugged_s, 3600.0),
        ] {
            let wanted = "a probability of 0 to 1, or 0 to 3600 s";
            HwError::require((0.0..=most).contains(&value), name, value, wanted)?;
        }
        let (after, name) = (&self.unplug_after_bytes, "unplug_after_bytes");
        HwError::require(after.is_sorted(), name, format!("{after:?}"), "ascending numbers")
    }
}

/// Outcome of damaging a piece of output.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Effect {
    pub(super) faults: u64,
    pub(super) pause: Option<Duration>,
    pub(super) unplug: bool,
}

/// A fault plan being carried out.
#[derive(Debug)]
pub(super) struct Faults {
    plan: FaultPlan,
    state: u64,
    sent: u64,
    unplugs: usize,
    damaged: Vec<u8>,
}

impl Faults {
    pub(super) fn new(plan: FaultPlan) -> Self {
        Self { state: plan.seed, plan, sent: 0, unplugs: 0, damaged: Vec::new() }
    }

    pub(super) fn unplugged(&self) -> Duration {
        Duration::from_secs_f64(self.plan.unplugged_s)
    }

    /// Returns the baud rate of the instrument's line.
    pub(super) fn line_baud(&self) -> Option<u32> {
        self.plan.line_baud
    }

    /// Replaces bytes by what a receiver at another baud rate reads.
    pub(super) fn garble(&mut self, bytes: &mut [u8]) {
        bytes.iter_mut().for_each(|byte| *byte ^= (self.draw() >> 56) as u8);
    }

    /// SplitMix64 (Steele, Lea and Flood 2014).
    fn draw(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn happens(&mut self, probability: f64) -> bool {
        // 53 bits give a number in [0, 1)
        probability > 0.0 && ((self.draw() >> 11) as f64) * f64::EPSILON / 2.0 < probability
    }

    /// Damages bytes being sent. Bytes after an unplug are lost.
    pub(super) fn damage(&mut self, bytes: &mut Vec<u8>) -> Effect {
        let mut effect = Effect::default();
        if bytes.is_empty() || self.plan == FaultPlan::default() {
            return effect;
        }
        let mut damaged = std::mem::take(&mut self.damaged);
        damaged.clear();
        let plan = self.plan.clone();
        for &byte in bytes.iter() {
            self.sent += 1;
            if plan.unplug_after_bytes.get(self.unplugs).is_some_and(|&at| self.sent >= at) {
                self.unplugs += 1;
                effect.faults += 1;
                effect.unplug = true;
                break;
            }
            if self.sent <= plan.spared_bytes {
                damaged.push(byte);
                continue;
            }
            if self.happens(plan.insert_byte) {
                effect.faults += 1;
                damaged.push((self.draw() >> 56) as u8);
            }
            if self.happens(plan.pause) {
                effect.faults += 1;
                effect.pause = Some(Duration::from_secs_f64(plan.pause_s));
            }
            if self.happens(plan.drop_byte) {
                effect.faults += 1;
            } else if self.happens(plan.flip_bit) {
                effect.faults += 1;
                damaged.push(byte ^ (1 << (self.draw() >> 61)));
            } else {
                damaged.push(byte);
            }
        }
        std::mem::swap(bytes, &mut damaged);
        self.damaged = damaged;
        effect
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_does_the_same_damage_however_bytes_come() {
        let plan = FaultPlan {
            seed: 7,
            spared_bytes: 100,
            drop_byte: 0.01,
            flip_bit: 0.01,
            insert_byte: 0.01,
            ..FaultPlan::default()
        };
        let damage = |piece: usize| {
            let mut faults = Faults::new(plan.clone());
            let (mut all, mut count) = (Vec::new(), 0);
            for chunk in vec![0x55_u8; 100_000].chunks(piece) {
                let mut bytes = chunk.to_vec();
                count += faults.damage(&mut bytes).faults;
                all.extend(bytes);
            }
            (all, count)
        };
        let (bytes, count) = damage(1000);
        assert_eq!(damage(7), (bytes.clone(), count));
        assert_eq!(bytes[..100], [0x55; 100]);
        // 3 % of 100 000 bytes, within five standard deviations of 54
        assert!(count.abs_diff(2990) < 270, "{count}");
    }
}
