//! The report: one page that needs nothing beside it.

use super::folder::DemoFolder;
use super::judge::Judged;
use super::pictures::{self, File, Shown};
use crate::html::{Block, Page, Section};
use eit_skin::live::LiveModel;
use eit_skin::method::Method;
use eit_skin::plan::{left_out, sequence::Sequence};

/// Makes the page. `nodes` is the size of the mesh that simulates, `seconds` what all of it took.
pub(super) fn page(
    shown: &[Shown],
    files: &[File],
    model: &LiveModel,
    folder: &DemoFolder,
    nodes: usize,
    seconds: f64,
) -> Page {
    let mut sections = vec![what(shown, files, model, nodes, seconds)];
    sections.extend(shown.iter().map(|shown| of_experiment(shown, files)));
    sections.push(skin(files));
    sections.push(latency(shown, files));
    sections.push(left_out_section(shown, model));
    sections.push(again(shown, folder));
    Page {
        title: "Touches on a conductive fabric, seen through 16 electrodes".to_owned(),
        lead: "Two experiments of Duan, Taurand and Soleimani (Sci. Rep. 9:8831, 2019) on a \
               simulated fabric: fingers move over it, an instrument measures 208 voltages a frame, \
               total variation in space and time turns them into images, a U-net takes out what \
               moving electrodes leave in them, and touches are found and followed."
            .to_owned(),
        sections,
    }
}

/// A picture of this name, if it was made.
fn picture(files: &[File], name: &str, caption: String) -> Option<Block> {
    let bytes = files.iter().find(|file| file.0 == name)?.1.clone();
    Some(Block::Picture { bytes, caption })
}

fn what(shown: &[Shown], files: &[File], model: &LiveModel, nodes: usize, seconds: f64) -> Section {
    let mut blocks = Vec::new();
    let caption = "Three frames of each experiment. From top to bottom: the true change of the \
                   sheet conductivity, the reconstruction, and what the U-net makes of it.";
    blocks.extend(picture(files, pictures::OVERVIEW, caption.to_owned()));
    let lines: Vec<&str> = shown.iter().map(|s| s.seen.line.as_str()).collect();
    blocks.push(Block::Text(format!(
        "The fabric is simulated on {nodes} nodes, with fingertips that dent it, hysteresis, \
         electrodes that are drawn along, an uneven weave, drift and an instrument with noise \
         (docs/FABRIC.md); images are reconstructed on {} nodes. The frames are sent by an emulated \
         instrument over {}, read by the same driver that reads a real one, recorded, and turned \
         into images and touches as they come. Nothing of the truth is known to that side. All of it \
         took {seconds:.0} s.",
        model.skin().mesh.surface().nodes().len(),
        lines.first().copied().unwrap_or("nothing"),
    )));
    blocks.push(table(shown));
    Section { title: "What happened".to_owned(), blocks }
}

fn table(shown: &[Shown]) -> Block {
    let head = [
        "experiment",
        "images",
        "touches where no finger is",
        "fingers found",
        "off by (mm)",
        "squared error, raw (S²)",
        "after the net (S²)",
        "left of it",
        "put aside",
        "touches after, median (ms)",
        "95 % (ms)",
        "image after, median (ms)",
    ];
    let row = |shown: &Shown| {
        let [raw, made, quotient] = shown.judged.errors_of_touched();
        let Judged { fingers, found, invented, left_over, .. } = shown.judged;
        let summary = &shown.seen.summary;
        let ms = |latency_s: Option<f64>| match latency_s {
            Some(latency_s) => format!("{:.1}", 1e3 * latency_s),
            None => "-".to_owned(),
        };
        vec![
            shown.experiment.name.to_owned(),
            summary.frames.to_string(),
            format!("{invented} ({left_over})"),
            format!("{found} of {fingers}"),
            format!("{:.1}", 1e3 * shown.judged.distance_m()),
            format!("{raw:.1e}"),
            format!("{made:.1e}"),
            format!("{quotient:.2}"),
            summary.aside.to_string(),
            ms(summary.latency_s(0.5)),
            ms(summary.latency_s(0.95)),
            ms(summary.image_latency_s(0.5)),
        ]
    };
    let late: usize = shown.iter().map(|s| s.judged.late).sum();
    Block::Table {
        head: head.map(str::to_owned).to_vec(),
        rows: shown.iter().map(row).collect(),
        note: format!(
            "Touches where no finger is: counted frame by frame, beyond 25 mm from every finger; in \
             brackets those with no finger on the skin at all, which a robot would act on for nothing. \
             Errors are medians over the frames with a finger. {late} of the fingers that were missed \
             are in the first frame of a contact: a faint touch must be seen twice. Put aside: images of \
             the net that do not explain their measurements, so that the raw one is shown."
        ),
    }
}

