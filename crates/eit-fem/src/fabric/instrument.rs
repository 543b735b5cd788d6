//! Simulated instrument: from exact voltages to recorded values.
//!
//! Each channel has its own gain and noise; the converter then rounds and clips. (The compliance
//! limit of the current source applies before, in `simulate/instant.rs`.) Effects of zero amplitude
//! are not computed.

use super::settings::Instrument;
use super::stream::Purpose;
use super::truth::TrueQuality;
use crate::protocol::Protocol;
use eit_core::Random;
use std::f64::consts::{PI, TAU};

/// Channels of one instrument.
#[derive(Debug)]
pub(super) struct Channels {
    settings: Instrument,
    seed: u64,
    /// Largest voltage of the untouched skin, volt.
    largest_v: f64,
    /// Gain of each measurement.
    gains: Option<Vec<f64>>,
    noise_v: Option<Vec<f64>>,
    /// Slow noise and mains: amplitude, radians per frame and phase of each sine of each measurement.
    slow: Vec<Vec<[f64; 3]>>,
    /// Step and range of the converter, volt.
    converter: Option<[f64; 2]>,
}

impl Channels {
    /// Creates the channels. `reference_v` holds the exact voltages of the untouched skin, which
    /// set the default range.
    pub(crate) fn new(
        settings: &Instrument,
        protocol: &Protocol,
        reference_v: &[f64],
        rate_hz: f64,
        seed: u64,
    ) -> Self {
        let patterns = protocol.measurement_patterns().nrows();
        let per_channel = |purpose: Purpose, sample: &dyn Fn(&mut Random) -> f64| -> Vec<f64> {
            let mut random = purpose.stream(seed, 0);
            let channels: Vec<f64> = (0..patterns).map(|_| sample(&mut random)).collect();
            protocol.data().iter().map(|datum| channels[datum[1] as usize]).collect()
        };
        let [low, high] = settings.noise_v;
        let gain = |random: &mut Random| 1.0 + settings.gain_error * random.normal();
        let largest = reference_v.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let range_v = settings.range_v.unwrap_or(1.25 * largest);
        Self {
            gains: (settings.gain_error > 0.0).then(|| per_channel(Purpose::Gain, &gain)),
            noise_v: (high > 0.0)
                .then(|| per_channel(Purpose::NoiseLevel, &|random| random.between(low, high))),
            converter: (settings.bits > 0)
                .then(|| [range_v / 2_f64.powi(settings.bits as i32 - 1), range_v]),
            slow: slow_sines(settings, protocol, rate_hz, seed),
            settings: settings.clone(),
            seed,
            largest_v: largest,
        }
    }

    /// Returns the standard deviation of each measurement's noise, volt: additive noise and
    /// rounding (`step / sqrt(12)`).
    pub(crate) fn noise_std_v(&self, measurements: usize) -> Vec<f64> {
        let rounding = self.converter.map_or(0.0, |[step, _]| step * step / 12.0);
        let additive = |k: usize| self.noise_v.as_ref().map_or(0.0, |noise| noise[k].powi(2));
        (0..measurements).map(|k| (additive(k) + rounding).sqrt()).collect()
    }

    /// Returns the range of the converter, volt.
    pub(crate) fn range_v(&self) -> Option<f64> {
        self.converter.map(|c| c[1])
    }

    /// Changes the frame rate from a frame on; mains go on where they were.
    pub(crate) fn set_rate(&mut self, frame: usize, from_hz: f64, to_hz: f64) {
        for [_, turn, phase] in self.slow.iter_mut().filter_map(|sines| sines.first_mut()) {
            let new = *turn * from_hz / to_hz;
            *phase += (*turn - new) * frame as f64;
            *turn = new;
        }
    }

