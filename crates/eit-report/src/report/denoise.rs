//! Evaluates U-nets on held-out sequences: image errors before and after, missed touches and false
//! ones.

mod held_out;
mod pictures;
mod scores;
mod variants;

use super::named_net::NamedNet;
use super::table::{self, Table, TableReport};
use crate::Answer;
use crate::error::ReportError;
use crate::output::OutFolder;
use crate::settings::ReportSettings;
use eit_skin::denoise::{Chain, Lengths, Net};
use eit_skin::scene::DenoiseSettings;
use eit_skin::{MeshOverride, Progress, Scene, Skin};
use held_out::{QUIET_FRAMES, RATE_HZ};
use scores::{Evaluation, Raw, VariantScores};
use variants::{ImageVariant, ImagedSequence, variants};

/// Simulates every case, reconstructs, denoises with each network and compares.
pub(super) fn run(
    settings: &ReportSettings,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let skin = Skin::set_up(&Scene::load("paper-disc")?, &MeshOverride::default(), progress)?;
    let load = |name: &String| {
        let settings = DenoiseSettings { weights: name.clone(), any_skin: false };
        Ok(NamedNet { name: name.clone(), net: Net::load(&settings, &skin.net_target())? })
    };
    let nets = settings.weights.iter().map(load).collect::<Result<Vec<NamedNet>, ReportError>>()?;
    let lengths = Some(Lengths { frames: 100, quiet: QUIET_FRAMES, rate_hz: RATE_HZ });
    let chain = Chain::new(skin, settings.method.as_deref(), lengths, progress)?;
    let linearised = &chain.linearised;
    let raster = linearised.raster(progress)?;
    let sequences = held_out::sequences(&linearised.skin, settings.quick, settings.seed, progress)?;
    let imaged = progress.steps("images", sequences.len(), |bar| {
        let mut imaged = Vec::new();
        for sequence in sequences {
            let made = chain.reconstruct(&sequence.values)?;
            imaged.push(ImagedSequence { variants: variants(raster, &made, &nets)?, sequence });
            bar.inc();
        }
        Ok::<_, ReportError>(imaged)
    })?;
    let evaluation = Evaluation::new(raster, &imaged)?;
    let mut scored: Vec<Scored<'_>> = Vec::new();
    for imaged in &imaged {
        let mut raw = None;
        for variant in &imaged.variants {
            let scores = evaluation.scores(imaged, variant)?;
            // the first variant is the raw image
            let raw: &Raw = raw.get_or_insert_with(|| scores.as_raw());
            let scores = scores.relative_to(raw);
            let before = scored.last().map(|before| &before.scores);
            let scores = scores.judged_by(variant, before);
            scored.push(Scored { imaged, variant, scores });
        }
    }
    let tables = [touched_table(&scored, &chain), foreign_table(&scored)];
    pictures::draw(&imaged, &chain, out)?;
    let files = ["denoise.md", "denoise.csv", "denoise.json"];
    let report = TableReport { title: "Effect of the U-net on images", tables: &tables, files };
    table::write(&report, out, progress)
}

/// A variant of a sequence's images and its scores.
struct Scored<'a> {
    imaged: &'a ImagedSequence,
    variant: &'a ImageVariant,
    scores: VariantScores,
}

fn touched_table(scored: &[Scored<'_>], chain: &Chain) -> Table {
    let skin = &chain.linearised.skin;
    let touched = scored.iter().filter(|scored| scored.imaged.sequence.truth.is_some());
    let row = |Scored { imaged, variant, scores }: &Scored<'_>| {
        scores.touched_row(imaged.sequence.name, variant)
    };
    Table {
        name: "touched",
        title: "Touched frames before and after",
        note: format!(
            "Simulated fabric on {} nodes, {} images on {} nodes, {} x {} pixels. Seeds, scripts \
             and fabrics differ from those used in training. Medians over the frames in which a \
             finger presses with at least {} N; mean squared error (MSE) against the true change \
             of conductivity, relative to the raw image's; peak signal-to-noise ratio (PSNR) with \
             respect to the largest true change of the sequence; structural similarity (SSIM) and \
             correlation with the truth; relative error: norm of the error over that of the truth \
             (an empty image has 1). To the rule: against the wanted images of the paper instead of \
             the truth. A touch is found where a blob of at least half of the image's largest value \
             and {} of the variant's usual maximum lies within {} mm; invented are false blobs. \
             Lost: touches that the raw image shows and this one does not; only here: false blobs in \
             frames in which the raw image has none. \"rule\": the paper's threshold rule. \
             \"checked\": images that do not explain their measurements are replaced by the raw \
             ones; \"put aside\" is their fraction of all frames after the quiet ones. Rightly: \
             touched frames in which the rejected image is worse than the raw one; wrongly: better; \
             let through: worse and shown.",
            held_out::NODES,
            chain.method.name(),
            skin.mesh.surface().nodes().len(),
            skin.pixels(),
            skin.pixels(),
            scores::FULL_N,
            scores::FLOOR,
            1e3 * scores::WITHIN_M,
        ),
        columns: vec![
            "sequence",
            "image",
            "frames",
            "MSE / raw",
            "MSE / raw, 90 %",
            "MSE / raw, to the rule",
            "relative error",
            "worse than raw",
            "PSNR, dB",
            "SSIM",
            "correlation",
            "found",
            "invented a frame",
            "position, mm",
            "lost",
            "only here",
            "put aside",
            "rightly",
            "wrongly",
            "let through",
        ],
        rows: touched.map(row).collect(),
    }
}

fn foreign_table(scored: &[Scored<'_>]) -> Table {
    let row = |Scored { imaged, variant, scores }: &Scored<'_>| {
        scores.foreign_row(&imaged.sequence, variant)
    };
    Table {
        name: "foreign",
        title: "Frames without a touch, or unlike any in training",
        note: "Blobs per frame as above: on a quiet skin, with a loose electrode and with a cut \
               (where the conductivity drops) each blob is false; a palm is one touch. Between \
               touches: frames of the scripts above in which no finger touches."
            .to_owned(),
        columns: vec!["frames of", "image", "frames", "blobs a frame", "put aside"],
        rows: scored.iter().filter_map(row).collect(),
    }
}
