//! What makes the sequences of a learning base.

use super::BaseRequest;
use super::recorded::Recorded;
use super::simulated::Simulated;
use crate::denoise::{Chain, Chained};
use crate::error::SkinError;
use crate::pipeline::{self, Setup};
use crate::progress::Progress;
use crate::scene::{Direction, OneOrMany, Scene, Shape};
use eit_denoise::{DiscSymmetry, MeasurementOrder, RasterSymmetry, Shard, ShardData};
use ndarray::{Array1, Array2};

/// Meshes and settings that all sequences share.
pub struct Bench<'a> {
    pub scene: &'a Scene,
    /// Reconstructs.
    pub chain: Chain,
    pub seed: u64,
    /// Ways to turn and mirror the skin; none where only the identity is known.
    pub symmetries: Vec<(DiscSymmetry, MeasurementOrder)>,
}

/// Where touches come from.
enum Source {
    Simulated(Box<Simulated>),
    Recorded(Recorded),
}

/// A source at its bench.
pub struct Workshop<'a> {
    bench: Bench<'a>,
    source: Source,
}

impl<'a> Workshop<'a> {
    /// Meshes the skin, twice to simulate on it.
    pub fn new(
        scene: &'a Scene,
        args: &BaseRequest,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let recorded = !args.recording.is_empty();
        let lengths = if recorded { None } else { Some(Simulated::lengths(args, scene)?) };
        let chain = Chain::new(scene, args.method.as_deref(), lengths, progress)?;
        let symmetries = symmetries(scene, &chain.setup)?;
        let bench = Bench { scene, chain, seed: args.seed, symmetries };
        let source = match recorded {
            true => Source::Recorded(Recorded::new(
                &bench,
                (&args.recording, args.sequences),
                progress,
            )?),
            false => {
                let pixels = bench.chain.raster.pixels();
                let simulated = Simulated::new(scene, args, pixels, progress)?;
                Source::Simulated(Box::new(simulated))
            }
        };
        Ok(Self { bench, source })
    }

    /// Rows and columns of the images.
    pub fn pixels(&self) -> [usize; 2] {
        [self.bench.chain.raster.pixels(); 2]
    }

    /// The symmetries that take pixels to pixels.
    pub fn turns(&self) -> Vec<RasterSymmetry> {
        let bench = &self.bench;
        let matrices = bench.symmetries.iter().map(|(symmetry, _)| bench.matrix(*symmetry));
        matrices.filter_map(RasterSymmetry::of_matrix).collect()
    }

    /// The model behind the images, [measurement, masked pixel].
    pub fn pixel_jacobian(&self) -> Result<Array2<f64>, SkinError> {
        let Chain { scene, setup, linearised, raster, .. } = &self.bench.chain;
        let all = vec![true; setup.protocol.measurements()];
        let kind = scene.difference_kind(&setup.protocol);
        pipeline::tv::pixel_jacobian(linearised, raster, kind, &all)
    }

    /// Everything that the pairs depend on and that is not the skin, the seed or a count.
    pub fn recipe(&self) -> String {
        let Bench { scene, chain, symmetries, .. } = &self.bench;
        let source = match &self.source {
            Source::Simulated(simulated) => simulated.recipe(scene),
            Source::Recorded(recorded) => recorded.recipe(scene),
        };
        format!(
            "{}, {} symmetries, {source}, {:?}, {:?}",
            chain.method.name(),
            symmetries.len().max(1),
            scene.reconstruction,
            scene.mesh,
        )
    }

    /// A sequence by its number: the same bytes whenever it is made.
    pub fn sequence(&self, index: usize) -> Result<Shard, SkinError> {
        match &self.source {
            Source::Simulated(simulated) => simulated.sequence(&self.bench, index),
            Source::Recorded(recorded) => recorded.sequence(&self.bench, index),
        }
    }
}

impl Bench<'_> {
    /// How a symmetry moves places.
    pub fn matrix(&self, symmetry: DiscSymmetry) -> [[f64; 2]; 2] {
        let count = self.chain.setup.mesh.electrodes().len() as u32;
        let first = self.scene.electrodes.first_angle_deg.unwrap_or(0.0).to_radians();
        let clockwise = self.scene.electrodes.direction == Direction::Clockwise;
        symmetry.matrix(count, first, clockwise)
    }

    /// Differences of frames from their reference, and their noise; `None` where that is unknown.
    pub fn data(&self, made: &Chained) -> Result<Option<ShardData>, SkinError> {
        let Chain { scene, setup, linearised, .. } = &self.chain;
        let frames = &made.frames;
        let kind = scene.difference_kind(&setup.protocol);
        let data = pipeline::difference_data(kind, linearised);
        let Some(noise) = pipeline::noise::known(scene, frames, (&data, made.gain))? else {
            return Ok(None);
        };
        let std = noise.std.iter().zip(&frames.used);
        let noise_std: Array1<f32> =
            std.map(|(std, used)| if *used { *std as f32 } else { f32::INFINITY }).collect();
        let mut differences = frames.differences(kind).mapv(|v| v as f32);
        differences.zip_mut_with(&frames.good, |value, good| {
            if !good {
                *value = f32::NAN;
            }
        });
        Ok(Some(ShardData { differences, noise_std }))
    }
}

/// Turns and mirror images that skin and protocol share; none where only the identity is known.
fn symmetries(
    scene: &Scene,
    setup: &Setup,
) -> Result<Vec<(DiscSymmetry, MeasurementOrder)>, SkinError> {
    let electrodes = &scene.electrodes;
    let alike = !matches!(electrodes.contact_impedance_ohm_m, Some(OneOrMany::Many(_)));
    let even = scene.skin.shape == Shape::Disc
        && electrodes.positions_m.is_none()
        && alike
        && matches!(electrodes.width_m, Some(OneOrMany::One(_)));
    match setup.protocol.quadruples() {
        Some(quadruples) if even => {
            Ok(MeasurementOrder::of_disc(quadruples, setup.mesh.electrodes().len() as u32)?)
        }
        _ => Ok(Vec::new()),
    }
}
