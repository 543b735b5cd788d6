//! The report: one page, and the larger pictures beside it.

use super::accuracy::Accuracy;
use super::folder::DemoFolder;
use super::pictures::{self, File, Shown};
use crate::html::{Block, Page, Section};
use eit_skin::live::LiveModel;
use eit_skin::method::Method;
use eit_skin::plan::{left_out, sequence::Sequence};

/// Creates the page. `nodes` is the size of the simulation mesh, `seconds` the total run time.
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
    sections.push(latency(shown, files));
    sections.push(left_out_section(shown, model));
    sections.push(again(shown, folder));
    Page {
        title: "Touches on a conductive fabric, measured with 16 electrodes".to_owned(),
        lead: format!(
            "A sheet of conductive fabric feels where it is pressed: electrodes on its rim measure voltages, and \
             the program computes from them where the fingers are. {}. The fabric is simulated, in two \
             experiments like those of Duan, Taurand and Soleimani (Sci. Rep. 9:8831, 2019), ten times as fast (their own: \
             eit demo --paper): fingers move over it, an emulated \
             instrument measures 208 voltages per frame, touches are found in them and tracked, total variation in \
             space and time makes images, and a U-net removes the artefacts of moving electrodes.",
            result(shown)
        ),
        sections,
    }
}

/// The result in a sentence.
fn result(shown: &[Shown]) -> String {
    let of = |shown: &Shown| {
        let Accuracy { fingers, found, false_touches, .. } = shown.accuracy;
        format!(
            "{}: found {found} of {fingers} times, {:.1} mm off (median), {false_touches} false touches",
            shown.experiment.name,
            1e3 * shown.accuracy.distance_m()
        )
    };
    pictures::capitalised(&shown.iter().map(of).collect::<Vec<_>>().join("; "))
}

/// Returns a picture beside the page, if it exists.
pub(super) fn beside(files: &[File], name: &str, caption: String) -> Option<Block> {
    let (name, bytes) = files.iter().find(|file| file.0 == name)?;
    Some(match name.ends_with(".gif") {
        true => Block::Movie { name: (*name).to_owned(), bytes: bytes.len(), caption },
        false => Block::File { name: (*name).to_owned(), caption },
    })
}

/// Returns an embedded picture, if it exists.
fn picture(files: &[File], name: &str, caption: String) -> Option<Block> {
    let bytes = files.iter().find(|file| file.0 == name)?.1.clone();
    Some(Block::Picture { bytes, caption })
}

fn what(shown: &[Shown], files: &[File], model: &LiveModel, nodes: usize, seconds: f64) -> Section {
    let mut blocks = Vec::new();
    let caption = "Three moments of each experiment. From top to bottom: the true change of the \
                   sheet conductivity, the reconstruction, and the image after the U-net.";
    blocks.extend(picture(files, pictures::OVERVIEW, caption.to_owned()));
    for shown in shown {
        let caption =
            format!("{}: the touches that were found and the true path.", shown.experiment.name);
        blocks.extend(picture(files, shown.experiment.figures[2], caption));
    }
    blocks.push(table(shown));
    let lines: Vec<&str> = shown.iter().map(|s| s.live.line.as_str()).collect();
    blocks.push(Block::Text(format!(
        "The fabric is simulated on {nodes} nodes, with fingertips that dent it, hysteresis, \
         electrodes that move with the fabric, an uneven weave, drift and an instrument with noise \
         (docs/FABRIC.md); images are reconstructed on {} nodes. The frames are sent by an \
         emulated instrument over {}, read by the same driver as a real one, recorded, and turned \
         into images and touches as they arrive. The reconstruction has no access to the truth. \
         The whole run took {seconds:.0} s.",
        model.skin().mesh.surface().nodes().len(),
        lines.first().copied().unwrap_or("nothing"),
    )));
    Section { title: "Results".to_owned(), blocks }
}

