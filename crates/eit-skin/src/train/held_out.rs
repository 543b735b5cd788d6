//! Quality of a trained net on sequences that it did not learn from.

use super::sequences::Sequences;
use crate::denoise::{Scores, scores};
use crate::error::SkinError;
use eit_denoise::{
    DataConsistency, Denoiser, ImageStack, ModelError, ModelErrorNorm, ModelErrorSum, Shard,
    ShardData, ThresholdRule, Weights,
};
use ndarray::{Array2, Array3, ArrayView1, ArrayView2, Axis, concatenate};

/// Required number of rejected images that are worse than the raw ones, for each that is better.
const RIGHT_TO_WRONG: usize = 6;
/// Largest fraction of the better held-out images that may be rejected if [`RIGHT_TO_WRONG`] is not
/// reached. Of a net's better images one in 100 leaves more than 0.11 of the energy, one in 200
/// more than 0.16 to 0.19, and the worst 0.5. Images without any touch leave 0.14 to 0.48 in four
/// frames of five: a limit that lets every better image pass would let data of the wrong sign pass,
/// too.
const MOST_BETTER_REJECTED: f64 = 0.005;
/// Range of the limit: an empty image, which explains nothing, is above it.
const LIMITS: [f64; 2] = [0.05, 0.6];
/// Frames whose truth has less than this fraction of the largest energy in their sequence are not counted.
const TOUCHED: f64 = 0.01;

/// A judge of a net's images, with its record on held-out frames.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct MeasuredJudge {
    /// Model error of the skin's data, and the limit.
    pub error: ModelError,
    /// Cross-validated counts: each half of the held-out sequences, judged with the limit of the other half.
    pub counts: JudgeCounts,
}

/// Number of touched held-out frames by the judge's decision.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct JudgeCounts {
    /// Number of judged frames.
    pub frames: usize,
    /// The net's image was rejected, and is worse than the raw one.
    pub rightly: usize,
    /// The net's image was rejected, but is better.
    pub wrongly: usize,
    /// The net's image was shown, but is worse.
    pub let_through: usize,
}

impl JudgeCounts {
    fn add(&mut self, is_rejected: bool, is_worse: bool) {
        self.frames += 1;
        self.rightly += usize::from(is_rejected && is_worse);
        self.wrongly += usize::from(is_rejected && !is_worse);
        self.let_through += usize::from(!is_rejected && is_worse);
    }

    /// Describes the counts in words.
    pub fn description(&self) -> String {
        format!(
            "of {} touched frames it rejects {} rightly and {} wrongly, and shows {} that are worse than \
             the raw image",
            self.frames, self.rightly, self.wrongly, self.let_through
        )
    }
}

/// A held-out frame.
struct Known {
    /// Fraction of the data's energy that neither the net's image nor noise and model error explain.
    left: f64,
    /// Whether the net's image is worse than the raw one.
    is_worse: bool,
    is_touched: bool,
    half: usize,
}

/// Compares the net and the threshold rule with the raw images of the held-out sequences.
///
/// # Errors
///
/// No held-out sequence, or weights for another number of pixels.
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

/// Measures the model error of a skin's data, which is what the true images of the training sequences leave
/// unexplained, and chooses the judge's limit on the held-out sequences. `None` if the base has no
/// measurements.
///
/// # Errors
///
/// The errors of the model and the net.
pub fn judge(
    weights: &Weights,
    learnt: &[Shard],
    held_out: &[Shard],
    sequences: &Sequences,
) -> Result<Option<MeasuredJudge>, SkinError> {
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
    // any positive one: the norm is used, not the score
    error.limit = 1.0;
    let mut norm = ModelErrorNorm::new(&error)?;
    let mut known = Vec::new();
    for (index, shard) in held_out.iter().enumerate() {
        let Some(data) = &shard.data else { return Ok(None) };
        let model = DataModel::new(&jacobian, shard, data)?;
        known.extend(frames(weights, shard, index % 2, model, &mut norm)?);
    }
    let Some(limit) = limit(known.iter()) else { return Ok(None) };
    error.limit = limit;
    let mut counts = JudgeCounts::default();
    for half in [0, 1] {
        let other = limit_of_half(&known, 1 - half);
        for frame in known.iter().filter(|frame| frame.half == half && frame.is_touched) {
            if let Some(limit) = other {
                counts.add(frame.left > limit, frame.is_worse);
            }
        }
    }
    Ok(Some(MeasuredJudge { error, counts }))
}

