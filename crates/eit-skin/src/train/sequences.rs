//! What makes the sequences of a learning base.

use super::BaseRequest;
use super::recorded::Recorded;
use super::shared::{Shared, symmetries};
use super::simulated::Simulated;
use crate::denoise::{Chain, NetInputs};
use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
#[cfg(feature = "train")]
use eit_denoise::RasterSymmetry;
use eit_denoise::{Shard, UnetShape};
use ndarray::Array2;

/// Source of the touches.
#[derive(Debug)]
enum Source {
    Simulated(Box<Simulated>),
    Recorded(Recorded),
}

/// Makes the sequences of a learning base: pairs of raw images and targets.
#[derive(Debug)]
pub struct Sequences {
    shared: Shared,
    source: Source,
}

impl Sequences {
    /// Meshes the skin, and a second time for simulation.
    ///
    /// # Errors
    ///
    /// Invalid settings, or recordings that cannot be read.
    pub fn new(
        skin: &Skin,
        request: &BaseRequest,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        request.validate()?;
        let recorded = !request.recording.is_empty();
        let lengths = if recorded { None } else { Some(Simulated::lengths(request, skin)?) };
        let chain = Chain::new(skin.clone(), request.method.as_deref(), lengths, progress)?;
        let shared = Shared { symmetries: symmetries(skin)?, chain, seed: request.seed };
        let source = match recorded {
            true => Source::Recorded(Recorded::new(&shared, request, progress)?),
            false => {
                let pixels = skin.pixels();
                Source::Simulated(Box::new(Simulated::new(skin, request, pixels, progress)?))
            }
        };
        Ok(Self { shared, source })
    }

    /// Rows and columns of the images.
    pub fn pixels(&self) -> [usize; 2] {
        [self.skin().pixels(); 2]
    }

    /// The skin on which images are reconstructed.
    pub fn skin(&self) -> &Skin {
        &self.shared.chain.linearised.skin
    }

    /// Returns the symmetries that map pixels to pixels, by which pairs are augmented.
    #[cfg(feature = "train")]
    pub(crate) fn turns(&self) -> Vec<RasterSymmetry> {
        if matches!(&self.source, Source::Recorded(recorded) if recorded.is_whole) {
            return Vec::new();
        }
        let shared = &self.shared;
        let matrices = shared.symmetries.iter().map(|turned| shared.matrix(turned.symmetry));
        matrices.filter_map(RasterSymmetry::of_matrix).collect()
    }

    /// Computes the further inputs of a net of this shape for shards, on `threads` threads.
    ///
    /// # Errors
    ///
    /// A net with more inputs than this program computes; sequences without any touch, for a net that
    /// corrects drawn touches.
    pub fn complete(
        &self,
        shards: &mut [Shard],
        shape: UnetShape,
        threads: usize,
    ) -> Result<(), SkinError> {
        let linearised = &self.shared.chain.linearised;
        let part = shards.len().div_ceil(threads.max(1)).max(1);
        std::thread::scope(|scope| {
            let work = |shards: &mut [Shard]| {
                let mut inputs = NetInputs::new(linearised, shape)?;
                shards.iter_mut().try_for_each(|shard| inputs.complete(shard))
            };
            let parts = shards.chunks_mut(part);
            let running: Vec<_> = parts.map(|part| scope.spawn(move || work(part))).collect();
            let joined = running.into_iter().map(|thread| match thread.join() {
                Ok(made) => made,
                Err(panic) => std::panic::resume_unwind(panic),
            });
            joined.collect::<Result<(), SkinError>>()
        })?;
        let is_empty = |shard: &Shard| match &shard.beside.first {
            Some(drawn) => drawn.iter().all(|value| *value == 0.0),
            None => false,
        };
        if !shards.is_empty() && shards.iter().all(is_empty) {
            return Err(SkinError::input(format!(
                "no touch is detected in any of the {} sequences to train on or held out, and the net \
                 corrects detected touches: make more or longer ones, or train with images = 1",
                shards.len()
            )));
        }
        Ok(())
    }

    /// Returns the Jacobian of the images, [measurement, masked pixel].
    ///
    /// # Errors
    ///
    /// The errors of the raster.
    pub fn pixel_jacobian(&self) -> Result<Array2<f64>, SkinError> {
        let linearised = &self.shared.chain.linearised;
        let all = vec![true; linearised.skin.protocol.measurements()];
        linearised.pixel_jacobian(linearised.raster(&mut Progress::silent())?, &all)
    }

    /// Describes everything that the pairs depend on besides the skin, the seed and the counts.
    pub(crate) fn recipe(&self) -> String {
        let (shared, skin) = (&self.shared, self.skin());
        let source = match &self.source {
            Source::Simulated(simulated) => simulated.recipe(skin),
            Source::Recorded(recorded) => recorded.recipe(skin),
        };
        format!(
            "{}, {} symmetries, {source}, {:?}, {:?}",
            shared.chain.method.name(),
            shared.symmetries.len().max(1),
            skin.settings.reconstruction,
            skin.source,
        )
    }

    /// Makes a sequence by its number; the same number always gives the same bytes.
    ///
    /// # Errors
    ///
    /// The errors of the simulation and the reconstruction.
    pub fn sequence(&self, index: usize) -> Result<Shard, SkinError> {
        match &self.source {
            Source::Simulated(simulated) => simulated.sequence(&self.shared, index),
            Source::Recorded(recorded) => recorded.sequence(&self.shared, index),
        }
    }
}
