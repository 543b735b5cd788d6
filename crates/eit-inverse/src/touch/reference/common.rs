//! The change that all channels share while something touches the skin.

use super::ReferenceSettings;

/// Fraction of the channels, those that a touch changes least, that estimate the common factor.
const UNTOUCHED: f64 = 0.3;

/// A frame during which the reference holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Held {
    /// How long the reference has held, seconds.
    pub(super) held_s: f64,
    /// Time since the last frame, seconds.
    pub(super) dt_s: f64,
    /// Whether a touch is reported.
    pub(super) touched: bool,
}

/// The common factor of all channels under contact.
#[derive(Debug, Clone)]
pub(super) struct Common {
    /// Workspace: relative change of each channel, with the channel.
    ranking: Vec<(f64, u32)>,
    /// Channels used for the factor, chosen once contact had settled.
    untouched: Vec<u32>,
    /// Median relative change of these channels at that time: the touch's own share.
    touch_share: f64,
    pub(super) factor: f64,
}

impl Common {
    /// Allocates for the given number of channels.
    pub(super) fn new(channels: usize) -> Self {
        Self {
            ranking: Vec::with_capacity(channels),
            untouched: Vec::with_capacity(channels),
            touch_share: 0.0,
            factor: 1.0,
        }
    }

    pub(super) fn reset(&mut self) {
        self.untouched.clear();
        self.ranking.clear();
        (self.touch_share, self.factor) = (0.0, 1.0);
    }

    /// Follows the common factor; `reference` contains the previous factor and receives the new one.
    pub(super) fn update(
        &mut self,
        settings: &ReferenceSettings,
        held: Held,
        frame: &[f64],
        reference: &mut [f64],
    ) {
        if held.held_s < settings.settle_s {
            return;
        }
        let change =
            |i: usize| if reference[i] == 0.0 { 0.0 } else { frame[i] / reference[i] - 1.0 };
        if self.untouched.is_empty() {
            self.ranking.clear();
            self.ranking.extend((0..frame.len()).map(|i| (change(i).abs(), i as u32)));
            self.ranking.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let count = ((UNTOUCHED * frame.len() as f64) as usize).max(1);
            let used = self.ranking.iter().filter(|r| reference[r.1 as usize] != 0.0);
            self.untouched.extend(used.take(count).map(|r| r.1));
            if self.untouched.is_empty() {
                return;
            }
            self.touch_share = self.median(&change);
        }
        // a fifth of the time constant: faster than drift, slower than noise and fingers. Without a
        // reported touch, the touch's share is zero.
        let weight = -(-5.0 * held.dt_s / settings.time_constant_s).exp_m1();
        let share = if held.touched { self.touch_share } else { 0.0 };
        let more = 1.0 + weight * ((1.0 + self.median(&change)) / (1.0 + share) - 1.0);
        self.factor *= more;
        reference.iter_mut().for_each(|v| *v *= more);
    }

    /// Returns the median relative change of all channels.
    pub(super) fn median_of_all(&mut self, frame: &[f64], reference: &[f64]) -> f64 {
        self.ranking.clear();
        let parts = frame.iter().zip(reference).filter(|(_, reference)| **reference != 0.0);
        self.ranking.extend(parts.map(|(v, reference)| (v / reference - 1.0, 0)));
        if self.ranking.is_empty() {
            return 0.0;
        }
        let middle = self.ranking.len() / 2;
        self.ranking.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0)).1.0
    }

    /// Returns the median relative change of the untouched channels.
    fn median(&mut self, change: &impl Fn(usize) -> f64) -> f64 {
        self.ranking.clear();
        self.ranking.extend(self.untouched.iter().map(|&i| (change(i as usize), i)));
        let middle = self.ranking.len() / 2;
        let (_, median, _) =
            self.ranking.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0));
        median.0
    }
}
