//! Evaluates U-nets on held-out sequences: image errors before and after, missed touches and false
//! ones. Prints the tables and writes pictures.
//!
//! Usage: `denoise [--quick] [--seed N] [--method METHOD] [--weights W]... [--out DIR]`. N is added to
//! the seed of every sequence: fresh noise, weave and drift. METHOD makes the raw images (default:
//! st-tv). W is "default" or a file of `eit net train`.
#![allow(clippy::print_stdout, reason = "the tables are this program's output")]

mod held_out;
mod pictures;
mod scores;
mod variants;

use benches::Result;
use benches::recording::Simulator;
use benches::table::Table;
use eit_skin::Progress;
use eit_skin::denoise::{Chain, Lengths, Net};
use eit_skin::scene::DenoiseSettings;
use held_out::{QUIET_FRAMES, RATE_HZ};
use scores::{Evaluation, Raw, VariantScores};
use std::path::PathBuf;
use variants::{ImageVariant, ImagedSequence, variants};

/// What the command line asks for.
struct Settings {
    quick: bool,
    seed: u64,
    method: Option<String>,
    weights: Vec<String>,
    out: PathBuf,
}

fn settings() -> Result<Settings> {
    let (mut quick, mut seed, mut method, mut weights) = (false, 0, None, Vec::new());
    let mut out = PathBuf::from("denoise-out");
    let mut arguments = std::env::args().skip(1);
    while let Some(name) = arguments.next() {
        if name == "--quick" {
            quick = true;
            continue;
        }
        let value = arguments.next().ok_or_else(|| format!("{name} needs a value"))?;
        match name.as_str() {
            "--seed" => seed = value.parse().map_err(|_| format!("--seed {value}: a number"))?,
            "--method" => method = Some(value),
            "--weights" => weights.push(value),
            "--out" => out = value.into(),
            _ => return Err(format!("'{name}' is not known").into()),
        }
    }
    if weights.is_empty() {
        weights.push("default".to_owned());
    }
    Ok(Settings { quick, seed, method, weights, out })
}

fn main() -> Result<()> {
    let settings = settings()?;
    std::fs::create_dir_all(&settings.out)?;
    let simulator = Simulator::paper_disc(64, held_out::NODES)?;
    let mut nets = Vec::new();
    for name in settings.weights {
        let of = DenoiseSettings { weights: name.clone(), any_skin: false };
        nets.push((name, Net::load(&of, &simulator.own.net_target())?));
    }
    let lengths = Some(Lengths { frames: 100, quiet: QUIET_FRAMES, rate_hz: RATE_HZ });
    let mut silent = Progress::silent();
    let chain =
        Chain::new(simulator.own.clone(), settings.method.as_deref(), lengths, &mut silent)?;
    let raster = chain.linearised.raster(&mut silent)?;
    let mut imaged = Vec::new();
    for sequence in held_out::sequences(&simulator, settings.quick, settings.seed)? {
        let made = chain.reconstruct(&sequence.values)?;
        imaged.push(ImagedSequence { variants: variants(raster, &made, &nets)?, sequence });
    }
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
    println!("{}\n{}", touched_table(&scored, &chain), foreign_table(&scored));
    pictures::draw(&imaged, &chain, &settings.out)
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
        title: "Frames without a touch, or unlike any in training",
        note: "Blobs per frame as above: on a quiet skin, with a loose electrode and with a cut \
               (where the conductivity drops) each blob is false; a palm is one touch. Between \
               touches: frames of the scripts above in which no finger touches."
            .to_owned(),
        columns: vec!["frames of", "image", "frames", "blobs a frame", "put aside"],
        rows: scored.iter().filter_map(row).collect(),
    }
}
