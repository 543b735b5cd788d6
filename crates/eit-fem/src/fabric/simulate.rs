//! Simulation of a script: the memory of the fabric is updated frame by frame, solves run in
//! parallel.

mod clock;
mod course;
mod instant;
mod linearised;
mod plan;
mod results;
mod settings;
mod simulated_skin;
mod view;

pub use settings::SimulationSettings;
pub use simulated_skin::{Contact, SimulatedFrame, SimulatedSkin};

use super::contact::Indentation;
use super::fabric_model::Fabric;
use super::motion::{Placed, ring};
use super::print::Ellipse;
use super::script::{Touch, TouchScript};
use super::seat::Seat;
use super::settings::FabricSettings;
use super::truth::Simulation;
use crate::error::FemError;
use course::{Course, Response};
use eit_mesh::Raster;
use instant::{Instant, Worker, each};
use plan::Plan;
use std::f64::consts::PI;
use std::time;
use view::View;

/// Number of frames processed together. Limits the memory, but is large enough to keep threads
/// busy.
const CHUNK: usize = 64;
/// Number of instants per frame at which a scan that takes time is solved. Between them, voltages are interpolated.
const INSTANTS: usize = 4;

impl Fabric {
    /// Simulates a script. Ground-truth images use `raster`, which must be of the same mesh. Calls
    /// `progress` with the number of finished frames.
    ///
    /// # Errors
    /// Before any work: those of [`TouchScript::validate`]; [`FemError::ForceTooLarge`] for a force
    /// beyond the contact model; [`FemError::WrongLength`] for a raster of another mesh;
    /// [`FemError::OutOfRange`] for no threads. During the simulation: [`FemError::FoldedMesh`] if
    /// touches invert a triangle, and those of
    /// [`ForwardModel::solve_deformed`](crate::ForwardModel::solve_deformed).
    pub fn simulate(
        &self,
        script: &TouchScript,
        raster: &Raster,
        settings: &SimulationSettings,
        progress: &mut dyn FnMut(usize),
    ) -> Result<Simulation, FemError> {
        let start = time::Instant::now();
        self.check(script, raster, settings)?;
        let rate_hz = script.frame_rate_hz;
        let clock = self.clock(rate_hz);
        let n = clock.per_frame;
        // all of them before any work
        let at = |k| {
            self.dents(&script.touches_at(clock.time(k)), clock.time(k) / rate_hz, settings.seed)
        };
        let dents = (0..n * script.frames).map(at).collect::<Result<Vec<_>, _>>()?;
        let view = View::new(raster, self.mesh.surface());
        let sizes = (CHUNK.min(script.frames), raster.masked_pixels().len());
        let mut course = Course::new(self, (rate_hz, settings.seed), sizes, |_| {
            let workers = (0..settings.threads.min(CHUNK)).map(|_| self.worker());
            Ok(Response::Full(workers.collect::<Result<_, _>>()?))
        })?;
        let mut made = self.empty(script.frames, &view, &course, settings);
        for first in (0..script.frames).step_by(CHUNK) {
            let count = CHUNK.min(script.frames - first);
            for (instant, dents) in course.next(count).iter_mut().zip(&dents[n * first..]) {
                instant.touches = script.touches_at(instant.time);
                instant.dents.clone_from(dents);
            }
            course.solve(self, count, Some(&view))?;
            for ahead in 0..count {
                let (measured, instant, untouched_s) = course.measure(self, ahead);
                self.keep(&view, untouched_s, measured, instant, &mut made)?;
            }
            course.pass(count);
            progress(first + count);
        }
        made.report.time_s = start.elapsed().as_secs_f64();
        Ok(made)
    }

    /// Computes drives or, with the memory of each element, changes of ln(conductivity) from the touches of instants; on
    /// a linear skin relative changes.
    fn changes(
        &self,
        plan: &Plan,
        workers: &mut [Worker],
        instants: &mut [Instant],
        memory: &mut [f64],
    ) {
        if let Some(linear) = &self.settings.linear {
            return each(workers, instants, |_, instant| {
                self.elements.changes_into(linear, &instant.touches, &mut instant.elements);
            });
        }
        each(workers, instants, |_, instant| {
            self.elements.drives_into(&instant.dents, &plan.law, &mut instant.elements);
        });
        instants.iter_mut().for_each(|instant| plan.remember(instant, memory));
    }

    /// Validates the input before any work.
    fn check(
        &self,
        script: &TouchScript,
        raster: &Raster,
        settings: &SimulationSettings,
    ) -> Result<(), FemError> {
        script.validate(&self.mesh)?;
        let (triangles, elements) = (raster.masked_areas_m2().len(), self.model.elements());
        FemError::check_length("raster of another mesh: its triangles", triangles, elements)?;
        FemError::require("threads", settings.threads as f64, settings.threads > 0, "at least 1")
    }

    /// Computes the dents of touches; none on a linear skin.
    fn dents(&self, touches: &[Touch], time_s: f64, seed: u64) -> Result<Vec<Placed>, FemError> {
        if self.settings.linear.is_some() {
            return Ok(Vec::new());
        }
        let FabricSettings { membrane, print, piezo, .. } = &self.settings;
        let place = |touch: &Touch| {
            let Touch { finger, tip, force_n, radius_m, direction, .. } = *touch;
            let nu = membrane.poisson_ratio;
            let drag_m = membrane.friction * force_n * (1.0 + nu) * (3.0 - nu)
                / (4.0 * PI * membrane.stiffness_n_per_m);
            let too_large = FemError::ForceTooLarge { finger, time_s, force_n, radius_m };
            let dent = Indentation::new(membrane, tip, radius_m, force_n).ok_or(too_large)?;
            let Ellipse { centre_m, axis, stretch } = print.at(touch, time_s, seed);
            let seen = || "as its print rolls, seen from +z".to_owned();
            let near = self.elements.near(centre_m);
            let seat = Seat::among(self.mesh.surface(), near, centre_m);
            let seat = Seat::require(seat, finger, seen, time_s, centre_m)?;
            let ring = ring(piezo, &dent, membrane.length_m());
            let drag_m = seat.tangent(direction).map(|d| d * drag_m);
            Ok(Placed { seat, dent, drag_m, ring, axis: seat.tangent(axis), stretch })
        };
        touches.iter().map(place).collect()
    }
}
