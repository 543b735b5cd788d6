//! Sequences of a real skin, whose truth nobody knows: wanted images by the paper's rule.

use super::motion;
use super::shared::{Shared, touches_of};
use super::{BaseRequest, HELD_OUT, is_held_out, number_within};
use crate::error::SkinError;
use crate::frames::{Frames, QuietFrames};
use crate::progress::Progress;
use crate::skin::Skin;
use eit_denoise::{ImageStack, MeasurementOrder, Shard, ThresholdRule};
use ndarray::{Array2, Axis};

/// Training sequences from recordings, each with the scene's reference.
#[derive(Debug)]
pub(crate) struct Recorded {
    names: Vec<String>,
    recordings: Vec<Frames>,
    /// Number of sequences to make.
    count: usize,
    /// Whether all frames are learnt from.
    pub is_whole: bool,
}

/// Smallest number of frames of a single recording, of which one in [`HELD_OUT`] is held out.
const LEAST_FRAMES: usize = 2 * HELD_OUT;

impl Recorded {
    /// Reads all recordings, before any work.
    ///
    /// # Errors
    ///
    /// Files that cannot be read, or recordings of another skin.
    pub(crate) fn new(
        shared: &Shared,
        request: &BaseRequest,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let (files, is_whole) = (&request.recording, request.pairs.is_some());
        let skin = &shared.chain.linearised.skin;
        let read = |file: &std::path::PathBuf| skin.read_frames(std::slice::from_ref(file), None);
        let recordings = progress.stage("read recordings", || {
            files.iter().map(read).collect::<Result<Vec<_>, SkinError>>()
        })?;
        let names: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
        if let ([name], [alone]) = (&names[..], &recordings[..])
            && alone.values.nrows() < LEAST_FRAMES
            && !is_whole
        {
            return Err(SkinError::input(format!(
                "{name}: {} frames, but one recording alone needs {LEAST_FRAMES} or more: some are \
                 held out",
                alone.values.nrows()
            )));
        }
        Ok(Self { names, recordings, count: request.sequence_count(), is_whole })
    }

    /// Describes everything besides the chain that the training pairs depend on.
    pub(crate) fn recipe(&self, skin: &Skin) -> String {
        let frames = |(name, frames): (&String, &Frames)| {
            let mut bytes = Vec::new();
            let quiet = frames.quiet.iter().flat_map(|quiet| &quiet.values);
            for value in frames.values.iter().chain(&frames.reference).chain(quiet) {
                bytes.extend(value.to_le_bytes());
            }
            bytes.extend(frames.good.iter().chain(&frames.used).map(|flag| u8::from(*flag)));
            format!("{name} ({:08x})", crc32fast::hash(&bytes))
        };
        let list: Vec<String> = self.names.iter().zip(&self.recordings).map(frames).collect();
        format!(
            "recorded: {}{}, {:?}, {:?}, {:?}",
            list.join(", "),
            if self.is_whole { ", none held out" } else { "" },
            ThresholdRule::default(),
            skin.settings.noise,
            skin.settings.touch.sign
        )
    }

    /// The frames of a sequence. Held-out frames, which are the last recordings or the last frames of a single
    /// one, are never trained on, not even rotated.
    fn frames(&self, index: usize) -> Frames {
        if self.is_whole {
            return self.recordings[index % self.recordings.len()].clone();
        }
        let is_held_out = is_held_out(index, self.count);
        let [alone] = &self.recordings[..] else {
            let learnt = self.recordings.len() - self.recordings.len().div_ceil(HELD_OUT);
            let (learnt, held_out) = self.recordings.split_at(learnt);
            let list = if is_held_out { held_out } else { learnt };
            return list[number_within(index, self.count) % list.len()].clone();
        };
        let count = alone.values.nrows();
        let learnt = count - count / HELD_OUT;
        let part = if is_held_out { learnt..count } else { 0..learnt };
        Frames {
            values: alone.values.slice_axis(Axis(0), part.clone().into()).to_owned(),
            good: alone.good.slice_axis(Axis(0), part.into()).to_owned(),
            ..alone.clone()
        }
    }

    /// Makes a sequence by its number: first the recordings as they are, then rotated and reflected copies.
    ///
    /// # Errors
    ///
    /// The errors of the reconstruction.
    pub(crate) fn sequence(&self, shared: &Shared, index: usize) -> Result<Shard, SkinError> {
        let recording = self.frames(index);
        let mut random = motion::random(shared.seed, index, 0);
        let turned = match shared.symmetries.is_empty() || index < self.recordings.len() {
            true => recording,
            false => {
                turned(&recording, &shared.symmetries[random.below(shared.symmetries.len())].order)?
            }
        };
        let chained = shared.chain.reconstruct_frames(turned)?;
        let mut data = shared.data(&chained)?;
        let sign = shared.chain.linearised.skin.settings.touch.sign.factor();
        let touches = touches_of(&chained, sign)?;
        let raster = shared.chain.linearised.raster(&mut Progress::silent())?;
        let mask = raster.mask();
        let raw = ImageStack::new(chained.images.mapv(|v| sign * v), mask.clone())?;
        let wanted = ThresholdRule::default().on(mask.view())?.apply(&raw)?;
        if let Some(data) = &mut data {
            // of the images that are turned over, the data too
            data.differences.mapv_inplace(|v| sign as f32 * v);
        }
        let shard = Shard::new(&raw, &wanted)?;
        Ok(Shard { data, touches, ..shard })
    }
}

/// Measurements of the rotated or reflected skin.
fn turned(frames: &Frames, order: &MeasurementOrder) -> Result<Frames, SkinError> {
    let row = |values: &[f64]| {
        let mut out = vec![0.0; values.len()];
        order.apply_into(values, &mut out)?;
        Ok::<_, SkinError>(out)
    };
    let rows = |values: &Array2<f64>| {
        let mut out = values.clone();
        for mut values in out.rows_mut() {
            let new = row(&values.to_vec())?;
            values.assign(&ndarray::ArrayView1::from(&new));
        }
        Ok::<_, SkinError>(out)
    };
    // flags go where their values go; the sign of a turned pair does not matter
    let flags = |flag: bool| if flag { 1.0 } else { 0.0 };
    let used: Vec<f64> = frames.used.iter().map(|used| flags(*used)).collect();
    let quiet = match &frames.quiet {
        Some(quiet) => {
            Some(QuietFrames { values: rows(&quiet.values)?, source: quiet.source.clone() })
        }
        None => None,
    };
    Ok(Frames {
        values: rows(&frames.values)?,
        reference: row(&frames.reference)?,
        good: rows(&frames.good.mapv(flags))?.mapv(|v| v != 0.0),
        used: row(&used)?.iter().map(|v| *v != 0.0).collect(),
        quiet,
        ..frames.clone()
    })
}
