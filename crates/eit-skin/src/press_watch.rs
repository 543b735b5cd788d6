//! Detects when a skin is pressed, held and released, without a model.

use crate::error::SkinError;
use eit_core::median;
use std::collections::VecDeque;

/// A frame shows a press if its root mean square change exceeds this multiple of the noise.
const PRESSED: f64 = 6.0;
/// Least root mean square change of a press, relative to the median voltage. The simulated fabric drifts by
/// 7e-5 per second, which the reference follows 20 frames late: 1.6e-4 at 8 frames per second. A press of 0.3 N in
/// the middle of the paper's skin changes 3e-4, one of 1 N on 12 x 8 cm 3e-2.
const LEAST: f64 = 2e-4;
/// Coarsest step of a converter, relative to the median voltage. Without this limit, a press that
/// is the first change of a value would count as rounding.
const COARSEST_STEP: f64 = 1e-2;
/// After a press, a change must also exceed this fraction of it, because fabric keeps relaxing.
const MEMORY: f64 = 0.1;
/// The press is released when the change falls below this fraction of it.
const RELEASED: f64 = 0.3;
/// The press is held when the two halves of the window differ by less than this fraction of the change.
const STEADY: f64 = 0.1;
/// Weight of a new frame in the untouched reference.
const FOLLOW: f64 = 0.05;

/// State reported by a [`PressWatch`].
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum PressState {
    /// Nothing touches the skin.
    Untouched,
    /// The skin is touched, and the touch moves or its force changes.
    Unsteady,
    /// A press is held: the mean change over the window, in the frame's unit. Reported once per press.
    Held(Vec<f64>),
    /// The press is still held.
    StillHeld,
}

/// Detects presses in a stream of frames.
///
/// A press is a change far above the noise of the untouched frames. It counts as held once the two
/// halves of the last `window` frames agree, and as released once the change is below 30 % of it.
/// The reference slowly follows the untouched skin, and is taken anew after a release, so that what
/// remains of a press in the fabric (its memory) does not count as a second press; nor does a
/// change of less than a tenth of the last press, because the fabric may still relax by that much.
/// Channels have equal weight in units of their noise, which is at least a tenth of the median
/// channel's. A change below 2e-4 of the median voltage is no press, however quiet the board is.
#[derive(Debug, Clone)]
pub struct PressWatch {
    reference: Vec<f64>,
    noise: Vec<f64>,
    /// Latest frame, and the smallest change of a value between two frames: the converter's step, infinite
    /// until a value changes. A converter without noise may repeat its values for the whole untouched start.
    latest: Vec<f64>,
    step: f64,
    /// [`COARSEST_STEP`] in the frames' unit.
    coarsest_step: f64,
    window: VecDeque<Vec<f64>>,
    frames: usize,
    /// Size of the press that is being held.
    held: Option<f64>,
    /// Size from which a frame shows a press.
    pressed: f64,
    /// Number of frames until the reference is trusted after a release.
    settling: usize,
}

impl PressWatch {
    /// Creates a watch from frames of the untouched skin, `[frame][value]`; `window` is the number of frames
    /// for which a press must be held.
    ///
    /// # Errors
    /// Fewer than 4 frames, or frames of different lengths.
    pub fn new(untouched: &[Vec<f64>], window: usize) -> Result<Self, SkinError> {
        let values = untouched.first().map_or(0, Vec::len);
        if untouched.len() < 4 || values == 0 {
            return Err(SkinError::input(format!(
                "{} frames of the untouched skin: 4 or more are needed",
                untouched.len()
            )));
        }
        if let Some(frame) = untouched.iter().position(|frame| frame.len() != values) {
            return Err(SkinError::input(format!(
                "frame {frame} of the untouched skin has {} values, the first {values}",
                untouched[frame].len()
            )));
        }
        let count = untouched.len() as f64;
        let mean: Vec<f64> = (0..values)
            .map(|i| untouched.iter().map(|frame| frame[i]).sum::<f64>() / count)
            .collect();
        let deviation = |i: usize| {
            let squares = untouched.iter().map(|frame| (frame[i] - mean[i]).powi(2));
            (squares.sum::<f64>() / (count - 1.0)).sqrt()
        };
        let mut noise: Vec<f64> = (0..values).map(deviation).collect();
        let known: Vec<f64> = noise.iter().copied().filter(|noise| noise.is_finite()).collect();
        if known.is_empty() {
            return Err(SkinError::input("no value of the untouched skin is finite in all frames"));
        }
        let voltage = median(mean.iter().map(|v| v.abs()).filter(|v| v.is_finite())).unwrap_or(0.0);
        let floor = floor_of(&known, voltage);
        // a channel with missing values has no reference: it never counts
        noise.iter_mut().for_each(|noise| {
            *noise = if noise.is_finite() { noise.max(floor) } else { f64::INFINITY };
        });
        let frames = window.max(4);
        let window = VecDeque::with_capacity(frames);
        let steps = untouched.windows(2).map(|pair| smallest_change(&pair[0], &pair[1]));
        Ok(Self {
            reference: mean,
            noise,
            latest: untouched[untouched.len() - 1].clone(),
            step: steps.fold(f64::INFINITY, f64::min),
            coarsest_step: COARSEST_STEP * voltage,
            window,
            frames,
            held: None,
            pressed: PRESSED,
            settling: 0,
        })
    }

