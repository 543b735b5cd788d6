//! One sequence of a learning base: simulate, turn, reconstruct, and the truth turned alike.

use super::motion::{Fingers, MOST, QUIET, RECIPE, Random, fabric, script};
use crate::cli::TrainArgs;
use crate::denoise::{Chain, Chained};
use crate::error::CliError;
use crate::pipeline::{self, Setup};
use crate::progress::Progress;
use crate::scene::{Direction, OneOrMany, Scene, Shape};
use eit_denoise::{DiscSymmetry, ImageStack, MeasurementOrder, PixelTurn, Shard, ShardData};
use eit_fem::FemError;
use eit_fem::fabric::{Fabric, PlayCircle, Simulation, SimulationSettings};
use eit_mesh::Raster;
use ndarray::{Array1, Array2, Array3, ArrayView2, Axis};

/// Nodes of the mesh that simulates: twice those that reconstruct.
const NODES: usize = 4000;
/// Pixels of the truth for each of an image's, along a side: it is turned before it is averaged.
const FINE: usize = 2;
/// Scripts that are drawn before giving up on one that no fabric bears.
const ATTEMPTS: usize = 8;

/// Meshes and settings that all sequences share.
pub(super) struct Workshop<'a> {
    scene: &'a Scene,
    /// Reconstructs.
    chain: Chain,
    frames: usize,
    fingers: Fingers,
    seed: u64,
    /// Simulates.
    simulating: Setup,
    fine: Raster,
    symmetries: Vec<(DiscSymmetry, MeasurementOrder)>,
}

impl<'a> Workshop<'a> {
    /// Meshes the skin twice.
    pub fn new(
        scene: &'a Scene,
        args: &TrainArgs,
        progress: &mut Progress,
    ) -> Result<Self, CliError> {
        if args.frames < QUIET + 10 {
            return Err(CliError::input(format!(
                "--frames {}: at least {}, of which {QUIET} are quiet",
                args.frames,
                QUIET + 10
            )));
        }
        let fingers = match args.fingers {
            None => Fingers::Any,
            Some(count) if (1..=MOST).contains(&count) => Fingers::Always(count),
            Some(count) => {
                return Err(CliError::input(format!("--fingers {count}: 1 to {MOST}")));
            }
        };
        let lengths = (args.frames, QUIET);
        let chain = Chain::new(scene, args.method.as_deref(), lengths, progress)?;
        let nodes = (scene.skin.shape != Shape::Mesh).then_some(NODES);
        if nodes.is_none() {
            return Err(CliError::input(
                "a skin from a mesh file cannot be trained: it has no second mesh to simulate on",
            ));
        }
        let simulating = pipeline::setup(scene, None, nodes, progress)?;
        let fine = Raster::new(simulating.mesh.surface(), FINE * chain.raster.pixels())?;
        let symmetries = symmetries(scene, &chain.setup)?;
        let (frames, seed) = (args.frames, args.seed);
        Ok(Self { scene, chain, frames, fingers, seed, simulating, fine, symmetries })
    }

    /// Rows and columns of the images.
    pub fn pixels(&self) -> [usize; 2] {
        [self.chain.raster.pixels(); 2]
    }

    /// The model behind the images, [measurement, masked pixel].
    pub fn pixel_jacobian(&self) -> Result<Array2<f64>, CliError> {
        let kind = self.scene.difference_kind(&self.chain.setup.protocol);
        let all = vec![true; self.chain.setup.protocol.measurements()];
        pipeline::tv::pixel_jacobian(&self.chain.linearised, &self.chain.raster, kind, &all)
    }

    /// Everything that the pairs depend on and that is not the skin, the seed or a count.
    pub fn recipe(&self) -> String {
        format!(
            "{} of {} frames, {} symmetries, simulated on {NODES} nodes, {RECIPE}, fingers {:?}, \
             {:?}, {:?}",
            self.chain.method.name(),
            self.frames,
            self.symmetries.len().max(1),
            self.fingers,
            self.scene.fabric.clone().unwrap_or_default(),
            self.scene.reconstruction,
        )
    }

    /// A sequence by its number: the same bytes whenever it is made.
    pub fn sequence(&self, index: usize) -> Result<Shard, CliError> {
        let mut last = CliError::Failure("no script was tried".to_owned());
        for attempt in 0..ATTEMPTS {
            let mut random = Random::new(self.seed, index, attempt);
            match self.simulate(&mut random, index)? {
                Ok(made) => return self.pairs(&mut random, made),
                Err(error) => last = CliError::from(error),
            }
        }
        Err(last)
    }

