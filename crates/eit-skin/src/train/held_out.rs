//! What a trained net is worth on sequences that it did not learn from.

use super::sequences::Sequences;
use crate::denoise::{Scores, scores};
use crate::error::SkinError;
use eit_denoise::{
    DataConsistency, Denoiser, ImageStack, ModelError, ModelErrorNorm, ModelErrorSum, Shard,
    ShardData, ThresholdRule, Weights,
};
use ndarray::{Array2, Array3, ArrayView1, ArrayView2, Axis, concatenate};

/// Part of the held-out frames with an image better than the raw one that the judge may reject.
const NOT_BELIEVED: f64 = 0.002;
/// Least and largest limit: an empty image, which leaves everything, is above the largest.
const LIMITS: [f64; 2] = [0.05, 0.6];

/// Net and threshold rule against the raw images of the held-out sequences.
pub fn held_out_scores(weights: &Weights, held_out: &[Shard]) -> Result<Scores, SkinError> {
    let Some(first) = held_out.first() else {
        return Err(SkinError::Failure("no sequence was held out".to_owned()));
    };
    let mut net = Denoiser::new(weights, first.mask.view())?;
    let mut rule = ThresholdRule::default().on(first.mask.view())?;
    let (mut raw, mut made, mut wanted) = (Vec::new(), Vec::new(), Vec::new());
    for shard in held_out {
        let stack =
            |images: &Array3<f32>| ImageStack::new(images.mapv(f64::from), shard.mask.clone());
        let own = stack(&shard.raw)?;
        made.push(shard.denoise(&mut net)?.into_parts().0);
        raw.push(own.into_parts().0);
        wanted.push(stack(&shard.wanted)?.into_parts().0);
    }
    let join = |list: &[Array3<f64>]| {
        let views: Vec<_> = list.iter().map(|images| images.view()).collect();
        concatenate(Axis(0), &views).map_err(|e| SkinError::Failure(format!("joining: {e}")))
    };
    scores(join(&raw)?.view(), join(&made)?.view(), join(&wanted)?.view(), &mut rule)
}

/// The model error of a skin's data: what true images of the sequences to learn from leave of it, with
/// the limit that the net's images of held-out sequences keep. `None` where the measurements are unknown.
///
/// # Errors
///
/// Those of the model and the net.
pub fn model_error(
    weights: &Weights,
    learnt: &[Shard],
    held_out: &[Shard],
    sequences: &Sequences,
) -> Result<Option<ModelError>, SkinError> {
    let jacobian = sequences.pixel_jacobian()?;
    let mut sum = ModelErrorSum::new(jacobian.nrows());
    let mut left = vec![0.0; jacobian.nrows()];
    for shard in learnt {
        let Some(data) = &shard.data else { return Ok(None) };
        let mut model = DataModel::new(&jacobian, shard, data)?;
        for (frame, wanted) in shard.wanted.outer_iter().enumerate() {
            let differences = model.left_into(frame, wanted.mapv(f64::from).view(), &mut left)?;
            sum.add(ArrayView1::from(&left), ArrayView1::from(&differences));
        }
    }
    let Some(mut error) = sum.model_error() else { return Ok(None) };
    error.limit = 1.0;
    let mut norm = ModelErrorNorm::new(&error)?;
    let mut known = Vec::new();
    for shard in held_out {
        let Some(data) = &shard.data else { return Ok(None) };
        let mut model = DataModel::new(&jacobian, shard, data)?;
        let mut net = Denoiser::new(weights, shard.mask.view())?;
        let made = shard.denoise(&mut net)?;
        for (frame, image) in made.iter().enumerate() {
            let [raw, wanted] = [&shard.raw, &shard.wanted]
                .map(|images| images.index_axis(Axis(0), frame).mapv(f64::from));
            // the limit is that of images that are better than the raw ones
            if squared(image, wanted.view()) >= squared(raw.view(), wanted.view()) {
                continue;
            }
            let differences = model.left_into(frame, image, &mut left)?;
            let [unexplained, noise] = norm.unexplained(&left, &differences, &model.noise_std)?;
            known.push(unexplained - noise);
        }
    }
    known.sort_by(f64::total_cmp);
    let at = ((1.0 - NOT_BELIEVED) * known.len() as f64) as usize;
    let Some(limit) = known.get(at.min(known.len().saturating_sub(1))) else { return Ok(None) };
    error.limit = limit.clamp(LIMITS[0], LIMITS[1]);
    Ok(Some(error))
}

/// The linear model of a shard's data.
struct DataModel<'a> {
    consistency: DataConsistency,
    data: &'a ShardData,
    noise_std: Vec<f64>,
}

impl<'a> DataModel<'a> {
    fn new(jacobian: &Array2<f64>, shard: &Shard, data: &'a ShardData) -> Result<Self, SkinError> {
        let noise_std: Vec<f64> = data.noise_std.iter().map(|std| f64::from(*std)).collect();
        let consistency = DataConsistency::new(jacobian.view(), &noise_std, shard.mask.view())?;
        Ok(Self { consistency, data, noise_std })
    }

    /// Writes what an image leaves of a frame's differences, and returns those.
    fn left_into(
        &mut self,
        frame: usize,
        image: ArrayView2<'_, f64>,
        left: &mut [f64],
    ) -> Result<Vec<f64>, SkinError> {
        let differences = self.data.differences.row(frame).mapv(f64::from).to_vec();
        self.consistency.left_into(image, &differences, left)?;
        Ok(differences)
    }
}

/// Sum of squared differences inside the skin.
fn squared(image: ArrayView2<'_, f64>, wanted: ArrayView2<'_, f64>) -> f64 {
    let off = image.iter().zip(wanted).filter(|(image, _)| image.is_finite());
    off.map(|(image, wanted)| (image - wanted).powi(2)).sum()
}
