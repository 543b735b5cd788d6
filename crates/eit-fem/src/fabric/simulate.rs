//! Simulation of a script: the memory of the fabric is updated frame by frame, solves run in
//! parallel.

mod instant;
mod plan;
mod results;
mod settings;

pub use settings::SimulationSettings;

use super::contact::Indentation;
use super::fabric_model::Fabric;
use super::instrument::Channels;
use super::motion::{Placed, ring};
use super::print::Ellipse;
use super::script::{Touch, TouchScript};
use super::seat::Seat;
use super::settings::FabricSettings;
use super::truth::Simulation;
use crate::error::FemError;
use eit_mesh::Raster;
use instant::{Instant, Worker, each, follow, remember};
use plan::Plan;
use results::true_touches;
use std::f64::consts::PI;
use std::time;

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
        let plan = self.plan(script, raster, settings.seed);
        let dents = self.dents(script, &plan)?;
        let mut workers: Vec<Worker> =
            (0..settings.threads.min(CHUNK)).map(|_| self.worker()).collect::<Result<_, _>>()?;
        let (reference_v, untouched) = self.untouched(&plan, &mut workers[0])?;
        let protocol = self.model.protocol();
        let instrument = &self.settings.instrument;
        let (reference, rate_hz) = (reference_v.to_vec(), script.frame_rate_hz);
        let channels = Channels::new(instrument, protocol, &reference, rate_hz, settings.seed);
        let mut made = self.empty(script, &plan, settings, reference_v, untouched);
        made.report.range_v = channels.range_v();
        made.truth.noise_std_v = channels.noise_std_v(protocol.measurements()).into();
        let mut memory = vec![0.0; plan.law.memory() * self.model.elements()];
        let n = plan.per_frame;
        // the first is the last of the chunk before
        let mut instants: Vec<Instant> =
            (0..=n * CHUNK.min(script.frames)).map(|_| self.instant(raster)).collect();
        for first in (0..script.frames).step_by(CHUNK) {
            let count = CHUNK.min(script.frames - first);
            let chunk = &mut instants[1..=n * count];
            for (instant, index) in chunk.iter_mut().zip(n * first..) {
                instant.index = index;
                instant.touches = script.touches_at(plan.times[index]);
                instant.dents.clone_from(&dents[index]);
            }
            self.conductivities(&plan, &mut workers, chunk, &mut memory);
            each(&mut workers, chunk, |worker, instant| {
                instant.error = self.solve(&plan, worker, instant).err();
            });
            if let Some(error) = chunk.iter_mut().find_map(|instant| instant.error.take()) {
                return Err(error);
            }
            if first == 0 {
                instants[0] = instants[1].clone();
            }
            for k in 0..count {
                let scan = &mut instants[n * k..=n * (k + 1)];
                self.keep(&plan, &channels, first + k, scan, &mut made)?;
            }
            instants.swap(0, n * count);
            progress(first + count);
        }
        made.truth.touches = true_touches(&plan, script, &dents);
        made.report.time_s = start.elapsed().as_secs_f64();
        Ok(made)
    }

    /// Computes the conductivities of frames from their touches and the memory of each element.
    fn conductivities(
        &self,
        plan: &Plan<'_>,
        workers: &mut [Worker],
        instants: &mut [Instant],
        memory: &mut [f64],
    ) {
        if let Some(linear) = &self.settings.linear {
            return each(workers, instants, |_, instant| {
                self.elements.changes_into(linear, &instant.touches, &mut instant.elements);
                follow(plan, instant);
            });
        }
        each(workers, instants, |_, instant| {
            self.elements.drives_into(&instant.dents, &plan.law, &mut instant.elements);
        });
        instants.iter_mut().for_each(|instant| remember(plan, instant, memory));
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

    /// Computes the dents of every instant; none on a linear skin.
    fn dents(&self, script: &TouchScript, plan: &Plan<'_>) -> Result<Vec<Vec<Placed>>, FemError> {
        if self.settings.linear.is_some() {
            return Ok(vec![Vec::new(); plan.times.len()]);
        }
        let FabricSettings { membrane, print, piezo, .. } = &self.settings;
        let place = |time_s: f64, touch: &Touch| {
            let Touch { finger, tip, force_n, radius_m, direction, .. } = *touch;
            let nu = membrane.poisson_ratio;
            let drag_m = membrane.friction * force_n * (1.0 + nu) * (3.0 - nu)
                / (4.0 * PI * membrane.stiffness_n_per_m);
            let too_large = FemError::ForceTooLarge { finger, time_s, force_n, radius_m };
            let dent = Indentation::new(membrane, tip, radius_m, force_n).ok_or(too_large)?;
            let Ellipse { centre_m, axis, stretch } = print.at(touch, time_s, plan.seed);
            let seen = || "as its print rolls, seen from +z".to_owned();
            let seat = Seat::require(self.mesh.surface(), finger, seen, time_s, centre_m)?;
            let ring = ring(piezo, &dent, membrane.length_m());
            let drag_m = seat.tangent(direction).map(|d| d * drag_m);
            Ok(Placed { seat, dent, drag_m, ring, axis: seat.tangent(axis), stretch })
        };
        let at = |time: &f64| {
            let time_s = time / script.frame_rate_hz;
            script.touches_at(*time).iter().map(|touch| place(time_s, touch)).collect()
        };
        plan.times.iter().map(at).collect()
    }
}