/// Judges the frames of a held-out sequence that have a raw image.
fn frames(
    weights: &Weights,
    shard: &Shard,
    half: usize,
    mut model: DataModel<'_>,
    norm: &mut ModelErrorNorm,
) -> Result<Vec<Known>, SkinError> {
    let mut net = Denoiser::new(weights, shard.mask.view())?;
    let made = shard.denoise(&mut net)?;
    let mut left = vec![0.0; model.noise_std.len()];
    let energies =
        shard.wanted.outer_iter().map(|wanted| wanted.iter().map(|v| v * v).sum::<f32>());
    let energies: Vec<f64> = energies.map(f64::from).collect();
    let most = energies.iter().copied().fold(0.0, f64::max);
    let mut known = Vec::new();
    for (frame, image) in made.iter().enumerate() {
        let [raw, wanted] = [&shard.raw, &shard.wanted]
            .map(|images| images.index_axis(Axis(0), frame).mapv(f64::from));
        if raw.iter().all(|value| *value == 0.0) {
            continue;
        }
        let differences = model.left_into(frame, image, &mut left)?;
        let [unexplained, noise] = norm.unexplained(&left, &differences, &model.noise_std)?;
        known.push(Known {
            left: unexplained - noise,
            is_worse: squared(image, wanted.view()) > squared(raw.view(), wanted.view()),
            is_touched: energies[frame] > TOUCHED * most,
            half,
        });
    }
    Ok(known)
}

fn limit_of_half(known: &[Known], half: usize) -> Option<f64> {
    limit(known.iter().filter(|frame| frame.half == half))
}

/// The smallest limit at which at least [`RIGHT_TO_WRONG`] times as many images are rejected rightly as
/// wrongly, but none above that which rejects the fraction [`MOST_BETTER_REJECTED`] of the better images: a single worse
/// image above all others would meet the first condition.
fn limit<'a>(known: impl Iterator<Item = &'a Known>) -> Option<f64> {
    let mut known: Vec<&Known> = known.collect();
    known.sort_by(|a, b| b.left.total_cmp(&a.left));
    let (mut right, mut wrong, mut limit) = (0, 0, None);
    for pair in known.windows(2) {
        right += usize::from(pair[0].is_worse);
        wrong += usize::from(!pair[0].is_worse);
        if right >= RIGHT_TO_WRONG * wrong {
            limit = Some(pair[1].left);
        }
    }
    let better: Vec<f64> =
        known.iter().filter(|frame| !frame.is_worse).map(|frame| frame.left).collect();
    let at = (MOST_BETTER_REJECTED * better.len() as f64) as usize;
    let largest = better.get(at).copied();
    let limit = [limit, largest].into_iter().flatten().reduce(f64::min)?;
    Some(limit.clamp(LIMITS[0], LIMITS[1]))
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

    /// Writes the residual of an image, and returns the frame's differences.
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;

    fn known(left: f64, is_worse: bool) -> Known {
        Known { left, is_worse, is_touched: true, half: 0 }
    }

    /// Eleven worse images above two better ones: the limit keeps the second better one, since two wrong
    /// rejections need twelve right ones. Where rejecting does not pay, one better image in 200 is rejected.
    #[test]
    fn the_limit_rejects_mostly_rightly() {
        let mut frames: Vec<Known> =
            (0..11).map(|k| known(0.5 - 0.01 * f64::from(k), true)).collect();
        frames.extend([known(0.35, false), known(0.34, false)]);
        frames.extend((0..300).map(|k| known(0.001 * f64::from(k), false)));
        assert_eq!(limit(frames.iter()), Some(0.34));
        // one more right one above pays for the second wrong one
        frames.push(known(0.55, true));
        assert_eq!(limit(frames.iter()), Some(0.001 * 299.0));
        let better = |count| (0..count).map(|k| known(0.0004 * f64::from(k), false));
        assert_eq!(limit(better(400).collect::<Vec<_>>().iter()), Some(0.0004 * 397.0));
        // one worse image above two better ones that no others are like
        let mut few: Vec<Known> = better(400).collect();
        few.extend([known(0.5, false), known(0.49, false), known(0.55, true)]);
        assert_eq!(limit(few.iter()), Some(0.0004 * 399.0));
        assert_eq!(limit([].iter()), None);
        assert_eq!(limit([known(0.9, false)].iter()), Some(LIMITS[1]));
    }

    #[test]
    fn counts_by_verdict_and_error() {
        let mut counts = JudgeCounts::default();
        for (is_rejected, is_worse) in [(true, true), (true, false), (false, true), (false, false)]
        {
            counts.add(is_rejected, is_worse);
        }
        let wanted = JudgeCounts { frames: 4, rightly: 1, wrongly: 1, let_through: 1 };
        assert_eq!(counts, wanted);
    }
}