fn of_experiment(shown: &Shown, files: &[File]) -> Section {
    let experiment = &shown.experiment;
    let [images, error, touches] = experiment.figures;
    let [ten, eleven, twelve] = match experiment.folder {
        "one-finger" => [10, 11, 12],
        _ => [13, 14, 15],
    };
    let ours = |number: usize| format!("In the place of the paper's figure {number}.");
    let blocks = [
        picture(
            files,
            experiment.movie,
            "The movie: truth, reconstruction, and the image after the U-net with the touches found \
             in it."
                .to_owned(),
        ),
        picture(
            files,
            images,
            format!(
                "Truth (top), reconstruction (middle), after the U-net (bottom), on one scale. {}",
                ours(ten)
            ),
        ),
        picture(
            files,
            error,
            format!("Mean squared error of each frame before and after the net. {}", ours(eleven)),
        ),
        picture(
            files,
            touches,
            format!("The touches over the skin beside the true ways. {}", ours(twelve)),
        ),
    ];
    Section { title: experiment.name.to_owned(), blocks: blocks.into_iter().flatten().collect() }
}

fn skin(files: &[File]) -> Section {
    let blocks = [
        picture(
            files,
            pictures::MESH,
            "The mesh that reconstructs. In the place of the paper's figure 3.".to_owned(),
        ),
        picture(
            files,
            pictures::WAYS,
            "The ways of the fingers. In the place of the paper's figure 4.".to_owned(),
        ),
    ];
    Section {
        title: "The skin and the fingers".to_owned(),
        blocks: blocks.into_iter().flatten().collect(),
    }
}

fn latency(shown: &[Shown], files: &[File]) -> Section {
    let caption = "How many frames took how long, from their last byte to image and touches.";
    let mut blocks: Vec<Block> =
        picture(files, pictures::LATENCY, caption.to_owned()).into_iter().collect();
    let pair =
        |shown: &Shown| (shown.experiment.name.to_owned(), shown.seen.summary.images_words());
    blocks.push(Block::List(shown.iter().map(pair).collect()));
    Section { title: "How fast, and how near the optimum".to_owned(), blocks }
}

fn left_out_section(shown: &[Shown], model: &LiveModel) -> Section {
    let frames = shown.first().map_or(0, |shown| shown.seen.frames.len());
    let sequence = Sequence::Frames(frames);
    let mut list: Vec<(String, String)> = left_out::of(model.skin(), Method::StTv, sequence, true)
        .into_iter()
        .map(|part| (part.what.to_owned(), part.why))
        .collect();
    let more = [
        (
            "a deadline",
            "the window stops at a proven gap or a number of iterations, never by the clock: so the \
             recording gives the same images again, to the bit",
        ),
        (
            "a look ahead",
            "each image is of the newest frame; images that wait for three more frames are steadier \
             and late by those",
        ),
        (
            "frames that hold nothing but noise",
            "a window in which nothing touches the skin is not solved: its image is zero",
        ),
    ];
    list.extend(more.map(|(what, why)| (what.to_owned(), why.to_owned())));
    Section { title: "What was left out, and why".to_owned(), blocks: vec![Block::List(list)] }
}

fn again(shown: &[Shown], folder: &DemoFolder) -> Section {
    let mut blocks = vec![Block::Text(
        "The recordings give the same images to the bit, on this computer and by this program:"
            .to_owned(),
    )];
    let command = |shown: &Shown| super::replay_command(folder.path(), &shown.experiment);
    blocks.push(Block::Code(shown.iter().map(command).collect::<Vec<_>>().join("\n")));
    Section { title: "Again".to_owned(), blocks }
}