    /// Simulates a drawn script on a drawn fabric; the inner error is one that another draw mends.
    fn simulate(
        &self,
        random: &mut Random,
        index: usize,
    ) -> Result<Result<Simulation, FemError>, CliError> {
        let mesh = &self.simulating.mesh;
        let settings = fabric(random, &self.scene.fabric.clone().unwrap_or_default());
        let script = script(random, &PlayCircle::of(mesh), (self.frames, self.fingers));
        let impedance = self.scene.contact_impedance(mesh.electrodes().len())?;
        let conductivity_s = self.scene.skin.conductivity_s;
        let protocol = &self.simulating.protocol;
        let fabric = Fabric::new(mesh, protocol, conductivity_s, &impedance, &settings)?;
        // noise and weave must not repeat from sequence to sequence
        let seed = self.seed.wrapping_mul(1_000_003).wrapping_add(index as u64);
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

    /// Raw images of the frames and the truth, both turned by a symmetry of the skin.
    fn pairs(&self, random: &mut Random, made: Simulation) -> Result<Shard, CliError> {
        let mut values = made.frames_v;
        let mut to_old = [[1.0, 0.0], [0.0, 1.0]];
        if !self.symmetries.is_empty() {
            let (symmetry, order) = &self.symmetries[random.choice(self.symmetries.len())];
            for mut row in values.rows_mut() {
                let frame = row.to_vec();
                let mut turned = vec![0.0; frame.len()];
                order.apply_into(&frame, &mut turned)?;
                row.assign(&ndarray::ArrayView1::from(&turned));
            }
            let [[a, b], [c, d]] = self.matrix(*symmetry);
            // the inverse of a turn or mirror image is its transpose
            to_old = [[a, c], [b, d]];
        }
        let chained = self.chain.reconstruct(&values)?;
        let (data, raw) = (self.data(&chained)?, chained.images);
        let fine = &made.truth.conductivity_change_s;
        let mask = self.chain.raster.mask();
        let wanted = Array3::from_shape_fn(raw.dim(), |(f, r, c)| match mask[[r, c]] {
            true => self.true_mean(fine.index_axis(Axis(0), f), [r, c], to_old),
            false => f64::NAN,
        });
        let stack = |images| ImageStack::new(images, mask.clone());
        let shard = Shard::new(&stack(raw)?, &stack(wanted)?)?;
        Ok(Shard { data: Some(data), ..shard })
    }

    /// How a symmetry moves places.
    fn matrix(&self, symmetry: DiscSymmetry) -> [[f64; 2]; 2] {
        let count = self.chain.setup.mesh.electrodes().len() as u32;
        let first = self.scene.electrodes.first_angle_deg.unwrap_or(0.0).to_radians();
        let clockwise = self.scene.electrodes.direction == Direction::Clockwise;
        symmetry.matrix(count, first, clockwise)
    }

    /// The symmetries that take pixels to pixels.
    pub fn turns(&self) -> Vec<PixelTurn> {
        let matrices = self.symmetries.iter().map(|(symmetry, _)| self.matrix(*symmetry));
        matrices.filter_map(PixelTurn::of_matrix).collect()
    }

    /// Differences of frames from their reference, and their noise.
    fn data(&self, made: &Chained) -> Result<ShardData, CliError> {
        let Chain { scene, setup, linearised, .. } = &self.chain;
        let frames = &made.frames;
        let kind = scene.difference_kind(&setup.protocol);
        let data = pipeline::difference_data(kind, linearised);
        let noise = pipeline::noise::known(scene, frames, (&data, made.gain))?
            .ok_or_else(|| CliError::Failure("quiet frames without noise".to_owned()))?;
        let std = noise.std.iter().zip(&frames.used);
        let noise_std: Array1<f32> =
            std.map(|(std, used)| if *used { *std as f32 } else { f32::INFINITY }).collect();
        Ok(ShardData { differences: frames.differences(kind).mapv(|v| v as f32), noise_std })
    }

    /// Mean of the truth over a pixel, whose places `to_old` takes to where they were simulated.
    fn true_mean(
        &self,
        fine: ArrayView2<'_, f64>,
        [row, column]: [usize; 2],
        to_old: [[f64; 2]; 2],
    ) -> f64 {
        let [x, y] = self.chain.raster.centre_m(row, column);
        let step = self.chain.raster.pixel_m() / (2 * FINE) as f64;
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

/// Turns and mirror images that skin and protocol share; none where only the identity is known.
fn symmetries(
    scene: &Scene,
    setup: &Setup,
) -> Result<Vec<(DiscSymmetry, MeasurementOrder)>, CliError> {
    let electrodes = &scene.electrodes;
    let alike = !matches!(electrodes.contact_impedance_ohm_m, Some(OneOrMany::Many(_)));
    let even = scene.skin.shape == Shape::Disc && electrodes.positions_m.is_none() && alike;
    match setup.protocol.quadruples() {
        Some(quadruples) if even => {
            Ok(MeasurementOrder::of_disc(quadruples, setup.mesh.electrodes().len() as u32)?)
        }
        _ => Ok(Vec::new()),
    }
}
