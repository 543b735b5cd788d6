//! One instant: move the nodes, solve, and compute exact voltages. A frame has one instant, or several if its scan takes time.

use super::plan::Plan;
use crate::error::FemError;
use crate::fabric::conductivity::pressures_into;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::linear;
use crate::fabric::motion::Placed;
use crate::fabric::pixels::pixel_means_into;
use crate::fabric::script::Touch;
use crate::model::Geometry;
use crate::solve::{SolveReport, Workspace};
use eit_core::vector::{dot, normal, unit};
use eit_mesh::Raster;
use ndarray::{Array1, Array2, ArrayView1};

/// Intermediate results of one instant.
#[derive(Clone)]
pub(super) struct Instant {
    /// Index in [`Plan::times`].
    pub index: usize,
    /// Touches and their dents; a linear skin has no dents.
    pub touches: Vec<Touch>,
    pub dents: Vec<Placed>,
    /// For each element: first the drive or relative change, later the conductivity.
    pub elements: Vec<f64>,
    pub contact_impedance: Vec<f64>,
    pub shifts_m: Vec<[f64; 3]>,
    pub pixels_pa: Vec<f64>,
    pub voltages_v: Vec<f64>,
    /// Whether the source was limited, for each stimulation.
    pub limited: Vec<bool>,
    pub area_ratio: f64,
    pub error: Option<FemError>,
}

/// Working memory of one thread.
pub(super) struct Worker {
    pub workspace: Workspace,
    pub geometry: Geometry,
    pub nodes_m: Vec<[f64; 3]>,
}

impl Fabric {
    pub(super) fn worker(&self) -> Result<Worker, FemError> {
        Ok(Worker {
            workspace: self.model.workspace()?,
            geometry: self.model.geometry(),
            nodes_m: self.mesh.surface().nodes().to_vec(),
        })
    }

    pub(super) fn instant(&self, raster: &Raster) -> Instant {
        let electrodes = self.contact_impedance.len();
        Instant {
            index: 0,
            touches: Vec::new(),
            dents: Vec::new(),
            elements: vec![0.0; self.model.elements()],
            contact_impedance: vec![0.0; electrodes],
            shifts_m: vec![[0.0; 3]; electrodes],
            pixels_pa: vec![0.0; raster.masked_pixels().len()],
            voltages_v: vec![0.0; self.model.protocol().measurements()],
            limited: vec![false; self.model.protocol().stimulations_a().nrows()],
            area_ratio: 1.0,
            error: None,
        }
    }

    /// Voltages of the untouched skin with all contacts intact.
    pub(super) fn untouched(
        &self,
        plan: &Plan<'_>,
        worker: &mut Worker,
    ) -> Result<(Array1<f64>, SolveReport), FemError> {
        let mut solution = self.model.solve(&plan.untouched_s, &mut worker.workspace)?;
        Ok((solution.measurements(), solution.report()))
    }

    /// Moves the nodes, solves, and computes exact voltages.
    pub(super) fn solve(
        &self,
        plan: &Plan<'_>,
        worker: &mut Worker,
        instant: &mut Instant,
    ) -> Result<(), FemError> {
        let Worker { workspace, geometry, nodes_m } = worker;
        for (log, drift) in instant.contact_impedance.iter_mut().zip(&plan.contact_drift) {
            *log = drift[instant.index];
        }
        self.motion.add_contacts(&instant.dents, &mut instant.contact_impedance);
        let instrument = &self.settings.instrument;
        for (l, z) in instant.contact_impedance.iter_mut().enumerate() {
            let open = plan.open[instant.index][l] || instrument.lost.contains(&(l + 1));
            let factor = if open { instrument.open_factor } else { 1.0 };
            *z = if *z == 0.0 { 1.0 } else { z.exp() } * factor * self.contact_impedance[l];
        }
        let touches = if self.motion.moves { instant.dents.as_slice() } else { &[] };
        self.motion.nodes_into(touches, nodes_m);
        self.motion.shifts_into(nodes_m, &mut instant.shifts_m);
        let frame = plan.times[instant.index].round() as usize;
        instant.area_ratio = self.area_ratio(frame, nodes_m)?;
        self.model.deform(nodes_m, &instant.contact_impedance, geometry)?;
        let solution = self.model.solve_deformed(geometry, &instant.elements, workspace)?;
        solution.measurements_into(&mut instant.voltages_v)?;
        if instrument.compliance_v.is_some() || instrument.common_mode_db.is_some() {
            let potentials = solution.electrode_potentials();
            if let Some(rejection_db) = instrument.common_mode_db {
                self.leak(rejection_db, &potentials, &mut instant.voltages_v);
            }
            if let Some(compliance_v) = instrument.compliance_v {
                self.limit(compliance_v, &potentials, instant);
            }
        }
        match self.settings.linear {
            None => {
                pressures_into(plan.raster, &plan.seats, &instant.dents, &mut instant.pixels_pa);
            }
            Some(_) => {
                let at = |place| linear::pressure_pa(&instant.touches, place);
                pixel_means_into(plan.raster, at, &mut instant.pixels_pa);
            }
        }
        Ok(())
    }

