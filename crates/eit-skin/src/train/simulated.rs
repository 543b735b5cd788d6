//! Sequences of simulated touches: simulate, turn, reconstruct, and the truth turned alike.

use super::BaseRequest;
use super::motion::{self, Fingers, Hand, MOST, QUIET, RATE_HZ, RECIPE, fabric, script};
use super::shared::{Shared, TurnedOrder, touches_of};
use crate::denoise::Lengths;
use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
use eit_denoise::{ImageStack, Shard};
use eit_fem::fabric::{Fabric, PlayCircle, Random, Simulation, SimulationSettings, TouchScript};
use eit_fem::{FemError, Protocol};
use eit_mesh::Raster;
use ndarray::{Array3, ArrayView2, Axis};

/// Number of nodes of the simulation mesh: twice that of the reconstruction mesh.
const NODES: usize = 4000;
/// Pixels of the truth per pixel of an image, along a side: the truth is rotated before it is averaged.
const FINE: usize = 2;
/// Number of scripts drawn before giving up because no fabric bears them.
const ATTEMPTS: usize = 8;

/// Makes simulated training sequences.
#[derive(Debug)]
pub(crate) struct Simulated {
    frames: usize,
    hand: Hand,
    script: Option<String>,
    simulating: Skin,
    fine: Raster,
    /// Root mean square of the untouched skin's voltages, volt.
    rms_v: f64,
    /// Electrodes that each measurement uses.
    electrodes: Vec<Vec<u32>>,
}

impl Simulated {
    /// Checks the settings, before any work; returns the number of frames of a sequence and of its quiet start.
    ///
    /// # Errors
    ///
    /// A script that does not exist, too few frames, a number of fingers out of range, or a skin from a mesh
    /// file.
    pub(crate) fn lengths(args: &BaseRequest, skin: &Skin) -> Result<Lengths, SkinError> {
        let rate_hz = match &args.script {
            Some(name) => {
                let circle = PlayCircle { centre_m: [0.0; 2], radius_m: 1.0 };
                TouchScript::built_in(name, &circle, 1)?.frame_rate_hz
            }
            None => RATE_HZ,
        };
        if args.frames < QUIET + 10 {
            return Err(SkinError::argument(
                "frames",
                format!("{}: at least {}, of which {QUIET} are quiet", args.frames, QUIET + 10),
            ));
        }
        if let Some(count) = args.fingers.filter(|count| !(1..=MOST).contains(count)) {
            return Err(SkinError::argument("fingers", format!("{count}: 1 to {MOST}")));
        }
        if skin.source.is_file() {
            return Err(SkinError::input(
                "a skin from a mesh file has no second mesh to simulate on: learn from recordings \
                 of it (recording)",
            ));
        }
        Ok(Lengths { frames: args.frames, quiet: QUIET, rate_hz })
    }

    /// Meshes the skin a second time, for simulation.
    ///
    /// # Errors
    ///
    /// The errors of meshing and of the forward solution.
    pub(crate) fn new(
        skin: &Skin,
        args: &BaseRequest,
        pixels: usize,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let fingers = args.fingers.map_or(Fingers::Any, Fingers::Always);
        let hand = Hand { fingers, usual_tips: args.usual_tips };
        let simulating = skin.with_nodes(NODES, progress)?;
        let fine = Raster::new(simulating.mesh.surface(), FINE * pixels)?;
        let voltages = simulating.linearise(progress)?.voltages;
        let squares = voltages.iter().map(|v| v * v).sum::<f64>();
        let rms_v = (squares / voltages.len().max(1) as f64).sqrt();
        let electrodes = electrodes_of(&simulating.protocol);
        let script = args.script.clone();
        Ok(Self { frames: args.frames, hand, script, simulating, fine, rms_v, electrodes })
    }

    /// Describes everything besides the chain that the training pairs depend on.
    pub(crate) fn recipe(&self, skin: &Skin) -> String {
        let scripts = match &self.script {
            Some(name) => format!("script {name}"),
            None => {
                let Hand { fingers, usual_tips } = self.hand;
                let tips = match usual_tips > 0.0 {
                    true => format!(", usual tips {usual_tips}"),
                    false => String::new(),
                };
                format!("{RECIPE}, fingers {fingers:?}{tips}")
            }
        };
        format!("{} frames, simulated on {NODES} nodes, {scripts}, {:?}", self.frames, skin.fabric,)
    }

    /// Makes a sequence by its number.
    ///
    /// # Errors
    ///
    /// The errors of the simulation and the reconstruction.
    pub(crate) fn sequence(&self, shared: &Shared, index: usize) -> Result<Shard, SkinError> {
        let mut last = SkinError::Failure("no script was tried".to_owned());
        for attempt in 0..ATTEMPTS {
            let mut random = motion::random(shared.seed, index, attempt);
            match self.simulate(shared, &mut random, index)? {
                Ok(made) => return self.pairs(shared, &mut random, made),
                Err(error) => last = SkinError::from(error),
            }
        }
        Err(last)
    }

