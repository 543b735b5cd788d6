//! Sequences of a real skin, whose truth nobody knows: wanted images by the paper's rule.

use super::motion::Random;
use super::workshop::Bench;
use crate::error::CliError;
use crate::frames::{self, Frames, QuietFrames};
use crate::progress::Progress;
use crate::scene::TouchSign;
use eit_denoise::{ImageStack, MeasurementOrder, Shard, ThresholdRule};
use ndarray::Array2;
use std::path::PathBuf;

/// Recordings, each against the reference of the scene.
pub(super) struct Recorded {
    names: Vec<String>,
    recordings: Vec<Frames>,
}

impl Recorded {
    /// Reads all of them, before any work.
    pub fn new(
        bench: &Bench<'_>,
        files: &[PathBuf],
        progress: &mut Progress,
    ) -> Result<Self, CliError> {
        let chain = &bench.chain;
        let read = |file: &PathBuf| {
            let files = std::slice::from_ref(file);
            frames::load(bench.scene, &chain.setup.protocol, files, None)
        };
        let recordings = progress.stage("read recordings", || {
            files.iter().map(read).collect::<Result<Vec<_>, CliError>>()
        })?;
        let names = files.iter().map(|file| file.display().to_string()).collect();
        Ok(Self { names, recordings })
    }

    /// What the pairs depend on beside the chain.
    pub fn recipe(&self) -> String {
        let frames = |(name, frames): (&String, &Frames)| {
            let mut bytes = Vec::new();
            for value in frames.values.iter().chain(&frames.reference) {
                bytes.extend(value.to_le_bytes());
            }
            format!("{name} ({:08x})", crc32fast::hash(&bytes))
        };
        let list: Vec<String> = self.names.iter().zip(&self.recordings).map(frames).collect();
        format!("recorded: {}, {:?}", list.join(", "), ThresholdRule::default())
    }

    /// A sequence by its number: the recordings as they are, then turned again and again.
    pub fn sequence(&self, bench: &Bench<'_>, index: usize) -> Result<Shard, CliError> {
        let count = self.recordings.len();
        let recording = &self.recordings[index % count];
        let mut random = Random::new(bench.seed, index, 0);
        let turned = match bench.symmetries.is_empty() || index < count {
            true => recording.clone(),
            false => turned(recording, &bench.symmetries[random.choice(bench.symmetries.len())].1)?,
        };
        let chained = bench.chain.reconstruct_frames(turned)?;
        let data = bench.data(&chained)?;
        let sign = if bench.scene.touch.sign == TouchSign::Decrease { -1.0 } else { 1.0 };
        let mask = bench.chain.raster.mask();
        let raw = ImageStack::new(chained.images.mapv(|v| sign * v), mask.clone())?;
        let wanted = ThresholdRule::default().on(mask.view())?.apply(&raw)?;
        let shard = Shard::new(&raw, &wanted)?;
        Ok(Shard { data, ..shard })
    }
}

/// How the turned skin would have measured.
fn turned(frames: &Frames, order: &MeasurementOrder) -> Result<Frames, CliError> {
    let row = |values: &[f64]| {
        let mut out = vec![0.0; values.len()];
        order.apply_into(values, &mut out)?;
        Ok::<_, CliError>(out)
    };
    let rows = |values: &Array2<f64>| {
        let mut out = values.clone();
        for mut values in out.rows_mut() {
            let new = row(&values.to_vec())?;
            values.assign(&ndarray::ArrayView1::from(&new));
        }
        Ok::<_, CliError>(out)
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