    /// Turns the exact voltages of a frame into recorded ones and marks clipped values.
    pub(crate) fn measure(&self, frame: usize, values_v: &mut [f64], quality: &mut [TrueQuality]) {
        if let Some(gains) = &self.gains {
            values_v.iter_mut().zip(gains).for_each(|(v, gain)| *v *= gain);
        }
        if let Some(noise_v) = &self.noise_v {
            let mut random = Purpose::Noise.stream(self.seed, frame);
            values_v.iter_mut().zip(noise_v).for_each(|(v, std)| *v += std * random.normal());
        }
        for (v, sines) in values_v.iter_mut().zip(&self.slow) {
            let at = |[size, turn, phase]: &[f64; 3]| size * (turn * frame as f64 + phase).sin();
            *v += sines.iter().map(at).sum::<f64>();
        }
        if quality.contains(&TrueQuality::Lost) {
            // no current through the electrode, and floating inputs
            let mut random = Purpose::Floating.stream(self.seed, frame);
            for (v, quality) in values_v.iter_mut().zip(&*quality) {
                // a floating input shows a tenth of the largest voltage
                let floating = 0.1 * self.largest_v * random.normal();
                *v = if *quality == TrueQuality::Lost { floating } else { *v };
            }
        }
        let mut random = Purpose::Spike.stream(self.seed, frame);
        if random.between(0.0, 1.0) < self.settings.spiked {
            let k = random.below(values_v.len());
            values_v[k] += self.largest_v * random.between(-1.0, 1.0);
            quality[k] = TrueQuality::Spiked;
        }
        let Some([step, _]) = self.converter else { return };
        let most = 2_f64.powi(self.settings.bits as i32 - 1);
        for (v, quality) in values_v.iter_mut().zip(quality) {
            let code = (*v / step).round();
            let clipped = code.clamp(-most, most - 1.0);
            if clipped != code {
                *quality = (*quality).max(TrueQuality::Saturated);
            }
            *v = step * clipped;
        }
    }

    /// How many of a frame's values are of its own scan. The others are those of the former one.
    pub(crate) fn own_values(&self, frame: usize, values: usize) -> usize {
        let mut random = Purpose::Torn.stream(self.seed, frame);
        match frame > 0 && random.between(0.0, 1.0) < self.settings.torn {
            true => 1 + random.below(values - 1),
            false => values,
        }
    }
}

/// Sines of slow noise and mains of each measurement, the same for all of a channel; empty without either.
///
/// Slow noise has eight waves in each of the eight octaves of periods from two frames on, all of one variance: a
/// spectrum of 1/f in steps.
fn slow_sines(
    settings: &Instrument,
    protocol: &Protocol,
    rate_hz: f64,
    seed: u64,
) -> Vec<Vec<[f64; 3]>> {
    const OCTAVES: u32 = 8;
    const WAVES: u32 = 8;
    let Instrument { flicker_v, mains_v, mains_hz, .. } = *settings;
    if flicker_v == 0.0 && mains_v == 0.0 {
        return Vec::new();
    }
    let of_channel = |channel: usize| -> Vec<[f64; 3]> {
        let mut random = Purpose::Mains.stream(seed, channel);
        let mut sines = vec![[mains_v, TAU * mains_hz / rate_hz, random.between(0.0, TAU)]];
        let mut random = Purpose::Flicker.stream(seed, channel);
        for wave in 0..OCTAVES * WAVES {
            let turn = PI * 0.5_f64.powf(f64::from(wave / WAVES) + random.between(0.0, 1.0));
            let size = flicker_v * (2.0 / f64::from(OCTAVES * WAVES)).sqrt();
            sines.push([size, turn, random.between(0.0, TAU)]);
        }
        sines
    };
    let channels: Vec<_> = (0..protocol.measurement_patterns().nrows()).map(of_channel).collect();
    protocol.data().iter().map(|datum| channels[datum[1] as usize].clone()).collect()
}

/// A loose contact: an alternating process that starts closed.
pub(super) struct Loose {
    /// Index of its electrode.
    pub electrode: usize,
    random: Random,
    /// Mean times closed and open, seconds.
    mean_s: [f64; 2],
    /// When it opens next, or has opened last, and closes, seconds.
    open_s: [f64; 2],
}

impl Loose {
    /// The loose contacts of an instrument.
    pub(crate) fn all(settings: &Instrument, seed: u64) -> Vec<Self> {
        let mean_s = [1.0 / settings.loose_rate_hz, settings.loose_time_s];
        let loose = settings.loose.iter().filter(|_| settings.loose_rate_hz > 0.0);
        let new = |&number: &usize| {
            let random = Purpose::Loose.stream(seed, number);
            let mut loose = Self { electrode: number - 1, random, mean_s, open_s: [0.0; 2] };
            loose.next();
            loose
        };
        loose.map(new).collect()
    }

    fn next(&mut self) {
        // waiting times of a Poisson process
        let mut wait = |mean_s: f64| -mean_s * (-self.random.between(0.0, 1.0)).ln_1p();
        let from_s = self.open_s[1] + wait(self.mean_s[0]);
        self.open_s = [from_s, from_s + wait(self.mean_s[1])];
    }

    /// Whether it is open after this many instants, `rate_hz` of them per second; ask in the order of time.
    pub(crate) fn is_open(&mut self, instants: f64, rate_hz: f64) -> bool {
        while instants >= self.open_s[1] * rate_hz {
            self.next();
        }
        instants >= self.open_s[0] * rate_hz
    }
}