    /// Simulates a random script on a random fabric; after an inner error, another draw may succeed.
    fn simulate(
        &self,
        shared: &Shared,
        random: &mut Random,
        index: usize,
    ) -> Result<Result<Simulation, FemError>, SkinError> {
        let mesh = &self.simulating.mesh;
        let circle = PlayCircle::of(mesh);
        let (settings, script) = match &self.script {
            None => {
                let settings = fabric(random, &self.simulating.fabric, self.rms_v);
                (settings, script(random, &circle, self.frames, self.hand))
            }
            Some(name) => {
                let mut script = TouchScript::built_in(name, &circle, index as u64)?;
                script.frames = script.frames.min(self.frames);
                (self.simulating.fabric.clone(), script)
            }
        };
        let skin = &self.simulating;
        let fabric = Fabric::new(
            mesh,
            &skin.protocol,
            skin.conductivity_s,
            &skin.contact_impedance,
            &settings,
        )?;
        // noise and weave must not repeat from sequence to sequence
        let seed = shared.seed.wrapping_mul(1_000_003).wrapping_add(index as u64);
        let how = SimulationSettings { seed, threads: 1, keep_elements: false };
        match fabric.simulate(&script, &self.fine, &how, &mut |_| {}) {
            Ok(made) => Ok(Ok(made)),
            Err(
                error @ (FemError::FoldedMesh { .. }
                | FemError::ForceTooLarge { .. }
                | FemError::OutsideSkin { .. }),
            ) => Ok(Err(error)),
            Err(error) => Err(error.into()),
        }
    }

    /// Returns the raw images and the truth, both transformed by a symmetry of the skin.
    fn pairs(
        &self,
        shared: &Shared,
        random: &mut Random,
        made: Simulation,
    ) -> Result<Shard, SkinError> {
        let mut values = made.frames_v;
        let count = self.simulating.mesh.electrodes().len();
        let lacking = match self.script {
            None => motion::lacking(random, &self.electrodes, count),
            Some(_) => Vec::new(),
        };
        for measurement in lacking {
            values.column_mut(measurement).slice_axis_mut(Axis(0), (QUIET..).into()).fill(f64::NAN);
        }
        let mut to_old = [[1.0, 0.0], [0.0, 1.0]];
        if !shared.symmetries.is_empty() {
            let TurnedOrder { symmetry, order } =
                &shared.symmetries[random.below(shared.symmetries.len())];
            for mut row in values.rows_mut() {
                let frame = row.to_vec();
                let mut turned = vec![0.0; frame.len()];
                order.apply_into(&frame, &mut turned)?;
                row.assign(&ndarray::ArrayView1::from(&turned));
            }
            let [[a, b], [c, d]] = shared.matrix(*symmetry);
            // the inverse of a turn or mirror image is its transpose
            to_old = [[a, c], [b, d]];
        }
        let chained = shared.chain.reconstruct(&values)?;
        let touches = touches_of(&chained, 1.0)?;
        let (data, raw) = (shared.data(&chained)?, chained.images);
        let raster = shared.chain.linearised.raster(&mut Progress::silent())?;
        let fine = &made.truth.conductivity_change_s;
        let mask = raster.mask();
        let stack = |images| ImageStack::new(images, mask.clone());
        let wanted = Array3::from_shape_fn(raw.dim(), |(f, r, c)| match mask[[r, c]] {
            true => self.true_mean(fine.index_axis(Axis(0), f), raster, [r, c], to_old),
            false => f64::NAN,
        });
        let shard = Shard::new(&stack(raw)?, &stack(wanted)?)?;
        Ok(Shard { data, touches, ..shard })
    }

    /// Mean of the truth over a pixel; `to_old` maps its places to those of the simulation.
    fn true_mean(
        &self,
        fine: ArrayView2<'_, f64>,
        raster: &Raster,
        [row, column]: [usize; 2],
        to_old: [[f64; 2]; 2],
    ) -> f64 {
        let [x, y] = raster.centre_m(row, column);
        let step = raster.pixel_m() / (2 * FINE) as f64;
        let (mut sum, mut count) = (0.0, 0);
        for i in 0..2 * FINE {
            for j in 0..2 * FINE {
                let off = |k: usize| (k as f64 + 0.5 - FINE as f64) * step;
                let p = [x + off(i), y + off(j)];
                let old = to_old.map(|row| row[0] * p[0] + row[1] * p[1]);
                let value = self.fine.pixel_at(old).map(|place| fine[place]);
                if let Some(value) = value.filter(|v| v.is_finite()) {
                    (sum, count) = (sum + value, count + 1);
                }
            }
        }
        // a pixel of the rim may lie off the other mesh
        if count == 0 { 0.0 } else { sum / f64::from(count) }
    }
}

/// Electrodes that each measurement drives or senses.
fn electrodes_of(protocol: &Protocol) -> Vec<Vec<u32>> {
    let (drives, senses) = (protocol.stimulations_a(), protocol.measurement_patterns());
    let of = |&[drive, sense]: &[u32; 2]| {
        let patterns = drives.row(drive as usize).into_iter().zip(senses.row(sense as usize));
        let uses = patterns.enumerate().filter(|(_, (i, w))| **i != 0.0 || **w != 0.0);
        uses.map(|(electrode, _)| electrode as u32).collect()
    };
    protocol.data().iter().map(of).collect()
}
