//! Assembly of results and ground truth.

use super::CHUNK;
use super::instant::Instant;
use super::plan::Plan;
use super::settings::SimulationSettings;
use crate::error::FemError;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::instrument::Channels;
use crate::fabric::motion::Placed;
use crate::fabric::script::{Touch, TouchScript};
use crate::fabric::truth::{Simulation, SimulationReport, TrueQuality, TrueTouch, Truth};
use crate::solve::SolveReport;
use ndarray::{Array1, Array2, Array3, ArrayView1, Axis};
use std::f64::consts::PI;

impl Fabric {
    pub(super) fn empty(
        &self,
        script: &TouchScript,
        plan: &Plan<'_>,
        settings: &SimulationSettings,
        reference_v: Array1<f64>,
        untouched: SolveReport,
    ) -> Simulation {
        let (frames, measurements) = (script.frames, reference_v.len());
        let (electrodes, side) = (self.contact_impedance.len(), plan.raster.pixels());
        let truth = Truth {
            pressure_pa: Array3::zeros((frames, side, side)),
            conductivity_change_s: Array3::zeros((frames, side, side)),
            element_change_s: settings
                .keep_elements
                .then(|| Array2::zeros((frames, self.model.elements()))),
            untouched_s: plan.untouched_s.clone().into(),
            touches: Vec::new(),
            electrode_shift_m: Array3::zeros((frames, electrodes, 3)),
            contact_impedance: Array2::zeros((frames, electrodes)),
            quality: Array2::from_elem((frames, measurements), TrueQuality::Good),
            noise_std_v: Array1::zeros(measurements),
        };
        let report = SimulationReport {
            frames,
            threads: settings.threads.min(CHUNK),
            untouched,
            least_area_ratio: 1.0,
            range_v: None,
            time_s: 0.0,
        };
        let exact_v = Array2::zeros((frames, measurements));
        Simulation { frames_v: exact_v.clone(), exact_v, reference_v, truth, report }
    }

    /// Passes a frame, solved at the instants of its scan, through the instrument and stores it in the results.
    pub(super) fn keep(
        &self,
        plan: &Plan<'_>,
        channels: &Channels,
        f: usize,
        scan: &mut [Instant],
        made: &mut Simulation,
    ) -> Result<(), FemError> {
        let (mut values_v, mut quality) = self.scanned(plan, scan);
        let (instant, truth) = (&mut scan[1 + plan.middle], &mut made.truth);
        made.exact_v.row_mut(f).assign(&ArrayView1::from(&values_v));
        channels.measure(f, &mut values_v, &mut quality);
        let count = values_v.len();
        for k in channels.own_values(f, count)..count {
            (values_v[k], quality[k]) = (made.frames_v[[f - 1, k]], TrueQuality::Torn);
        }
        made.frames_v.row_mut(f).assign(&ArrayView1::from(&values_v));
        truth.quality.row_mut(f).assign(&Array1::from_vec(quality));
        for (sigma, untouched) in instant.elements.iter_mut().zip(&plan.untouched_s) {
            *sigma -= untouched;
        }
        if let Some(changes) = &mut truth.element_change_s {
            changes.row_mut(f).assign(&ArrayView1::from(&instant.elements));
        }
        let image = |array: &mut Array3<f64>, pixels: &[f64]| {
            let (what, wanted) = ("pixels of the raster", plan.raster.masked_pixels().len());
            let sizes = |_| FemError::WrongLength { what, found: pixels.len(), wanted };
            let row = array.index_axis_mut(Axis(0), f);
            plan.raster.image_from_pixels_into(pixels, row).map_err(sizes)
        };
        image(&mut truth.pressure_pa, &instant.pixels_pa)?;
        // the pressures are stored, so reuse their memory for the conductivities
        let pixels = &mut instant.pixels_pa;
        plan.raster.pixel_from_element().apply(&instant.elements, pixels).map_err(|_| {
            let (found, wanted) = (instant.elements.len(), self.model.elements());
            FemError::WrongLength { what: "elements of the raster", found, wanted }
        })?;
        image(&mut truth.conductivity_change_s, pixels)?;
        for (l, shift) in instant.shifts_m.iter().enumerate() {
            (0..3).for_each(|k| truth.electrode_shift_m[[f, l, k]] = shift[k]);
        }
        truth.contact_impedance.row_mut(f).assign(&ArrayView1::from(&instant.contact_impedance));
        made.report.least_area_ratio = made.report.least_area_ratio.min(instant.area_ratio);
        Ok(())
    }

    /// Exact value and quality of each measurement when its drive is on, interpolated between the last instant of the
    /// former frame and those of this one.
    fn scanned(&self, plan: &Plan<'_>, scan: &[Instant]) -> (Vec<f64>, Vec<TrueQuality>) {
        let at = |(k, datum): (usize, &[u32; 2])| {
            let place = (1 + plan.middle) as f64 + plan.scan[datum[0] as usize];
            let (before, part) = (&scan[place as usize], place.fract());
            let after = if part > 0.0 { &scan[place as usize + 1] } else { before };
            let [v, next_v] = [before, after].map(|instant| instant.voltages_v[k]);
            let quality = [before, after].map(|instant| self.quality(plan, instant, datum));
            (v + part * (next_v - v), quality[0].max(quality[1]))
        };
        self.model.protocol().data().iter().enumerate().map(at).unzip()
    }

    /// Quality of a measurement before the converter.
    fn quality(&self, plan: &Plan<'_>, instant: &Instant, datum: &[u32; 2]) -> TrueQuality {
        let patterns = &self.model.patterns;
        let lost = |l: u32| self.settings.instrument.lost.contains(&(l as usize + 1));
        let open = |l: u32| plan.open[instant.index][l as usize];
        let [stimulation, pattern] = datum.map(|k| k as usize);
        let involved =
            patterns.stimulations_a[stimulation].iter().chain(&patterns.measurements[pattern]);
        let mut electrodes = involved.map(|entry| entry.0);
        if electrodes.clone().any(lost) {
            TrueQuality::Lost
        } else if electrodes.any(open) {
            TrueQuality::Loose
        } else if instant.limited[stimulation] {
            TrueQuality::SourceLimited
        } else {
            TrueQuality::Good
        }
    }
}

/// Collects the touches of all frames. Without dents (linear skin), the contact radius is that of
/// the tip.
pub(super) fn true_touches(
    plan: &Plan<'_>,
    script: &TouchScript,
    placed: &[Vec<Placed>],
) -> Vec<TrueTouch> {
    let middles = placed.iter().skip(plan.middle).step_by(plan.per_frame);
    let of_frame = |(frame, dents): (usize, &Vec<Placed>)| {
        let of = move |(k, touch): (usize, Touch)| {
            let dent = dents.get(k).map(|placed| placed.dent);
            let [x, y, _] = dents.get(k).map_or([0.0; 3], |placed| placed.seat.place_m);
            let contact_radius_m = dent.map_or(touch.radius_m, |dent| dent.contact_radius_m);
            TrueTouch {
                frame,
                finger: touch.finger,
                position_m: dent.map_or(touch.position_m, |_| [x, y]),
                force_n: touch.force_n,
                tip_radius_m: touch.radius_m,
                contact_radius_m,
                area_m2: PI * contact_radius_m.powi(2),
                depth_m: dent.map_or(0.0, |dent| dent.depth_m),
            }
        };
        script.touches(frame).into_iter().enumerate().map(of).collect::<Vec<_>>()
    };
    middles.enumerate().flat_map(of_frame).collect()
}
