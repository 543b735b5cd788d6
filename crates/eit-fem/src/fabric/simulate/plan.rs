//! What a seed draws once: the uneven fabric, its drift and its loose contacts.

use super::INSTANTS;
use super::clock::Clock;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::instrument::Loose;
use crate::fabric::piezo::PiezoLaw;
use crate::fabric::random_field::Waves;
use crate::fabric::settings::{Drift, FabricSettings};
use crate::fabric::stream::Purpose;
use eit_core::Random;

/// Number of waves of the uneven fabric and of each drift process.
const WEAVE_WAVES: usize = 512;
const DRIFT_WAVES: usize = 32;

/// What does not change from frame to frame.
pub(super) struct Plan {
    /// When each stimulation is measured, in instants after its frame's time.
    pub scan: Vec<f64>,
    pub law: PiezoLaw,
    pub untouched_s: Vec<f64>,
    /// Drift of ln(conductivity) of the sheet and of ln(contact impedance) of each electrode.
    pub sheet_drift: Slow,
    pub contact_drift: Vec<Slow>,
    /// Change of ln(conductivity) of each element by warming, relative to its mean; empty without.
    warming: Vec<f64>,
    /// That mean per frame.
    pub warming_per_frame: f64,
}

/// Slow Gaussian process that starts from zero.
pub(super) struct Slow {
    amplitude: f64,
    waves: Waves<1>,
    start: f64,
}

impl Slow {
    fn new(mut random: Random, drift: &Drift, amplitude: f64) -> Self {
        let waves = if amplitude == 0.0 { 0 } else { DRIFT_WAVES };
        let waves = Waves::new(&mut random, drift.time_s, waves);
        Self { start: if amplitude == 0.0 { 0.0 } else { waves.at([0.0]) }, amplitude, waves }
    }

    pub(super) fn at(&self, time_s: f64) -> f64 {
        if self.amplitude == 0.0 {
            return 0.0;
        }
        self.amplitude * (self.waves.at([time_s]) - self.start)
    }
}

impl Plan {
    /// Change of ln(conductivity) of each element by warming until a time in frames; none without warming.
    pub(super) fn warmth(&self, time: f64) -> impl Iterator<Item = f64> {
        self.warming.iter().map(move |relative| time * (self.warming_per_frame * relative))
    }
}

impl Fabric {
    /// Draws the plan, the loose contacts and the clock of a seed.
    pub(super) fn plan(&self, rate_hz: f64, seed: u64) -> (Plan, Vec<Loose>, Clock) {
        let FabricSettings { weave, drift, instrument, .. } = &self.settings;
        let clock = self.clock(rate_hz);
        let drives = self.model.patterns.stimulations_a.len() as f64;
        let span = instrument.scan_share * clock.per_frame as f64;
        let scan = |s: usize| span * ((s as f64 + 0.5) / drives - 0.5);
        let mut untouched_s = vec![self.conductivity_s; self.model.elements()];
        if weave.amplitude > 0.0 {
            let mut random = Purpose::Weave.stream(seed, 0);
            let waves: Waves<2> = Waves::new(&mut random, weave.correlation_m, WEAVE_WAVES);
            for (sigma, c) in untouched_s.iter_mut().zip(self.mesh.surface().centroids()) {
                *sigma *= (weave.amplitude * waves.at([c[0], c[1]])).exp();
            }
        }
        let slow = |purpose: Purpose, index, amplitude| {
            Slow::new(purpose.stream(seed, index), drift, amplitude)
        };
        let contacts = 0..self.contact_impedance.len();
        let plan = Plan {
            law: self.law(&clock),
            untouched_s,
            sheet_drift: slow(Purpose::SheetDrift, 0, drift.conductivity),
            contact_drift: contacts
                .map(|l| slow(Purpose::ContactDrift, l, drift.contact))
                .collect(),
            warming: self.warming(seed),
            warming_per_frame: self.warming_per_frame(rate_hz),
            scan: (0..drives as usize).map(scan).collect(),
        };
        (plan, Loose::all(instrument, seed), clock)
    }

    pub(super) fn clock(&self, rate_hz: f64) -> Clock {
        let takes_time = self.settings.instrument.scan_share > 0.0;
        Clock::new(rate_hz, if takes_time { INSTANTS } else { 1 })
    }

    /// The law for the time between instants.
    pub(super) fn law(&self, clock: &Clock) -> PiezoLaw {
        PiezoLaw::new(&self.settings.piezo, 1.0 / (clock.per_frame as f64 * clock.rate_hz))
    }

    pub(super) fn warming_per_frame(&self, rate_hz: f64) -> f64 {
        self.settings.drift.warming_per_min / (60.0 * rate_hz)
    }

    /// Warming of each element relative to its mean over the sheet; empty without.
    fn warming(&self, seed: u64) -> Vec<f64> {
        let drift = &self.settings.drift;
        if drift.warming_per_min == 0.0 {
            return Vec::new();
        }
        let mut random = Purpose::Warming.stream(seed, 0);
        // correlated over half of the skin's longer side
        let waves: Waves<2> = Waves::new(&mut random, self.motion.half_m, WEAVE_WAVES);
        let at = |c: &[f64; 3]| 1.0 + drift.warming_unevenness * waves.at([c[0], c[1]]);
        self.mesh.surface().centroids().iter().map(at).collect()
    }
}
