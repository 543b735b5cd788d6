//! Frames of a script: memory of the fabric in order, solves in parallel.

use super::conductivity::{Elements, pressures_into};
use super::contact::Indentation;
use super::instrument::{Channels, open_contacts};
use super::motion::{Motion, Placed};
use super::piezo::PiezoLaw;
use super::random::{Purpose, Random, Waves};
use super::script::{Touch, TouchScript};
use super::settings::FabricSettings;
use super::truth::{Simulation, SimulationReport, TrueQuality, TrueTouch, Truth};
use crate::{FemError, ForwardModel, Geometry, Protocol, SolveReport, Workspace};
use eit_mesh::{Mesh, Raster};
use ndarray::{Array1, Array2, Array3, ArrayView1, Axis};
use std::f64::consts::PI;
use std::time::Instant;

/// Frames that are worked on together: bounds the memory, long enough to keep threads busy.
const CHUNK: usize = 64;
/// Waves of the uneven fabric, and of each drift.
const WEAVE_WAVES: usize = 512;
const DRIFT_WAVES: usize = 32;

/// A fabric with electrodes, ready to be touched.
#[derive(Debug)]
pub struct Fabric {
    mesh: Mesh,
    model: ForwardModel,
    settings: FabricSettings,
    conductivity_s: f64,
    contact_impedance: Vec<f64>,
    elements: Elements,
    motion: Motion,
}

/// How to simulate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SimulationSettings {
    /// Everything random comes from it.
    pub seed: u64,
    /// Threads, at least 1; the result does not depend on them.
    pub threads: usize,
    /// Keep the conductivity change of every element, 8 bytes an element and frame.
    pub keep_elements: bool,
}

impl Default for SimulationSettings {
    fn default() -> Self {
        Self { seed: 1, threads: 1, keep_elements: false }
    }
}

/// One frame's numbers on their way.
struct Frame {
    index: usize,
    touches: Vec<Placed>,
    /// First the drives, then the conductivity of each element.
    elements: Vec<f64>,
    contact_impedance: Vec<f64>,
    shifts_m: Vec<[f64; 3]>,
    pixels_pa: Vec<f64>,
    voltages_v: Vec<f64>,
    /// Stimulations in which the source gave up.
    limited: Vec<bool>,
    area_ratio: f64,
    error: Option<FemError>,
}

/// Memory of one thread.
struct Worker {
    workspace: Workspace,
    geometry: Geometry,
    nodes_m: Vec<[f64; 3]>,
}

/// What all frames share.
struct Plan<'a> {
    raster: &'a Raster,
    law: PiezoLaw,
    untouched_s: Vec<f64>,
    /// ln(conductivity) of the sheet and ln(contact impedance) of each electrode, by frame.
    sheet_drift: Vec<f64>,
    contact_drift: Vec<Vec<f64>>,
    open: Vec<Vec<bool>>,
}

impl Fabric {
    /// Prepares the fabric on a flat mesh; `conductivity_s` is the sheet's, siemens,
    /// `contact_impedance` one per electrode (ohm metre for rim electrodes, ohm square metre for
    /// patches).
    ///
    /// # Errors
    /// Those of [`ForwardModel::new`] and [`FabricSettings::validate`], a conductivity that is not
    /// finite and above zero, and a skin that is not flat.
    pub fn new(
        mesh: &Mesh,
        protocol: &Protocol,
        conductivity_s: f64,
        contact_impedance: &[f64],
        settings: &FabricSettings,
    ) -> Result<Self, FemError> {
        settings.validate(mesh.electrodes().len())?;
        if !(conductivity_s.is_finite() && conductivity_s > 0.0) {
            let (quantity, must) = ("conductivity_s", "finite and above zero");
            return Err(FemError::OutOfRange { quantity, value: conductivity_s, must });
        }
        if let Some(node) = mesh.surface().nodes().iter().position(|p| p[2] != 0.0) {
            return Err(FemError::NotFlat { node, height_m: mesh.surface().nodes()[node][2] });
        }
        let model = ForwardModel::new(mesh, protocol, contact_impedance)?;
        let membrane = &settings.membrane;
        let length_m = (membrane.tension_n_per_m / membrane.foundation_pa_per_m).sqrt();
        Ok(Self {
            elements: Elements::new(mesh.surface(), length_m),
            motion: Motion::new(mesh, settings),
            mesh: mesh.clone(),
            model,
            settings: settings.clone(),
            conductivity_s,
            contact_impedance: contact_impedance.to_vec(),
        })
    }

