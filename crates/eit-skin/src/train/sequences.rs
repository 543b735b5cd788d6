//! What makes the sequences of a learning base.

use super::BaseRequest;
use super::recorded::Recorded;
use super::shared::{Shared, symmetries};
use super::simulated::Simulated;
use crate::denoise::Chain;
use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
use eit_denoise::{RasterSymmetry, Shard};
use ndarray::Array2;

/// Where touches come from.
#[derive(Debug)]
enum Source {
    Simulated(Box<Simulated>),
    Recorded(Recorded),
}

/// Makes the sequences of a learning base: pairs of raw and wanted images.
#[derive(Debug)]
pub struct Sequences {
    shared: Shared,
    source: Source,
}

impl Sequences {
    /// Meshes the skin, twice to simulate on it.
    ///
    /// # Errors
    ///
    /// Settings that no base can be made with, or recordings that cannot be read.
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
            true => {
                let files = &request.recording;
                Source::Recorded(Recorded::new(&shared, files, request.sequences, progress)?)
            }
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

    /// The skin that reconstructs.
    pub fn skin(&self) -> &Skin {
        &self.shared.chain.linearised.skin
    }

    /// The symmetries that take pixels to pixels.
    pub fn turns(&self) -> Vec<RasterSymmetry> {
        let shared = &self.shared;
        let matrices = shared.symmetries.iter().map(|turned| shared.matrix(turned.symmetry));
        matrices.filter_map(RasterSymmetry::of_matrix).collect()
    }

    /// The model behind the images, [measurement, masked pixel].
    ///
    /// # Errors
    ///
    /// Those of the raster.
    pub fn pixel_jacobian(&self) -> Result<Array2<f64>, SkinError> {
        let linearised = &self.shared.chain.linearised;
        let all = vec![true; linearised.skin.protocol.measurements()];
        linearised.pixel_jacobian(linearised.raster(&mut Progress::silent())?, &all)
    }

    /// Everything that the pairs depend on and that is not the skin, the seed or a count.
    pub fn recipe(&self) -> String {
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

    /// A sequence by its number: the same bytes whenever it is made.
    pub fn sequence(&self, index: usize) -> Result<Shard, SkinError> {
        match &self.source {
            Source::Simulated(simulated) => simulated.sequence(&self.shared, index),
            Source::Recorded(recorded) => recorded.sequence(&self.shared, index),
        }
    }
}