    /// Smallest ratio of a triangle's area, seen along its normal at rest, to its area at rest.
    pub(super) fn area_ratio(&self, frame: usize, nodes_m: &[[f64; 3]]) -> Result<f64, FemError> {
        let surface = self.mesh.surface();
        let mut least = f64::INFINITY;
        for (triangle, (corners, area_m2)) in
            surface.triangles().iter().zip(surface.areas_m2()).enumerate()
        {
            let up = unit(normal(surface.corners(triangle)));
            let moved = normal(corners.map(|n| nodes_m[n as usize]));
            let ratio = 0.5 * dot(moved, up) / area_m2;
            if ratio.is_nan() || ratio <= 0.0 {
                return Err(FemError::FoldedMesh { frame, triangle, area_ratio: ratio });
            }
            least = least.min(ratio);
        }
        Ok(least)
    }

    /// Adds the part of the mean potential of the measured electrodes, above the sink of the current, that an amplifier
    /// does not reject.
    fn leak(&self, rejection_db: f64, potentials: &Array2<f64>, voltages_v: &mut [f64]) {
        let leaking = 10_f64.powf(-0.05 * rejection_db);
        let patterns = &self.model.patterns;
        for (v, [stimulation, pattern]) in voltages_v.iter_mut().zip(self.model.protocol().data()) {
            let row = potentials.row(*stimulation as usize);
            let currents = &patterns.stimulations_a[*stimulation as usize];
            let sink = currents.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |c| c.0);
            let weights = &patterns.measurements[*pattern as usize];
            let whole: f64 = weights.iter().map(|(_, w)| w.abs()).sum();
            let mean = weights.iter().map(|(l, w)| w.abs() * row[*l as usize]).sum::<f64>() / whole;
            *v += leaking * (mean - row[sink as usize]);
        }
    }

    /// Scales down stimulations whose drive voltage exceeds the compliance voltage of the source.
    pub(super) fn limit(&self, compliance_v: f64, potentials: &Array2<f64>, instant: &mut Instant) {
        let factor = |(currents, row): (&Vec<(u32, f64)>, ArrayView1<'_, f64>)| {
            let driven = currents.iter().map(|c| row[c.0 as usize]);
            let (low, high) =
                driven.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            (compliance_v / (high - low)).min(1.0)
        };
        let stimulations = &self.model.patterns.stimulations_a;
        let factors: Vec<f64> = stimulations.iter().zip(potentials.rows()).map(factor).collect();
        instant.limited.iter_mut().zip(&factors).for_each(|(limited, f)| *limited = *f < 1.0);
        for (v, datum) in instant.voltages_v.iter_mut().zip(self.model.protocol().data()) {
            *v *= factors[datum[0] as usize];
        }
    }
}

/// Processes instants in parallel. Each is independent of the others, so results do not depend
/// on the number of threads.
pub(super) fn each(
    workers: &mut [Worker],
    instants: &mut [Instant],
    work: impl Fn(&mut Worker, &mut Instant) + Sync,
) {
    let share = instants.len().div_ceil(workers.len());
    std::thread::scope(|scope| {
        for (worker, instants) in workers.iter_mut().zip(instants.chunks_mut(share)) {
            let work = &work;
            scope.spawn(move || instants.iter_mut().for_each(|instant| work(worker, instant)));
        }
    });
}

/// Converts relative changes to conductivities, without memory.
pub(super) fn follow(plan: &Plan<'_>, instant: &mut Instant) {
    let drift = plan.sheet_drift[instant.index].exp();
    for (value, untouched) in instant.elements.iter_mut().zip(&plan.untouched_s) {
        *value = untouched * (1.0 + *value) * drift;
    }
    warm(plan, instant);
}

/// Warms the sheet.
fn warm(plan: &Plan<'_>, instant: &mut Instant) {
    for (value, warming) in instant.elements.iter_mut().zip(&plan.warming) {
        *value *= (plan.times[instant.index] * warming).exp();
    }
}

/// Converts drives to conductivities, with the memory of each element.
pub(super) fn remember(plan: &Plan<'_>, instant: &mut Instant, memory: &mut [f64]) {
    let size = plan.law.memory();
    let drift = plan.sheet_drift[instant.index];
    for (e, (value, untouched)) in instant.elements.iter_mut().zip(&plan.untouched_s).enumerate() {
        let change = drift + plan.law.step(*value, &mut memory[e * size..(e + 1) * size]);
        *value = if change == 0.0 { *untouched } else { untouched * change.exp() };
    }
    warm(plan, instant);
}
