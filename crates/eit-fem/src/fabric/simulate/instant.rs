//! One instant: move the nodes, solve, and compute exact voltages. A frame has one instant, or several if its scan takes time.

use super::plan::Plan;
use super::view::View;
use crate::error::FemError;
use crate::fabric::conductivity::pressures_into;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::linear;
use crate::fabric::motion::Placed;
use crate::fabric::pixels::pixel_means_into;
use crate::fabric::script::Touch;
use crate::model::Geometry;
use crate::solve::Workspace;
use eit_core::vector::{dot, normal, unit};
use ndarray::{Array2, ArrayView1};

/// Intermediate results of one instant.
#[derive(Clone, Default)]
pub(super) struct Instant {
    /// Time in frames and in seconds, and the number of its frame.
    pub time: f64,
    pub time_s: f64,
    pub frame: usize,
    /// Which contacts are open.
    pub open: Vec<bool>,
    /// Touches and their dents; a linear skin has no dents.
    pub touches: Vec<Touch>,
    pub dents: Vec<Placed>,
    /// For each element: first the drive or relative change, then the change of ln(conductivity), then the conductivity.
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

    /// An instant, with the mean pressure of so many pixels.
    pub(super) fn instant(&self, pixels: usize) -> Instant {
        let electrodes = self.contact_impedance.len();
        Instant {
            open: vec![false; electrodes],
            elements: vec![0.0; self.model.elements()],
            contact_impedance: vec![0.0; electrodes],
            shifts_m: vec![[0.0; 3]; electrodes],
            pixels_pa: vec![0.0; pixels],
            voltages_v: vec![0.0; self.model.protocol().measurements()],
            limited: vec![false; self.model.protocol().stimulations_a().nrows()],
            area_ratio: 1.0,
            ..Instant::default()
        }
    }

    /// Moves the nodes, solves, and computes exact voltages.
    pub(super) fn solve(
        &self,
        plan: &Plan,
        view: Option<&View<'_>>,
        worker: &mut Worker,
        instant: &mut Instant,
    ) -> Result<(), FemError> {
        let Worker { workspace, geometry, nodes_m } = worker;
        plan.conduct(self.settings.linear.is_some(), instant);
        for (log, drift) in instant.contact_impedance.iter_mut().zip(&plan.contact_drift) {
            *log = drift.at(instant.time_s);
        }
        if !instant.dents.is_empty() {
            let at = |touch: &Placed, place| touch.dent.at(touch.distance_m(place)).deflection_m;
            let sum = |place| instant.dents.iter().map(|touch| at(touch, place)).sum();
            self.motion.add_contacts(sum, &mut instant.contact_impedance);
        }
        let instrument = &self.settings.instrument;
        for (l, z) in instant.contact_impedance.iter_mut().enumerate() {
            let open = instant.open[l] || instrument.lost.contains(&(l + 1));
            let factor = if open { instrument.open_factor } else { 1.0 };
            *z = if *z == 0.0 { 1.0 } else { z.exp() } * factor * self.contact_impedance[l];
        }
        let touches = if self.motion.moves { instant.dents.as_slice() } else { &[] };
        self.motion.nodes_into(touches, nodes_m);
        self.motion.shifts_into(nodes_m, &mut instant.shifts_m);
        instant.area_ratio = self.area_ratio(instant.frame, nodes_m)?;
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
        let Some(View { raster, seats }) = view else { return Ok(()) };
        match self.settings.linear {
            None => pressures_into(raster, seats, &instant.dents, &mut instant.pixels_pa),
            Some(_) => {
                let at = |place| linear::pressure_pa(&instant.touches, place);
                pixel_means_into(raster, at, &mut instant.pixels_pa);
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

impl Plan {
    /// Converts drives to changes of ln(conductivity), with the memory of each element.
    pub(super) fn remember(&self, instant: &mut Instant, memory: &mut [f64]) {
        let size = self.law.memory();
        let drift = self.sheet_drift.at(instant.time_s);
        for (e, value) in instant.elements.iter_mut().enumerate() {
            *value = drift + self.law.step(*value, &mut memory[e * size..(e + 1) * size]);
        }
    }

    /// Converts changes to conductivities, relative ones on a linear skin and else those of the logarithm, and warms
    /// the sheet.
    fn conduct(&self, is_linear: bool, instant: &mut Instant) {
        let drift = self.sheet_drift.at(instant.time_s).exp();
        for (value, untouched) in instant.elements.iter_mut().zip(&self.untouched_s) {
            *value = match is_linear {
                true => untouched * (1.0 + *value) * drift,
                false if *value == 0.0 => *untouched,
                false => untouched * value.exp(),
            };
        }
        for (value, warmth) in instant.elements.iter_mut().zip(self.warmth(instant.time)) {
            *value *= warmth.exp();
        }
    }
}