    /// Returns the current untouched frame.
    #[cfg(feature = "first-scene")]
    pub fn reference(&self) -> &[f64] {
        &self.reference
    }

    /// Takes the next frame. Values that are not finite count as unchanged; a frame with the wrong length is
    /// ignored.
    pub fn push(&mut self, frame: &[f64]) -> PressState {
        if frame.len() != self.reference.len() {
            return PressState::Unsteady;
        }
        self.step = self.step.min(smallest_change(&self.latest, frame));
        self.latest.copy_from_slice(frame);
        let values = frame.iter().zip(&self.reference);
        let change: Vec<f64> = values
            .map(|(value, reference)| value - reference)
            .map(|change| if change.is_finite() { change } else { 0.0 })
            .collect();
        let (size, shows_press) = (self.size(&change), self.shows_press(&change));
        if self.window.len() == self.frames {
            self.window.pop_front();
        }
        self.window.push_back(change);
        if let Some(held) = self.held {
            if size > RELEASED * held {
                return PressState::StillHeld;
            }
            (self.held, self.settling) = (None, self.frames);
            self.window.clear();
            return PressState::Unsteady;
        }
        if self.settling > 0 {
            self.settling -= 1;
            if self.settling == 0 {
                self.rebase();
            }
            return PressState::Unsteady;
        }
        if !shows_press {
            let newest = self.window.back();
            let slots = self.reference.iter_mut().zip(newest.into_iter().flatten());
            slots.for_each(|(reference, change)| *reference += FOLLOW * change);
            return PressState::Untouched;
        }
        match self.steady() {
            Some(mean) => {
                let held = self.size(&mean);
                self.held = Some(held);
                self.pressed = PRESSED.max(MEMORY * held);
                PressState::Held(mean)
            }
            None => PressState::Unsteady,
        }
    }

    /// Root mean square of a change in units of the noise.
    fn size(&self, change: &[f64]) -> f64 {
        rms(change.iter().zip(&self.noise).map(|(change, noise)| change / noise))
    }

    /// Whether a change shows a press: it far exceeds noise and memory, and also the rounding steps
    /// that a slow drift causes.
    fn shows_press(&self, change: &[f64]) -> bool {
        let step = if self.step.is_finite() { self.step.min(self.coarsest_step) } else { 0.0 };
        let counted = change.iter().zip(&self.noise).filter(|(_, noise)| noise.is_finite());
        let rounding = PRESSED * step / 12.0_f64.sqrt();
        self.size(change) >= self.pressed && rms(counted.map(|(change, _)| *change)) >= rounding
    }

    /// Makes the mean of the current window the reference.
    fn rebase(&mut self) {
        let mean = self.mean(0, self.window.len());
        self.reference.iter_mut().zip(mean).for_each(|(reference, change)| *reference += change);
        self.window.clear();
    }

    /// Mean change over a range of frames of the window.
    fn mean(&self, from: usize, to: usize) -> Vec<f64> {
        let count = (to - from).max(1) as f64;
        let frames = || self.window.iter().skip(from).take(to - from);
        (0..self.reference.len())
            .map(|i| frames().map(|change| change[i]).sum::<f64>() / count)
            .collect()
    }

