//! The page: the paper's figures in their order, each with what the paper shows and what comes out here.

use super::super::page::beside;
use super::figures::{self, File};
use super::images::Imaged;
use super::{EXPERIMENTS, SEED, Shown};
use crate::html::{Block, Page, Section};
use eit_denoise::Weights;
use serde_json::{Value, json};
use std::path::Path;

/// What the scene assumes, because the paper does not state it.
const ASSUMED: [(&str, &str); 6] = [
    ("skin", "radius 0.1 m, conductivity 1e-5 S"),
    ("electrodes", "half of the rim is covered (19.6 mm each), contact impedance 1 kOhm m, 0.1 mA"),
    (
        "fabric",
        "tension, foundation, stiffness, friction, gains, relaxation, drift: docs/FABRIC.md",
    ),
    (
        "experiments",
        "1.5 N with a tip of 10 mm radius, 20 untouched frames first; one turn at 0.8 and 0.6 of the radius",
    ),
    ("ring that is suppressed", "4 of 64 pixels"),
    (
        "net",
        "width 4, depth 3, 12 epochs at a rate of 2e-3; the pairs that the recording lacks are turned or mirrored copies \
         of its own",
    ),
];

/// Returns the page; `folder` is where it lies.
pub(super) fn page(
    shown: &[Shown; 2],
    files: &[File],
    nets: &[Weights; 2],
    folder: &Path,
    seconds: f64,
) -> Page {
    let sections = vec![
        Section {
            title: "Result".to_owned(),
            blocks: vec![trainings(shown), Block::Text(halved(shown))],
        },
        experiments(shown, files),
        movement(files),
        learning_bases(shown, files),
        trained(shown, files),
        equations(shown),
        pressures(shown, files),
        assumed(nets),
        again(folder, seconds),
    ];
    Page {
        title: "The paper as it is printed".to_owned(),
        lead: format!(
            "The experiments of Duan, Taurand and Soleimani (Sci. Rep. 9:8831, 2019) on the simulated fabric: 397 frames of \
             one finger and 252 of two at one frame per second, images by their equation (7), the learning bases of \
             their two trainings, and each net on both experiments. Figures follow the paper's order. Everything is \
             simulated with seed {SEED}; where the paper has photographs, there is the truth."
        ),
        sections,
    }
}

/// What the trainings are worth.
fn trainings(shown: &[Shown; 2]) -> Block {
    let head = [
        "training",
        "tested on",
        "error after / before, to the wanted images",
        "frames reduced by more than half (%)",
        "error after / before, to the truth",
        "fingers shown (%)",
    ];
    let mut rows = Vec::new();
    for (training, own) in EXPERIMENTS.iter().enumerate() {
        for of in shown {
            let made = &of.trained[training];
            let [to_rule, to_truth] = of.over_raw(made);
            rows.push(vec![
                format!("{}: {}", training + 1, own.name),
                of.experiment.name.to_owned(),
                format!("{to_rule:.3}"),
                format!("{:.0}", 100.0 * of.halved(made)),
                format!("{to_truth:.2}"),
                format!("{:.0}", 100.0 * of.fingers_shown(made)),
            ]);
        }
    }
    Block::Table {
        head: head.map(str::to_owned).to_vec(),
        rows,
        note: "Mean squared errors, medians of the frames with a finger. Wanted images, by which a recording without truth \
               is judged, are the images themselves after suppression of the rim, the rule of 55 % and that of 15 pixels; \
               the truth is what the simulated finger changed. A finger is shown if the strongest pixel within 20 mm of it has \
               a fifth of the raw image's or more."
            .to_owned(),
    }
}

fn halved(shown: &[Shown; 2]) -> String {
    let least = |pick: fn(&Shown, &Imaged) -> f64| {
        let all = shown.iter().flat_map(|of| of.trained.iter().map(move |made| pick(of, made)));
        all.fold(f64::INFINITY, f64::min)
    };
    format!(
        "The paper says that errors are reduced by more than half. Here they are in at least {:.0} % of the frames, in \
         every training on either experiment, if judged by the wanted images.",
        100.0 * least(|of, made| of.halved(made))
    )
}

fn experiments(shown: &[Shown; 2], files: &[File]) -> Section {
    let mut blocks = Vec::new();
    let says = [
        "The paper: one finger anticlockwise near the rim, from snapshot 13 of 21 towards the top left and through the \
         centre, where it claims the merit of total variation in space and time.",
        "The paper: two fingers, clockwise.",
    ];
    for (k, (of, says)) in shown.iter().zip(says).enumerate() {
        let strongest = centred(of);
        let captions = [
            format!("{says} Here: the same way, {} frames.", of.recording.script.frames),
            format!(
                "By equation (7): relative error {:.0} %{strongest}, with artefacts at the electrodes.",
                100.0 * of.relative_error(&of.equation_7.to_truth_s2)
            ),
            format!(
                "The same frames by this program's defaults: relative error {:.0} %.",
                100.0 * of.relative_error(&of.defaults.to_truth_s2)
            ),
        ];
        let pictures = figures::SHEETS[k].into_iter().zip(captions);
        blocks.extend(pictures.filter_map(|(name, caption)| beside(files, name, caption)));
    }
    Section { title: "21 snapshots of each experiment (figures 3, 4 and 6)".to_owned(), blocks }
}

