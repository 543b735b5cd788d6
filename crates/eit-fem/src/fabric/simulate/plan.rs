//! Data shared by all frames: untouched fabric, drift and loose contacts.

use super::INSTANTS;
use crate::fabric::conductivity::pixel_seats;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::instrument::open_contacts;
use crate::fabric::piezo::PiezoLaw;
use crate::fabric::random_field::Waves;
use crate::fabric::script::TouchScript;
use crate::fabric::seat::Seat;
use crate::fabric::settings::FabricSettings;
use crate::fabric::stream::Purpose;
use eit_mesh::Raster;

/// Number of waves of the uneven fabric and of each drift process.
const WEAVE_WAVES: usize = 512;
const DRIFT_WAVES: usize = 32;

/// Data shared by all frames.
pub(super) struct Plan<'a> {
    pub seed: u64,
    /// Number of instants per frame, and which of them is at the frame's time.
    pub per_frame: usize,
    pub middle: usize,
    /// Time of each instant, in frames.
    pub times: Vec<f64>,
    /// When each stimulation is measured, in instants after its frame's time.
    pub scan: Vec<f64>,
    pub raster: &'a Raster,
    /// Where the masked pixels are on the skin.
    pub seats: Vec<Option<Seat>>,
    pub law: PiezoLaw,
    pub untouched_s: Vec<f64>,
    /// Drift of ln(conductivity) of the sheet and of ln(contact impedance) of each electrode, by
    /// instant.
    pub sheet_drift: Vec<f64>,
    pub contact_drift: Vec<Vec<f64>>,
    /// Change of ln(conductivity) of each element by warming, from one frame to the next; empty without.
    pub warming: Vec<f64>,
    pub open: Vec<Vec<bool>>,
}

impl Fabric {
    pub(super) fn plan<'a>(&self, script: &TouchScript, raster: &'a Raster, seed: u64) -> Plan<'a> {
        let FabricSettings { weave, drift, instrument, piezo, .. } = &self.settings;
        let rate_hz = script.frame_rate_hz;
        let per_frame = if instrument.scan_share > 0.0 { INSTANTS } else { 1 };
        let instants = script.frames * per_frame;
        let middle = (per_frame - 1) / 2;
        let time = |i: usize| (i as f64 - middle as f64) / per_frame as f64;
        let times: Vec<f64> = (0..instants).map(time).collect();
        let drives = self.model.patterns.stimulations_a.len() as f64;
        let span = instrument.scan_share * per_frame as f64;
        let scan = |s: usize| span * ((s as f64 + 0.5) / drives - 0.5);
        let electrodes = self.contact_impedance.len();
        let mut untouched_s = vec![self.conductivity_s; self.model.elements()];
        if weave.amplitude > 0.0 {
            let mut random = Purpose::Weave.stream(seed, 0);
            let waves: Waves<2> = Waves::new(&mut random, weave.correlation_m, WEAVE_WAVES);
            for (sigma, c) in untouched_s.iter_mut().zip(self.mesh.surface().centroids()) {
                *sigma *= (weave.amplitude * waves.at([c[0], c[1]])).exp();
            }
        }
        let slow = |purpose: Purpose, index, amplitude: f64| -> Vec<f64> {
            if amplitude == 0.0 {
                return vec![0.0; instants];
            }
            let mut random = purpose.stream(seed, index);
            let waves: Waves<1> = Waves::new(&mut random, drift.time_s, DRIFT_WAVES);
            let start = waves.at([0.0]);
            times.iter().map(|t| amplitude * (waves.at([t / rate_hz]) - start)).collect()
        };
        let contact = |l| slow(Purpose::ContactDrift, l, drift.contact);
        Plan {
            raster,
            seats: pixel_seats(raster, self.mesh.surface()),
            law: PiezoLaw::new(piezo, 1.0 / (per_frame as f64 * rate_hz)),
            untouched_s,
            sheet_drift: slow(Purpose::SheetDrift, 0, drift.conductivity),
            contact_drift: (0..electrodes).map(contact).collect(),
            warming: self.warming(rate_hz, seed),
            open: open_contacts(instrument, instants, per_frame as f64 * rate_hz, electrodes, seed),
            scan: (0..drives as usize).map(scan).collect(),
            seed,
            per_frame,
            middle,
            times,
        }
    }

    /// Change of ln(conductivity) of each element by warming, from one frame to the next; empty without.
    fn warming(&self, rate_hz: f64, seed: u64) -> Vec<f64> {
        let drift = &self.settings.drift;
        if drift.warming_per_min == 0.0 {
            return Vec::new();
        }
        let mut random = Purpose::Warming.stream(seed, 0);
        // correlated over half of the skin's longer side
        let waves: Waves<2> = Waves::new(&mut random, self.motion.half_m, WEAVE_WAVES);
        let per_frame = drift.warming_per_min / (60.0 * rate_hz);
        let at = |c: &[f64; 3]| 1.0 + drift.warming_unevenness * waves.at([c[0], c[1]]);
        let centroids = self.mesh.surface().centroids();
        centroids.iter().map(|c| per_frame * at(c)).collect()
    }
}