    /// The mean change, if a full window shows a press and its halves agree.
    fn steady(&self) -> Option<Vec<f64>> {
        if self.window.len() < self.frames
            || !self.window.iter().all(|change| self.shows_press(change))
        {
            return None;
        }
        let half = self.frames / 2;
        let (before, after) = (self.mean(0, half), self.mean(half, self.frames));
        let difference: Vec<f64> =
            before.iter().zip(&after).map(|(one, other)| one - other).collect();
        let mean = self.mean(0, self.frames);
        // the halves also differ by noise: allow twice its mean over a half
        let forgiven = 2.0 * (2.0 / half as f64).sqrt();
        (self.size(&difference) < STEADY * self.size(&mean) + forgiven).then_some(mean)
    }
}

/// Least noise of a channel: a tenth of the median channel's or, if most channels never change, the
/// largest noise of any; in any case large enough that a change of [`LEAST`] of the median voltage
/// equals [`PRESSED`]. The median is used because voltages at driven electrodes may be a hundred
/// times as large as all others.
fn floor_of(noise: &[f64], median_voltage: f64) -> f64 {
    let measured = match median(noise.iter().copied()).unwrap_or(0.0) {
        0.0 => noise.iter().copied().fold(0.0, f64::max),
        middle => 0.1 * middle,
    };
    measured.max(LEAST / PRESSED * median_voltage).max(f64::MIN_POSITIVE)
}

