//! What a trained net is worth on sequences that it did not learn from.

use super::sequences::Sequences;
use crate::denoise::{Scores, scores};
use crate::error::SkinError;
use eit_denoise::{
    DataConsistency, DataMisfit, Denoiser, ImageStack, Shard, ThresholdRule, Weights,
};
use ndarray::{Array3, ArrayView2, Axis, concatenate};

/// Part of the largest wanted value from which on something touches.
const TOUCHED: f32 = 0.1;
/// Part of the held-out frames whose image may look as if it did not explain the data.
const NOT_BELIEVED: f64 = 0.02;

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
        made.push(net.denoise(&own)?.into_parts().0);
        raw.push(own.into_parts().0);
        wanted.push(stack(&shard.wanted)?.into_parts().0);
    }
    let join = |list: &[Array3<f64>]| {
        let views: Vec<_> = list.iter().map(|images| images.view()).collect();
        concatenate(Axis(0), &views).map_err(|e| SkinError::Failure(format!("joining: {e}")))
    };
    scores(join(&raw)?.view(), join(&made)?.view(), join(&wanted)?.view(), &mut rule)
}

/// The part of the data's energy that the net's images of held-out frames leave unexplained, all
/// but 2 % of them. Only frames in which something touches: between touches the data is
/// drift and what relaxes, which no image of a touch explains.
pub fn misfit_limit(
    weights: &Weights,
    held_out: &[Shard],
    sequences: &Sequences,
) -> Result<Option<f64>, SkinError> {
    let jacobian = sequences.pixel_jacobian()?;
    let mut known: Vec<DataMisfit> = Vec::new();
    let peak = |image: ArrayView2<'_, f32>| image.iter().fold(0.0_f32, |most, v| v.max(most));
    let wanted = || held_out.iter().flat_map(|shard| shard.wanted.outer_iter());
    let most = wanted().map(peak).fold(0.0, f32::max);
    for shard in held_out {
        let Some(data) = &shard.data else { continue };
        let noise_std: Vec<f64> = data.noise_std.iter().map(|std| f64::from(*std)).collect();
        let mut evidence = DataConsistency::new(jacobian.view(), &noise_std, shard.mask.view())?;
        let mut net = Denoiser::new(weights, shard.mask.view())?;
        let raw = ImageStack::new(shard.raw.mapv(f64::from), shard.mask.clone())?;
        let made = net.denoise(&raw)?;
        let frames = made.iter().zip(data.differences.outer_iter()).zip(shard.wanted.outer_iter());
        for ((image, differences), _) in frames.filter(|f| peak(f.1) >= TOUCHED * most) {
            let differences = differences.mapv(f64::from).to_vec();
            known.push(evidence.misfit(image, &differences)?);
        }
    }
    Ok(DataMisfit::limit(&known, NOT_BELIEVED))
}
