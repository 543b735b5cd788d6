//! What U-nets make of images: error before and after, touches lost and invented.

mod cases;
mod judge;
mod pictures;

use super::table::Table;
use super::{Answer, table};
use crate::error::ReportError;
use crate::output::OutFolder;
use crate::settings::ReportSettings;
use cases::{Sequence, sequences};
use eit_denoise::ThresholdRule;
use eit_skin::denoise::{Chain, Chained, Check, Lengths, Net};
use eit_skin::scene::DenoiseSettings;
use eit_skin::{MeshOverride, Progress, Scene, Skin};
use judge::{Judge, Tally};
use ndarray::{Array3, Axis};

/// Frames before the first touch.
const QUIET: usize = 20;

/// Images of a sequence by one way.
struct Way {
    /// "raw", "rule", a net, or a net that was checked.
    name: String,
    images: Array3<f64>,
    /// Part of the frames in which a net was not believed; `None` for what is no checked net.
    aside: Option<f64>,
}

/// A sequence by every way.
struct Shown {
    sequence: Sequence,
    ways: Vec<Way>,
}

/// Simulates every case, reconstructs, denoises with each net, compares.
pub(super) fn run(
    args: &ReportSettings,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let skin = Skin::set_up(&Scene::load("paper-disc")?, &MeshOverride::default(), progress)?;
    let load = |name: &String| {
        let settings = DenoiseSettings { weights: name.clone(), any_skin: false };
        Ok((name.clone(), Net::load(&settings, &skin.net_target())?))
    };
    let nets: Vec<(String, Net)> =
        args.weights.iter().map(load).collect::<Result<_, ReportError>>()?;
    let lengths = Some(Lengths { frames: 100, quiet: QUIET });
    let chain = Chain::new(skin, args.method.as_deref(), lengths, progress)?;
    let sequences = sequences(&chain.linearised.skin, args.quick, progress)?;
    let shown = progress.steps("images", sequences.len(), |bar| {
        let mut shown = Vec::new();
        for sequence in sequences {
            let made = chain.reconstruct(&sequence.values)?;
            shown.push(Shown { ways: ways(&chain, &made, &nets)?, sequence });
            bar.inc();
        }
        Ok::<_, ReportError>(shown)
    })?;
    let judge = Judge::new(chain.linearised.raster(progress)?, &shown)?;
    let mut tallies = Vec::new();
    for case in &shown {
        let mut raw = None;
        for way in &case.ways {
            let tally = judge.tally(&case.sequence, way)?;
            // the first way is the raw image
            let raw: &Vec<f64> = raw.get_or_insert_with(|| tally.over_raw.clone());
            tallies.push((case, way, tally.relative_to(raw)));
        }
    }
    let tables = [touched_table(&tallies, &chain), foreign_table(&tallies)];
    pictures::draw(&shown, &chain, out)?;
    let files = ["denoise.md", "denoise.csv", "denoise.json"];
    table::write("What the U-net makes of images", &tables, files, (out, progress))
}

/// The raw images, those of the paper's rule, and those of each net without and with the check.
fn ways(chain: &Chain, made: &Chained, nets: &[(String, Net)]) -> Result<Vec<Way>, ReportError> {
    let raw = &made.images;
    let raster = chain.linearised.raster(&mut Progress::silent())?;
    let mut rule = ThresholdRule::default().on(raster.mask().view())?;
    let mut kept = raw.clone();
    for (image, out) in raw.outer_iter().zip(kept.axis_iter_mut(Axis(0))) {
        rule.apply_into(image, out)?;
    }
    let plain = |name: &str, images| Way { name: name.to_owned(), images, aside: None };
    let mut ways = vec![plain("raw", raw.clone()), plain("rule", kept)];
    let mut check = Check::new(&made.fitted)?;
    for (name, net) in nets {
        let mut silent = Progress::silent();
        let mut images = raw.clone();
        net.apply(&mut images, raster, None, &mut silent)?;
        ways.push(plain(name, images));
        let mut images = raw.clone();
        if let Some(checked) = net.apply(&mut images, raster, Some(&mut check), &mut silent)? {
            // quiet frames at the start count for nothing
            let aside = checked.put_aside().iter().filter(|f| **f >= QUIET).count();
            let aside = aside as f64 / (raw.dim().0 - QUIET) as f64;
            ways.push(Way { name: format!("{name}, checked"), images, aside: Some(aside) });
        }
    }
    Ok(ways)
}

type Row<'a> = (&'a Shown, &'a Way, Tally);

fn touched_table(tallies: &[Row<'_>], chain: &Chain) -> Table {
    let rows = tallies.iter().filter(|(case, ..)| case.sequence.truth.is_some());
    Table {
        name: "touched",
        title: "Touched frames before and after",
        note: format!(
            "Simulated fabric on {} nodes, {} images on {} nodes, {} x {} pixels. Seeds, scripts and \
             fabrics are none of a training's. Medians over the frames in which a finger presses with \
             at least {} N; mean squared error (MSE) against the true change of conductivity, as a \
             part of the raw image's; peak signal to noise ratio (PSNR) over the largest true change \
             of the sequence; structural similarity (SSIM) and correlation with the truth. A touch is \
             found where a blob of at least half of the image's largest value and {} of the way's \
             usual maximum lies within {} mm; invented is a blob that is no finger's. \"rule\": the \
             paper's threshold rule. \"checked\": images that do not explain their measurements are \
             the raw ones; \"put aside\" is their part of all frames after the quiet ones.",
            cases::NODES,
            chain.method.name(),
            chain.linearised.skin.mesh.surface().nodes().len(),
            chain.linearised.skin.pixels(),
            chain.linearised.skin.pixels(),
            judge::FULL_N,
            judge::FLOOR,
            1e3 * judge::WITHIN_M,
        ),
        columns: vec![
            "sequence",
            "image",
            "frames",
            "MSE / raw",
            "MSE / raw, 90 %",
            "PSNR, dB",
            "SSIM",
            "correlation",
            "found",
            "invented a frame",
            "position, mm",
            "put aside",
        ],
        rows: rows.map(|(case, way, tally)| tally.touched_row(case.sequence.name, way)).collect(),
    }
}

fn foreign_table(tallies: &[Row<'_>]) -> Table {
    Table {
        name: "foreign",
        title: "Frames without a touch, or like none of the training",
        note:
            "Blobs a frame as above: on a quiet skin, with a loose electrode and with a cut (the \
               conductivity falls) each one is invented; a palm is one touch. Between touches: \
               frames of the scripts above in which no finger touches."
                .to_owned(),
        columns: vec!["frames of", "image", "frames", "blobs a frame", "put aside"],
        rows: tallies
            .iter()
            .filter_map(|(case, way, tally)| tally.foreign_row(case, way))
            .collect(),
    }
}
