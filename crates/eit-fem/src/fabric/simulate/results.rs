//! Assembly of results and ground truth.

use super::CHUNK;
use super::course::{Course, Measured};
use super::instant::Instant;
use super::settings::SimulationSettings;
use super::view::View;
use crate::error::FemError;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::truth::{Simulation, SimulationReport, TrueQuality, TrueTouch, Truth};
use ndarray::{Array2, Array3, ArrayView1, Axis};
use std::f64::consts::PI;

impl Fabric {
    pub(super) fn empty(
        &self,
        frames: usize,
        view: &View<'_>,
        course: &Course,
        settings: &SimulationSettings,
    ) -> Simulation {
        let measurements = course.reference_v.len();
        let (electrodes, side) = (self.contact_impedance.len(), view.raster.pixels());
        let truth = Truth {
            pressure_pa: Array3::zeros((frames, side, side)),
            conductivity_change_s: Array3::zeros((frames, side, side)),
            element_change_s: settings
                .keep_elements
                .then(|| Array2::zeros((frames, self.model.elements()))),
            untouched_s: course.plan.untouched_s.clone().into(),
            touches: Vec::new(),
            electrode_shift_m: Array3::zeros((frames, electrodes, 3)),
            contact_impedance: Array2::zeros((frames, electrodes)),
            quality: Array2::from_elem((frames, measurements), TrueQuality::Good),
            noise_std_v: course.channels.noise_std_v(measurements).into(),
        };
        let report = SimulationReport {
            frames,
            threads: settings.threads.min(CHUNK),
            untouched: course.untouched,
            least_area_ratio: 1.0,
            range_v: course.channels.range_v(),
            time_s: 0.0,
        };
        let exact_v = Array2::zeros((frames, measurements));
        let reference_v = course.reference_v.clone().into();
        Simulation { frames_v: exact_v.clone(), exact_v, reference_v, truth, report }
    }

    /// Stores a frame and its truth in the results.
    pub(super) fn keep(
        &self,
        view: &View<'_>,
        untouched_s: &[f64],
        measured: &Measured,
        instant: &mut Instant,
        made: &mut Simulation,
    ) -> Result<(), FemError> {
        let (f, truth) = (instant.frame, &mut made.truth);
        made.exact_v.row_mut(f).assign(&ArrayView1::from(&measured.exact_v));
        made.frames_v.row_mut(f).assign(&ArrayView1::from(&measured.values_v));
        truth.quality.row_mut(f).assign(&ArrayView1::from(&measured.quality));
        truth.touches.extend(instant.true_touches());
        for (sigma, untouched) in instant.elements.iter_mut().zip(untouched_s) {
            *sigma -= untouched;
        }
        if let Some(changes) = &mut truth.element_change_s {
            changes.row_mut(f).assign(&ArrayView1::from(&instant.elements));
        }
        let image = |array: &mut Array3<f64>, pixels: &[f64]| {
            let (what, wanted) = ("pixels of the raster", view.raster.masked_pixels().len());
            let sizes = |_| FemError::WrongLength { what, found: pixels.len(), wanted };
            let row = array.index_axis_mut(Axis(0), f);
            view.raster.image_from_pixels_into(pixels, row).map_err(sizes)
        };
        image(&mut truth.pressure_pa, &instant.pixels_pa)?;
        // the pressures are stored, so reuse their memory for the conductivities
        let pixels = &mut instant.pixels_pa;
        view.raster.pixel_from_element().apply(&instant.elements, pixels).map_err(|_| {
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
}

impl Instant {
    /// The touches of its frame. Without dents (linear skin), the contact radius is that of the tip.
    pub(super) fn true_touches(&self) -> impl Iterator<Item = TrueTouch> {
        self.touches.iter().enumerate().map(|(k, touch)| {
            let placed = self.dents.get(k);
            let contact_radius_m = placed.map_or(touch.radius_m, |p| p.dent.contact_radius_m);
            let [x, y] = touch.position_m;
            let place_m = placed.map_or([x, y, 0.0], |placed| placed.seat.place_m);
            TrueTouch {
                frame: self.frame,
                finger: touch.finger,
                position_m: [place_m[0], place_m[1]],
                force_n: touch.force_n,
                tip_radius_m: touch.radius_m,
                contact_radius_m,
                area_m2: PI * contact_radius_m.powi(2),
                depth_m: placed.map_or(0.0, |placed| placed.dent.depth_m),
            }
        })
    }
}
