//! Assembly of results and ground truth.

use super::CHUNK;
use super::frame::Frame;
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

    /// Passes a solved frame through the instrument and stores it in the results.
    pub(super) fn keep(
        &self,
        plan: &Plan<'_>,
        channels: &Channels,
        frame: &mut Frame,
        made: &mut Simulation,
    ) -> Result<(), FemError> {
        let (f, truth) = (frame.index, &mut made.truth);
        made.exact_v.row_mut(f).assign(&ArrayView1::from(&frame.voltages_v));
        let mut quality = self.quality(plan, frame);
        channels.measure(f, &mut frame.voltages_v, &mut quality);
        made.frames_v.row_mut(f).assign(&ArrayView1::from(&frame.voltages_v));
        truth.quality.row_mut(f).assign(&Array1::from_vec(quality));
        for (sigma, untouched) in frame.elements.iter_mut().zip(&plan.untouched_s) {
            *sigma -= untouched;
        }
        if let Some(changes) = &mut truth.element_change_s {
            changes.row_mut(f).assign(&ArrayView1::from(&frame.elements));
        }
        let image = |array: &mut Array3<f64>, pixels: &[f64]| {
            let sizes = |_| FemError::WrongLength {
                what: "pixels of the raster",
                found: pixels.len(),
                wanted: plan.raster.masked_pixels().len(),
            };
            let row = array.index_axis_mut(Axis(0), f);
            plan.raster.image_from_pixels_into(pixels, row).map_err(sizes)
        };
        image(&mut truth.pressure_pa, &frame.pixels_pa)?;
        // the pressures are stored, so reuse their memory for the conductivities
        let pixels = &mut frame.pixels_pa;
        plan.raster.pixel_from_element().apply(&frame.elements, pixels).map_err(|_| {
            let (found, wanted) = (frame.elements.len(), self.model.elements());
            FemError::WrongLength { what: "elements of the raster", found, wanted }
        })?;
        image(&mut truth.conductivity_change_s, pixels)?;
        for (l, shift) in frame.shifts_m.iter().enumerate() {
            (0..3).for_each(|k| truth.electrode_shift_m[[f, l, k]] = shift[k]);
        }
        truth.contact_impedance.row_mut(f).assign(&ArrayView1::from(&frame.contact_impedance));
        made.report.least_area_ratio = made.report.least_area_ratio.min(frame.area_ratio);
        Ok(())
    }

    /// Quality of each measurement before the converter.
    pub(super) fn quality(&self, plan: &Plan<'_>, frame: &Frame) -> Vec<TrueQuality> {
        let patterns = &self.model.patterns;
        let lost = |l: u32| self.settings.instrument.lost.contains(&(l as usize + 1));
        let open = |l: u32| plan.open[frame.index][l as usize];
        let of = |datum: &[u32; 2]| {
            let [stimulation, pattern] = datum.map(|k| k as usize);
            let involved =
                patterns.stimulations_a[stimulation].iter().chain(&patterns.measurements[pattern]);
            let mut electrodes = involved.map(|entry| entry.0);
            if electrodes.clone().any(lost) {
                TrueQuality::Lost
            } else if electrodes.any(open) {
                TrueQuality::Loose
            } else if frame.limited[stimulation] {
                TrueQuality::SourceLimited
            } else {
                TrueQuality::Good
            }
        };
        self.model.protocol().data().iter().map(of).collect()
    }
}

/// Collects the touches of all frames. Without dents (linear skin), the contact radius is that of
/// the tip.
pub(super) fn true_touches(script: &TouchScript, placed: &[Vec<Placed>]) -> Vec<TrueTouch> {
    let frames = placed.iter().enumerate();
    let of_frame = |(frame, dents): (usize, &Vec<Placed>)| {
        let of = move |(k, touch): (usize, Touch)| {
            let dent = dents.get(k).map(|placed| placed.dent);
            let contact_radius_m = dent.map_or(touch.radius_m, |dent| dent.contact_radius_m);
            TrueTouch {
                frame,
                finger: touch.finger,
                position_m: touch.position_m,
                force_n: touch.force_n,
                tip_radius_m: touch.radius_m,
                contact_radius_m,
                area_m2: PI * contact_radius_m.powi(2),
                depth_m: dent.map_or(0.0, |dent| dent.depth_m),
            }
        };
        script.touches(frame).into_iter().enumerate().map(of).collect::<Vec<_>>()
    };
    frames.flat_map(of_frame).collect()
}