    /// Simulates a script; truth images are on the raster of the same skin. `progress` hears how
    /// many frames are done.
    ///
    /// # Errors
    /// Those of [`TouchScript::validate`], [`FemError::ForceTooLarge`] for a finger beyond the
    /// contact model, [`FemError::WrongLength`] for a raster of another mesh or no thread, all
    /// before any work; [`FemError::FoldedMesh`] where touches fold the mesh, and those of
    /// [`ForwardModel::solve_deformed`].
    pub fn simulate(
        &self,
        script: &TouchScript,
        raster: &Raster,
        settings: &SimulationSettings,
        progress: &mut dyn FnMut(usize),
    ) -> Result<Simulation, FemError> {
        let start = Instant::now();
        let touches = self.check(script, raster, settings)?;
        let plan = self.plan(script, raster, settings.seed);
        let mut workers: Vec<Worker> =
            (0..settings.threads).map(|_| self.worker()).collect::<Result<_, _>>()?;
        let (reference_v, untouched) = self.untouched(&plan, &mut workers[0])?;
        let protocol = self.model.protocol();
        let instrument = &self.settings.instrument;
        let channels = Channels::new(instrument, protocol, &reference_v.to_vec(), settings.seed);
        let mut made = self.empty(script, &plan, settings, (reference_v, untouched));
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
                frame.touches.clone_from(&touches[first + k]);
            }
            each(&mut workers, chunk, |_, frame| {
                self.elements.drives_into(&frame.touches, &plan.law, &mut frame.elements);
            });
            for frame in chunk.iter_mut() {
                remember(&plan, frame, &mut memory);
            }
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
        made.truth.touches = true_touches(script, &touches);
        made.report.time_s = start.elapsed().as_secs_f64();
        Ok(made)
    }

    /// Everything that can be wrong, before any work; the dents of every frame.
    fn check(
        &self,
        script: &TouchScript,
        raster: &Raster,
        settings: &SimulationSettings,
    ) -> Result<Vec<Vec<Placed>>, FemError> {
        script.validate(&self.mesh)?;
        let (found, wanted) = (raster.masked_areas_m2().len(), self.model.elements());
        if found != wanted {
            let what = "raster of another mesh: its triangles";
            return Err(FemError::WrongLength { what, found, wanted });
        }
        if settings.threads == 0 {
            let (quantity, must) = ("threads", "at least 1");
            return Err(FemError::OutOfRange { quantity, value: 0.0, must });
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
            let placed = |dent| Placed { position_m, dent, drag_m: direction.map(|d| d * drag_m) };
            dent.map(placed).ok_or(too_large)
        };
        let frame = |f: usize| script.touches(f).iter().map(|touch| place(f, touch)).collect();
        (0..script.frames).map(frame).collect()
    }

    fn plan<'a>(&self, script: &TouchScript, raster: &'a Raster, seed: u64) -> Plan<'a> {
        let FabricSettings { weave, drift, instrument, piezo, .. } = &self.settings;
        let (frames, rate_hz) = (script.frames, script.frame_rate_hz);
        let electrodes = self.contact_impedance.len();
        let mut untouched_s = vec![self.conductivity_s; self.model.elements()];
        if weave.amplitude > 0.0 {
            let mut random = Random::new(seed, Purpose::Weave, 0);
            let waves: Waves<2> = Waves::new(&mut random, weave.correlation_m, WEAVE_WAVES);
            for (sigma, c) in untouched_s.iter_mut().zip(self.mesh.surface().centroids()) {
                *sigma *= (weave.amplitude * waves.at([c[0], c[1]])).exp();
            }
        }
        let slow = |purpose, index, amplitude: f64| -> Vec<f64> {
            let mut random = Random::new(seed, purpose, index);
            let waves: Waves<1> = Waves::new(&mut random, drift.time_s, DRIFT_WAVES);
            let start = waves.at([0.0]);
            (0..frames).map(|f| amplitude * (waves.at([f as f64 / rate_hz]) - start)).collect()
        };
        let mut contact_drift = vec![vec![0.0; electrodes]; frames];
        if drift.contact > 0.0 {
            for l in 0..electrodes {
                let values = slow(Purpose::ContactDrift, l, drift.contact);
                contact_drift.iter_mut().zip(values).for_each(|(frame, v)| frame[l] = v);
            }
        }
        Plan {
            raster,
            law: PiezoLaw::new(piezo, 1.0 / rate_hz),
            untouched_s,
            sheet_drift: if drift.conductivity > 0.0 {
                slow(Purpose::SheetDrift, 0, drift.conductivity)
            } else {
                vec![0.0; frames]
            },
            contact_drift,
            open: open_contacts(instrument, (frames, rate_hz), electrodes, seed),
        }
    }

    fn worker(&self) -> Result<Worker, FemError> {
        Ok(Worker {
            workspace: self.model.workspace()?,
            geometry: self.model.geometry(),
            nodes_m: self.mesh.surface().nodes().to_vec(),
        })
    }

    fn frame(&self, raster: &Raster) -> Frame {
        let electrodes = self.contact_impedance.len();
        Frame {
            index: 0,
            touches: Vec::new(),
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

    /// Voltages of the untouched skin with all contacts as they should be.
    fn untouched(
        &self,
        plan: &Plan<'_>,
        worker: &mut Worker,
    ) -> Result<(Array1<f64>, SolveReport), FemError> {
        let mut solution = self.model.solve(&plan.untouched_s, &mut worker.workspace)?;
        Ok((solution.measurements(), solution.report()))
    }

    /// Moves, solves and measures without instrument.
    fn solve(
        &self,
        plan: &Plan<'_>,
        worker: &mut Worker,
        frame: &mut Frame,
    ) -> Result<(), FemError> {
        let Worker { workspace, geometry, nodes_m } = worker;
        frame.contact_impedance.copy_from_slice(&plan.contact_drift[frame.index]);
        self.motion.add_contacts(&frame.touches, &mut frame.contact_impedance);
        let instrument = &self.settings.instrument;
        for (l, z) in frame.contact_impedance.iter_mut().enumerate() {
            let open = plan.open[frame.index][l] || instrument.lost.contains(&(l + 1));
            let factor = if open { instrument.open_factor } else { 1.0 };
            *z = if *z == 0.0 { 1.0 } else { z.exp() } * factor * self.contact_impedance[l];
        }
        let touches = if self.motion.moves() { frame.touches.as_slice() } else { &[] };
        self.motion.nodes_into(touches, nodes_m);
        self.motion.shifts_into(nodes_m, &mut frame.shifts_m);
        frame.area_ratio = self.area_ratio(frame.index, nodes_m)?;
        self.model.deform(nodes_m, &frame.contact_impedance, geometry)?;
        let solution = self.model.solve_deformed(geometry, &frame.elements, workspace)?;
        solution.measurements_into(&mut frame.voltages_v)?;
        if let Some(compliance_v) = instrument.compliance_v {
            let potentials = solution.electrode_potentials();
            self.limit(compliance_v, &potentials, frame);
        }
        pressures_into(plan.raster, &frame.touches, &mut frame.pixels_pa);
        Ok(())
    }

    /// Smallest area of a triangle as seen from +z over its area at rest.
    fn area_ratio(&self, frame: usize, nodes_m: &[[f64; 3]]) -> Result<f64, FemError> {
        let surface = self.mesh.surface();
        let mut least = f64::INFINITY;
        for (triangle, (corners, area_m2)) in
            surface.triangles().iter().zip(surface.areas_m2()).enumerate()
        {
            let [a, b, c] = corners.map(|n| nodes_m[n as usize]);
            let double = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            let ratio = 0.5 * double / area_m2;
            if ratio.is_nan() || ratio <= 0.0 {
                return Err(FemError::FoldedMesh { frame, triangle, area_ratio: ratio });
            }
            least = least.min(ratio);
        }
        Ok(least)
    }

    /// Scales stimulations whose driven electrodes are further apart than the source can push.
    fn limit(&self, compliance_v: f64, potentials: &Array2<f64>, frame: &mut Frame) {
        let factors: Vec<f64> = self
            .model
            .patterns
            .stimulations_a
            .iter()
            .zip(potentials.rows())
            .map(|(currents, row)| {
                let driven = currents.iter().map(|c| row[c.0 as usize]);
                let (low, high) = driven
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
                (compliance_v / (high - low)).min(1.0)
            })
            .collect();
        frame.limited.iter_mut().zip(&factors).for_each(|(limited, f)| *limited = *f < 1.0);
        for (v, datum) in frame.voltages_v.iter_mut().zip(self.model.protocol().data()) {
            *v *= factors[datum[0] as usize];
        }
    }

    fn empty(
        &self,
        script: &TouchScript,
        plan: &Plan<'_>,
        settings: &SimulationSettings,
        (reference_v, untouched): (Array1<f64>, SolveReport),
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
            threads: settings.threads,
            untouched,
            least_area_ratio: 1.0,
            range_v: None,
            time_s: 0.0,
        };
        let exact_v = Array2::zeros((frames, measurements));
        Simulation { frames_v: exact_v.clone(), exact_v, reference_v, truth, report }
    }

    /// Copies a solved frame into the results, through the instrument.
    fn keep(
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
        // the pressures are kept: their memory serves the conductivities
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

    /// What is wrong with each measurement before the converter.
    fn quality(&self, plan: &Plan<'_>, frame: &Frame) -> Vec<TrueQuality> {
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

/// Works on frames in parallel: each thread takes a run of neighbours, so that no frame's numbers
/// depend on the number of threads.
fn each(
    workers: &mut [Worker],
    frames: &mut [Frame],
    work: impl Fn(&mut Worker, &mut Frame) + Sync,
) {
    let share = frames.len().div_ceil(workers.len());
    std::thread::scope(|scope| {
        for (worker, frames) in workers.iter_mut().zip(frames.chunks_mut(share)) {
            let work = &work;
            scope.spawn(move || frames.iter_mut().for_each(|frame| work(worker, frame)));
        }
    });
}

/// From drives to conductivities, with the memory of each element.
fn remember(plan: &Plan<'_>, frame: &mut Frame, memory: &mut [f64]) {
    let size = plan.law.memory();
    let drift = plan.sheet_drift[frame.index];
    for (e, (value, untouched)) in frame.elements.iter_mut().zip(&plan.untouched_s).enumerate() {
        let change = drift + plan.law.step(*value, &mut memory[e * size..(e + 1) * size]);
        *value = if change == 0.0 { *untouched } else { untouched * change.exp() };
    }
}

fn true_touches(script: &TouchScript, placed: &[Vec<Placed>]) -> Vec<TrueTouch> {
    let frames = placed.iter().enumerate();
    let of_frame = |(frame, dents): (usize, &Vec<Placed>)| {
        let of = move |(touch, placed): (Touch, &Placed)| TrueTouch {
            frame,
            finger: touch.finger,
            position_m: touch.position_m,
            force_n: touch.force_n,
            tip_radius_m: touch.radius_m,
            contact_radius_m: placed.dent.contact_radius_m,
            area_m2: PI * placed.dent.contact_radius_m.powi(2),
            depth_m: placed.dent.depth_m,
        };
        script.touches(frame).into_iter().zip(dents).map(of).collect::<Vec<_>>()
    };
    frames.flat_map(of_frame).collect()
}
