//! Simulation of a script: the memory of the fabric is updated frame by frame, solves run in
//! parallel.

mod frame;
mod plan;
mod results;
mod settings;

pub use settings::SimulationSettings;

use super::contact::Indentation;
use super::fabric_model::Fabric;
use super::instrument::Channels;
use super::motion::{Placed, ring};
use super::script::{Touch, TouchScript};
use super::seat::Seat;
use super::truth::Simulation;
use crate::error::FemError;
use eit_mesh::Raster;
use frame::{Frame, Worker, each, follow, remember};
use plan::Plan;
use results::true_touches;
use std::f64::consts::PI;
use std::time::Instant;

/// Number of frames processed together. Limits the memory, but is large enough to keep threads
/// busy.
const CHUNK: usize = 64;

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
        let start = Instant::now();
        let dents = self.check(script, raster, settings)?;
        let plan = self.plan(script, raster, settings.seed);
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
        let mut frames: Vec<Frame> =
            (0..CHUNK.min(script.frames)).map(|_| self.frame(raster)).collect();
        for first in (0..script.frames).step_by(CHUNK) {
            let count = CHUNK.min(script.frames - first);
            let chunk = &mut frames[..count];
            for (k, frame) in chunk.iter_mut().enumerate() {
                frame.index = first + k;
                frame.touches = script.touches(first + k);
                frame.dents.clone_from(&dents[first + k]);
            }
            self.conductivities(&plan, &mut workers, chunk, &mut memory);
            each(&mut workers, chunk, |worker, frame| {
                frame.error = self.solve(&plan, worker, frame).err();
            });
            for frame in chunk.iter_mut() {
                if let Some(error) = frame.error.take() {
                    return Err(error);
                }
                self.keep(&plan, &channels, frame, &mut made)?;
            }
            progress(first + count);
        }
        made.truth.touches = true_touches(script, &dents);
        made.report.time_s = start.elapsed().as_secs_f64();
        Ok(made)
    }

    /// Computes the conductivities of frames from their touches and the memory of each element.
    fn conductivities(
        &self,
        plan: &Plan<'_>,
        workers: &mut [Worker],
        frames: &mut [Frame],
        memory: &mut [f64],
    ) {
        if let Some(linear) = &self.settings.linear {
            return each(workers, frames, |_, frame| {
                self.elements.changes_into(linear, &frame.touches, &mut frame.elements);
                follow(plan, frame);
            });
        }
        each(workers, frames, |_, frame| {
            self.elements.drives_into(&frame.dents, &plan.law, &mut frame.elements);
        });
        frames.iter_mut().for_each(|frame| remember(plan, frame, memory));
    }

    /// Validates all input before any work. Returns the dents of every frame; none on a linear
    /// skin.
    fn check(
        &self,
        script: &TouchScript,
        raster: &Raster,
        settings: &SimulationSettings,
    ) -> Result<Vec<Vec<Placed>>, FemError> {
        script.validate(&self.mesh)?;
        let (triangles, elements) = (raster.masked_areas_m2().len(), self.model.elements());
        FemError::check_length("raster of another mesh: its triangles", triangles, elements)?;
        if settings.threads == 0 {
            let (quantity, must) = ("threads", "at least 1");
            return Err(FemError::OutOfRange { quantity, value: 0.0, must });
        }
        if self.settings.linear.is_some() {
            return Ok(vec![Vec::new(); script.frames]);
        }
        let place = |frame: usize, touch: &Touch| {
            let Touch { finger, tip, position_m, force_n, radius_m, direction } = *touch;
            let membrane = &self.settings.membrane;
            let nu = membrane.poisson_ratio;
            let drag_m = membrane.friction * force_n * (1.0 + nu) * (3.0 - nu)
                / (4.0 * PI * membrane.stiffness_n_per_m);
            let dent = Indentation::new(&self.settings.membrane, tip, radius_m, force_n);
            let time_s = frame as f64 / script.frame_rate_hz;
            let too_large = FemError::ForceTooLarge { finger, time_s, force_n, radius_m };
            let dent = dent.ok_or(too_large)?;
            let seat = Seat::on(self.mesh.surface(), position_m).ok_or_else(|| {
                let place = "seen from +z".to_owned();
                let [x_m, y_m] = position_m;
                FemError::OutsideSkin { finger, place, time_s, x_m, y_m }
            })?;
            let length_m = (membrane.tension_n_per_m / membrane.foundation_pa_per_m).sqrt();
            let ring = ring(&self.settings.piezo, &dent, length_m);
            Ok(Placed { seat, dent, drag_m: seat.tangent(direction).map(|d| d * drag_m), ring })
        };
        let frame = |f: usize| script.touches(f).iter().map(|touch| place(f, touch)).collect();
        (0..script.frames).map(frame).collect()
    }
}