/// For the experiment that crosses the centre, how far its image there is from the finger.
fn centred(of: &Shown) -> String {
    let touches = &of.recording.simulation.truth.touches;
    let from_centre = |p: [f64; 2]| p[0].hypot(p[1]);
    let inner = touches.iter().filter(|touch| from_centre(touch.position_m) < 0.03);
    let distances = inner.filter_map(|touch| {
        let image = of.equation_7.values.index_axis(ndarray::Axis(0), touch.frame);
        let pixels = image.indexed_iter().filter(|(_, value)| value.is_finite());
        let (place, _) = pixels.max_by(|a, b| a.1.total_cmp(b.1))?;
        let [x, y] = of.equation_7.raster.centre_m(place.0, place.1);
        Some((x - touch.position_m[0]).hypot(y - touch.position_m[1]))
    });
    match eit_core::median(distances) {
        Some(distance_m) => format!(
            "; within 30 mm of the centre its strongest pixel is {:.0} mm from the finger (median)",
            1e3 * distance_m
        ),
        None => String::new(),
    }
}

fn movement(files: &[File]) -> Section {
    let caption = "The paper: a phantom with one inclusion beside the fabric near the rim and with two fingers, and how electrodes \
                   move. Here: the same; without movement spots at the electrodes are faint.";
    Section {
        title: "Why there are artefacts (figure 5)".to_owned(),
        blocks: beside(files, figures::MOVEMENT, caption.to_owned()).into_iter().collect(),
    }
}

fn learning_bases(shown: &[Shown; 2], files: &[File]) -> Section {
    let pairs = shown.each_ref().map(|of| {
        let Shown { experiment, .. } = of;
        format!(
            "{} frames of {} recorded, {} pairs trained on ({} of our frames have a finger, the other pairs are turned or mirrored)",
            experiment.frames,
            experiment.name,
            experiment.pairs,
            of.touched.len()
        )
    });
    let caption = format!(
        "The paper: {}; {}. From top to bottom the image by equation (7), without the rim, above 55 % of the largest value, \
         without blobs of fewer than 15 pixels.",
        pairs[0], pairs[1]
    );
    Section {
        title: "The learning bases (figure 8)".to_owned(),
        blocks: beside(files, figures::BASE, caption).into_iter().collect(),
    }
}

fn trained(shown: &[Shown; 2], files: &[File]) -> Section {
    let mut blocks = Vec::new();
    for training in 0..2 {
        for (k, of) in shown.iter().enumerate() {
            let [images, errors] = figures::TRAINED[training][k];
            let made = &of.trained[training];
            let [to_rule, to_truth] = of.over_raw(made);
            let on = if training == k { "what it was trained on" } else { "the other experiment" };
            let caption = format!(
                "Training {}, tested on {on}, {}. The paper: errors are reduced by more than half. Here: to \
                 {:.0} % of what they were (to the truth {:.0} %).",
                training + 1,
                of.experiment.name,
                100.0 * to_rule,
                100.0 * to_truth
            );
            blocks.extend(beside(files, images, caption));
            let caption = format!(
                "Errors of each frame: {:.0} % are more than halved.",
                100.0 * of.halved(made)
            );
            blocks.extend(beside(files, errors, caption));
        }
    }
    Section {
        title: "Trainings 1 and 2, each on both experiments (figures 10 to 15)".to_owned(),
        blocks,
    }
}

fn equations(shown: &[Shown; 2]) -> Section {
    let row = |of: &Shown, [name, differences]: [&str; 2], errors_s2: &[f64], time_s: f64| {
        vec![
            of.experiment.name.to_owned(),
            name.to_owned(),
            differences.to_owned(),
            format!("{:.0}", 100.0 * of.relative_error(errors_s2)),
            format!("{time_s:.0}"),
        ]
    };
    let rows = shown.iter().flat_map(|of| {
        let Shown { equation_7, defaults, .. } = of;
        let names = [
            ["equation (7): equal weights in space and time, a radius for each frame", "plain"],
            ["defaults without the net: penalised, two weights", "normalised"],
            ["defaults", "normalised"],
        ];
        [
            row(of, names[0], &equation_7.to_truth_s2, equation_7.time_s),
            row(of, names[1], &defaults.raw_to_truth_s2, defaults.time_s),
            row(of, names[2], &defaults.to_truth_s2, defaults.time_s),
        ]
    });
    let head = ["experiment", "images", "differences", "relative error (%)", "time (s)"];
    Section {
        title: "The paper's equations, and the defaults".to_owned(),
        blocks: vec![Block::Table {
            head: head.map(str::to_owned).to_vec(),
            rows: rows.collect(),
            note: "Root mean square error over the root mean square of the true change, medians of the frames with a \
                   finger; an empty image has 100 %. Times include the touches and run beside each other on two cores."
                .to_owned(),
        }],
    }
}