fn table(shown: &[Shown]) -> Block {
    let head = [
        "experiment",
        "position error, median (mm)",
        "largest (mm)",
        "fingers found",
        "false touches",
        "relative error of images (%)",
        "after the U-net (%)",
        "images",
        "rejected images",
        "time to touches, median (ms)",
        "95 % (ms)",
        "time to image, median (ms)",
    ];
    let row = |shown: &Shown| {
        let [raw, made] = shown.accuracy.relative_errors().map(|error| 100.0 * error);
        let mm = |distance_m: f64| format!("{:.1}", 1e3 * distance_m);
        let Accuracy { fingers, found, false_touches, without_finger, .. } = shown.accuracy;
        let summary = &shown.live.summary;
        let ms = |latency_s: Option<f64>| match latency_s {
            Some(latency_s) => format!("{:.1}", 1e3 * latency_s),
            None => "-".to_owned(),
        };
        vec![
            shown.experiment.name.to_owned(),
            mm(shown.accuracy.distance_m()),
            shown.accuracy.worst_distance_m().map_or_else(|| "-".to_owned(), mm),
            format!("{found} of {fingers}"),
            format!("{false_touches} ({without_finger})"),
            format!("{raw:.0}"),
            format!("{made:.0}"),
            summary.frames.to_string(),
            summary.images.put_aside.to_string(),
            ms(summary.latency_s(0.5)),
            ms(summary.latency_s(0.95)),
            ms(summary.image_latency_s(0.5)),
        ]
    };
    let late: usize = shown.iter().map(|s| s.accuracy.late).sum();
    Block::Table {
        head: head.map(str::to_owned).to_vec(),
        rows: shown.iter().map(row).collect(),
        note: format!(
            "False touches are counted per frame and lie more than 25 mm from every finger; in \
             brackets, those with no finger on the skin at all, to which a robot would react \
             without cause. Relative errors are root mean square errors over the root mean square of the true change; \
             medians over the frames with a finger. {late} of the missed \
             fingers are in the first frame of a contact: a faint touch must be detected twice. \
             Rejected images are U-net images that do not explain the measurements; the raw image \
             is shown instead."
        ),
    }
}

fn of_experiment(shown: &Shown, files: &[File]) -> Section {
    let experiment = &shown.experiment;
    let [images, error, _, position] = experiment.figures;
    let blocks = [
        beside(files, position, "Distance of every touch from its finger.".to_owned()),
        beside(
            files,
            images,
            "Truth (top), reconstruction (middle), after the U-net (bottom), on a common scale."
                .to_owned(),
        ),
        beside(files, error, "Relative error of each image before and after the U-net.".to_owned()),
        beside(
            files,
            experiment.movie,
            "Truth, reconstruction, and the image after the U-net with the detected touches"
                .to_owned(),
        ),
    ];
    Section { title: experiment.name.to_owned(), blocks: blocks.into_iter().flatten().collect() }
}

fn latency(shown: &[Shown], files: &[File]) -> Section {
    let caption =
        "Distribution of the time from the last byte of a frame to its image and touches.";
    let mut blocks: Vec<Block> =
        beside(files, pictures::LATENCY, caption.to_owned()).into_iter().collect();
    let pair =
        |shown: &Shown| (shown.experiment.name.to_owned(), shown.live.summary.images.description());
    blocks.push(Block::List(shown.iter().map(pair).collect()));
    Section { title: "Speed and distance from the optimum".to_owned(), blocks }
}

fn left_out_section(shown: &[Shown], model: &LiveModel) -> Section {
    let frames = shown.first().map_or(0, |shown| shown.live.frames.len());
    let sequence = Sequence::Frames(frames);
    let mut list: Vec<(String, String)> = left_out::of(model.skin(), Method::StTv, sequence, true)
        .into_iter()
        .map(|part| (part.what.to_owned(), part.why))
        .collect();
    let more = [
        (
            "a deadline",
            "the window stops at a proven gap or a number of iterations, never by the clock, so \
             the recording reproduces the images bit for bit",
        ),
        (
            "look-ahead",
            "each image shows the newest frame; waiting for three more frames gives steadier \
             images with that much delay",
        ),
        (
            "frames that contain only noise",
            "a window without any touch is not solved; its image is zero",
        ),
    ];
    list.extend(more.map(|(what, why)| (what.to_owned(), why.to_owned())));
    Section { title: "What was omitted, and why".to_owned(), blocks: vec![Block::List(list)] }
}

fn again(shown: &[Shown], folder: &DemoFolder) -> Section {
    let mut blocks = vec![Block::Text(
        "On this computer and with this program, the recordings reproduce the images bit for bit:"
            .to_owned(),
    )];
    let command = |shown: &Shown| super::replay_command(folder.path(), &shown.experiment);
    blocks.push(Block::Code(shown.iter().map(command).collect::<Vec<_>>().join("\n")));
    Section { title: "Again".to_owned(), blocks }
}