/// Root mean square; 0 without values.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, squares) =
        values.fold((0.0, 0.0), |(n, sum), value| (n + 1.0, sum + value * value));
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Smallest change of a value from one frame to the next; infinite if none changes.
fn smallest_change(before: &[f64], after: &[f64]) -> f64 {
    let changes = before.iter().zip(after).map(|(before, after)| (after - before).abs());
    changes.filter(|change| *change > 0.0).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eit_core::Random;

    /// Frames of 12 values: `level` times a pattern, with noise of 1e-3.
    fn frame(random: &mut Random, level: f64) -> Vec<f64> {
        (0..12).map(|i| 1.0 + level * f64::from(i % 3) + 1e-3 * random.normal()).collect()
    }

    #[test]
    fn each_press_is_reported_once_and_only_when_held() {
        let mut random = Random::new(5);
        let untouched: Vec<_> = (0..20).map(|_| frame(&mut random, 0.0)).collect();
        let mut watch = PressWatch::new(&untouched, 8).unwrap();
        // rise, hold, fall to a residue of a tenth (memory), twice; then 200 frames without a press
        let press = (0..30).map(|k| (k as f64 / 10.0).min(1.0)).chain((0..20).map(|_| 0.1));
        let levels = press.clone().chain(press).chain((0..200).map(|_| 0.1));
        let (mut held, mut pressed_at_end) = (Vec::new(), false);
        for (k, level) in levels.enumerate() {
            match watch.push(&frame(&mut random, level)) {
                PressState::Held(change) => held.push((k, change)),
                state => pressed_at_end = state != PressState::Untouched,
            }
        }
        assert_eq!(held.len(), 2, "{held:?}");
        // the ramp ends in frame 10; 8 frames later the window is full of the press
        assert!((10..=18).contains(&held[0].0), "{}", held[0].0);
        assert!((60..=68).contains(&held[1].0), "{}", held[1].0);
        // 1 and, over the residue, 0.9; a window of 8 may hold the end of the ramp
        assert!((held[0].1[1] - 1.0).abs() < 0.1, "{:?}", held[0].1);
        assert!((held[1].1[1] - 0.9).abs() < 0.1, "{:?}", held[1].1);
        assert!(!pressed_at_end);
    }

    /// A board without noise shows every change of a fabric that relaxes for long after a press.
    #[test]
    fn a_relaxing_fabric_is_untouched() {
        let frame =
            |level: f64| (0..12).map(|i| 1.0 + level * f64::from(i % 3)).collect::<Vec<_>>();
        let mut watch = PressWatch::new(&vec![frame(0.0); 20], 8).unwrap();
        let press =
            (0..30).map(|_| 1.0).chain((0..100).map(|k| 0.1 * (-f64::from(k) / 50.0).exp()));
        let states: Vec<_> =
            press.clone().chain(press).map(|level| watch.push(&frame(level))).collect();
        let held = states.iter().filter(|state| matches!(state, PressState::Held(_))).count();
        assert_eq!(held, 2);
        // untouched from the time on at which the reference is taken anew
        for after in [&states[40..130], &states[170..]] {
            assert!(after.iter().all(|state| *state == PressState::Untouched), "{after:?}");
        }
    }

    /// A board without noise on a fabric that drifts by 5e-6 of its voltages per frame shows no
    /// press, and a light touch of 5e-4 is one.
    #[test]
    fn the_drift_of_a_skin_without_noise_is_no_press() {
        let frame =
            |level: f64| (0..12).map(|i| 1.0 + level * f64::from(i % 3)).collect::<Vec<_>>();
        let drift = |k: i32| 5e-6 * f64::from(k);
        let untouched: Vec<_> = (0..20).map(|k| frame(drift(k))).collect();
        let mut watch = PressWatch::new(&untouched, 8).unwrap();
        for k in 20..400 {
            assert_eq!(watch.push(&frame(drift(k))), PressState::Untouched, "frame {k}");
        }
        let states: Vec<_> = (400..420).map(|k| watch.push(&frame(5e-4 + drift(k)))).collect();
        assert!(states.iter().any(|state| matches!(state, PressState::Held(_))), "{states:?}");
    }

    /// A converter of 12 bits without noise repeats its values until the drift of the fabric turns the last
    /// digit of one of them: no press. A press of a few steps is one.
    #[test]
    fn a_turning_digit_is_no_press() {
        let step = 1.0 / 4096.0;
        let frame = |level: f64| -> Vec<f64> {
            let values = (0..40).map(|i| 0.1 + 0.0177 * f64::from(i) + level);
            values.map(|value| (value / step).round() * step).collect()
        };
        let drift = |k: i32| 2e-6 * f64::from(k);
        let mut watch = PressWatch::new(&vec![frame(0.0); 20], 8).unwrap();
        for k in 0..400 {
            assert_eq!(watch.push(&frame(drift(k))), PressState::Untouched, "frame {k}");
        }
        let states: Vec<_> =
            (400..420).map(|k| watch.push(&frame(5.0 * step + drift(k)))).collect();
        assert!(states.iter().any(|state| matches!(state, PressState::Held(_))), "{states:?}");
    }

    #[test]
    fn noise_and_drift_are_no_press() {
        let mut random = Random::new(6);
        let untouched: Vec<_> = (0..20).map(|_| frame(&mut random, 0.0)).collect();
        let mut watch = PressWatch::new(&untouched, 8).unwrap();
        for k in 0..5000 {
            // drifts by half the noise in ten frames
            let state = watch.push(&frame(&mut random, 5e-5 * f64::from(k)));
            assert_eq!(state, PressState::Untouched, "frame {k}");
        }
    }

    #[test]
    fn constant_channels_and_few_frames() {
        assert!(PressWatch::new(&vec![vec![1.0]; 3], 8).is_err());
        assert!(PressWatch::new(&[vec![1.0], vec![1.0], vec![1.0], vec![]], 8).is_err());
        let mut watch = PressWatch::new(&vec![vec![1.0; 6]; 10], 4).unwrap();
        assert_eq!(watch.push(&[1.0; 6]), PressState::Untouched);
        assert_eq!(watch.push(&[f64::NAN; 6]), PressState::Untouched);
        // a channel with missing values at the start never counts; without any other there is nothing to
        // watch
        let frame = |first: f64| vec![first, 1.0, 1.0];
        let mut partly =
            PressWatch::new(&[frame(f64::NAN), frame(1.0), frame(1.0), frame(1.0)], 4).unwrap();
        assert_eq!(partly.push(&frame(9.0)), PressState::Untouched);
        let held = (0..5).map(|_| partly.push(&[1.0, 1.1, 1.1])).find_map(|state| match state {
            PressState::Held(change) => Some(change),
            _ => None,
        });
        assert!(held.unwrap().iter().all(|change| change.is_finite()));
        assert!(PressWatch::new(&vec![vec![f64::NAN]; 6], 4).is_err());
        let states: Vec<_> = (0..5).map(|_| watch.push(&[1.1; 6])).collect();
        assert!(states.iter().any(|state| matches!(state, PressState::Held(_))), "{states:?}");
    }
}