fn pressures(shown: &[Shown; 2], files: &[File]) -> Section {
    let mut blocks = Vec::new();
    for (k, of) in shown.iter().enumerate() {
        let Some(errors) = of.pressure_errors() else { continue };
        let caption = format!(
            "{}: {:.1} kPa found where the finger presses with {:.1} kPa (medians of {} touches); {:.0} % off in the median, \
             stated {:.0} %.",
            super::super::pictures::capitalised(of.experiment.name),
            1e-3 * errors.found_pa,
            1e-3 * errors.true_pa,
            errors.touches,
            100.0 * errors.error,
            100.0 * errors.stated
        );
        let [sheet, movie] = figures::PRESSURE[k];
        blocks.extend(beside(files, sheet, caption));
        let caption = format!("Pressure, {}: truth and found", of.experiment.name);
        blocks.extend(beside(files, movie, caption));
    }
    blocks.push(Block::Text(
        "The paper calls it pressure mapping. Here a dozen presses of known force teach newtons, and each force is \
         spread over the image of its touch."
            .to_owned(),
    ));
    Section { title: "Pressure in pascals".to_owned(), blocks }
}

fn assumed(nets: &[Weights; 2]) -> Section {
    let text = |(what, how): (&str, &str)| (what.to_owned(), how.to_owned());
    let mut list: Vec<_> = ASSUMED.into_iter().map(text).collect();
    list.push((
        "instrument".to_owned(),
        "the paper's, a KHU Mark2.5, did 50 frames per second and the fabric allowed about one; here an instrument with \
         its noise is simulated"
            .to_owned(),
    ));
    for (number, net) in nets.iter().enumerate() {
        let what = format!("training {}", number + 1);
        let about = |key: &str| net.about.get(key).cloned().unwrap_or_default();
        let how = format!(
            "{} pairs, best of {} epochs: {}",
            about("examples"),
            about("epochs"),
            about("best_epoch")
        );
        list.push((what, how));
    }
    Section {
        title: "What the paper does not state, and is assumed".to_owned(),
        blocks: vec![Block::List(list)],
    }
}

fn again(folder: &Path, seconds: f64) -> Section {
    let folder = folder.display().to_string();
    let commands: Vec<String> =
        (1..).zip(EXPERIMENTS).map(|(number, of)| of.command(number, &folder)).collect();
    Section {
        title: "Again".to_owned(),
        blocks: vec![
            Block::Text(format!(
                "This page took {seconds:.0} s with the shipped nets. A program with feature train makes the nets anew from \
                 the frames beside the page:"
            )),
            Block::Code(commands.join("\n")),
        ],
    }
}

/// The results of an experiment.
pub(super) fn numbers(of: &Shown) -> Value {
    let nets = of.trained.iter().map(|made| {
        let [to_rule, to_truth] = of.over_raw(made);
        json!({
            "to_wanted": to_rule,
            "to_truth": to_truth,
            "halved": of.halved(made),
            "fingers_shown": of.fingers_shown(made),
        })
    });
    let pressure = of.pressure_errors().map(|errors| {
        json!({
            "touches": errors.touches,
            "found_pa": errors.found_pa,
            "true_pa": errors.true_pa,
            "error": errors.error,
            "stated": errors.stated,
        })
    });
    json!({
        "name": of.experiment.name,
        "frames": of.recording.script.frames,
        "frame_rate_hz": of.recording.script.frame_rate_hz,
        "touched": of.touched.len(),
        "snapshots": of.snapshots,
        "relative_error": {
            "equation_7": of.relative_error(&of.equation_7.to_truth_s2),
            "defaults_without_net": of.relative_error(&of.defaults.raw_to_truth_s2),
            "defaults": of.relative_error(&of.defaults.to_truth_s2),
        },
        "time_s": { "equation_7": of.equation_7.time_s, "defaults": of.defaults.time_s },
        "trainings": nets.collect::<Vec<_>>(),
        "pressure": pressure,
    })
}

/// The answer in words.
pub(super) fn text(shown: &[Shown; 2], report: &Path, seconds: f64) -> String {
    let mut lines = vec![halved(shown)];
    for of in shown {
        let error = |imaged: &Imaged| 100.0 * of.relative_error(&imaged.to_truth_s2);
        lines.push(format!(
            "{}: relative error {:.0} % by equation (7), {:.0} % by the defaults",
            of.experiment.name,
            error(&of.equation_7),
            error(&of.defaults)
        ));
    }
    lines.push(format!("seed {SEED}, {seconds:.0} s\nreport: {}", report.display()));
    lines.join("\n")
}
