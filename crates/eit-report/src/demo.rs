//! `eit demo`: runs two experiments like the paper's, ten times as fast, from the simulated fabric to the touches,
//! through an emulated instrument, its driver, a recording, streaming total variation and the
//! U-net.
//!
//! While one experiment runs live, the other is simulated. The instrument's data pass through the
//! same loop as in `eit live`, so `eit replay` gives the same images.

mod accuracy;
mod experiment;
mod folder;
mod live;
mod page;
pub mod paper;
mod pictures;

use self::accuracy::Accuracy;
use self::experiment::{EXPERIMENTS, Experiment, TouchedFabric};
use self::folder::DemoFolder;
use self::pictures::{File, Shown};
use crate::Answer;
use crate::error::ReportError;
use crate::output::{OutFolder, io};
use crate::settings::DemoSettings;
use crate::watched::latency_json;
use eit_fem::fabric::Simulation;
use eit_picture::SkinDrawing;
use eit_skin::Progress;
use eit_skin::StopFlag;
use eit_skin::live::{LiveModel, REFERENCE_FRAMES, TouchFrame};
use eit_skin::scene::{Instrument, Scene};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// File name of the page.
const REPORT: &str = "report.html";
/// File name of the results as JSON.
const NUMBERS: &str = "report.json";

/// Names of the experiments, and file names of their recordings.
pub const RECORDINGS: [(&str, &str); 2] = [
    (EXPERIMENTS[0].name, EXPERIMENTS[0].recording),
    (EXPERIMENTS[1].name, EXPERIMENTS[1].recording),
];

/// Names of all files that a demo writes.
fn own() -> Vec<&'static str> {
    let mut own = vec!["scene.toml", REPORT, NUMBERS];
    own.extend([pictures::LATENCY, pictures::OVERVIEW]);
    for experiment in EXPERIMENTS {
        own.extend([experiment.folder, experiment.recording, experiment.movie]);
        own.extend(experiment.figures);
    }
    own
}

/// Called with every frame of an experiment while it runs live: its name, the model and the frame.
/// The experiments run on separate threads and may overlap.
pub type FrameWatcher<'a> = dyn Fn(&str, &LiveModel, &TouchFrame<'_>) + Sync + 'a;

/// State shared by the threads.
struct Stage<'a> {
    watcher: Option<&'a FrameWatcher<'a>>,
    folder: &'a DemoFolder,
    model: &'a Arc<LiveModel>,
    instrument: &'a Instrument,
    skin: SkinDrawing,
    interrupt: &'a StopFlag,
    /// Set when one thread has failed, so that the other stops.
    has_failed: AtomicBool,
}

/// Runs the demo; `watcher` sees its frames, too.
///
/// # Errors
///
/// A folder with other files, or one that cannot be written; no pseudo-terminal and no TCP port for the
/// emulated instrument.
pub fn run(
    args: &DemoSettings,
    watcher: Option<&FrameWatcher<'_>>,
    interrupt: &StopFlag,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let start = Instant::now();
    let folder = DemoFolder::claim(&args.out, &own(), args.force)?;
    folder.write_scene(&scene_text(args.quick)?)?;
    let scene = Scene::load(&folder.scene().display().to_string())?;
    let instrument = scene.instrument()?;
    let fabric = TouchedFabric::new(&scene, args.quick, progress)?;
    let model = Arc::new(LiveModel::from_scene(&scene, REFERENCE_FRAMES, progress)?);
    let raster = model.linearised.raster(progress)?;
    let stage = Stage {
        watcher,
        folder: &folder,
        model: &model,
        instrument: &instrument,
        skin: SkinDrawing::from_raster(&model.skin().mesh, raster),
        interrupt,
        has_failed: AtomicBool::new(false),
    };
    let (shown, files) = stage.experiments(&fabric, progress)?;
    let seconds = start.elapsed().as_secs_f64();
    if shown.len() < EXPERIMENTS.len() || shown.iter().any(|shown| !shown.live.is_whole) {
        return Ok(interrupted(&folder, &shown));
    }
    stage.report(&shown, files, fabric.nodes(), seconds, progress)
}

/// The scene that `eit replay` uses for the recordings.
fn scene_text(quick: bool) -> Result<String, ReportError> {
    let (pixels, any_skin, rate_hz) = if quick { (32, true, 50.0) } else { (64, false, 10.0) };
    let skin = Scene::text("paper-disc")?;
    Ok(format!(
        "{skin}\n\
         [reconstruction]\nmethod = \"st-tv\"\npixels = {pixels}\n\
         target_gap = 0.1        # 0.01 takes four times as long without improving the images\n\n\
         [touch]\n\
         drift_time_s = 300.0    # fingers stay for most of a minute; drift estimated from four quiet seconds would be \
         noise\n\n\
         [denoise]\nweights = \"default\"\nany_skin = {any_skin}\n\n\
         [instrument]            # eit_hw::emulator\n\
         driver = \"eits1\"\nframe_rate_hz = {rate_hz:?}"
    ))
}

impl Stage<'_> {
    fn goes_on(&self) -> bool {
        !self.interrupt.is_set() && !self.has_failed.load(Ordering::Relaxed)
    }

    /// Simulates the experiments one after the other; each runs live once it has been simulated.
    fn experiments(
        &self,
        fabric: &TouchedFabric,
        progress: &mut Progress,
    ) -> Result<(Vec<Shown>, Vec<File>), ReportError> {
        let ended = std::thread::scope(|scope| {
            let mut running = Vec::new();
            for experiment in EXPERIMENTS {
                if !self.goes_on() {
                    break;
                }
                let place = self.folder.join(experiment.folder);
                match fabric.simulate(&experiment, &place, progress) {
                    Err(error) => {
                        self.has_failed.store(true, Ordering::Relaxed);
                        running.push(Err(error));
                    }
                    Ok(_) if !self.goes_on() => break,
                    Ok(truth) => {
                        let mut beside = progress.beside();
                        let watch = move || {
                            let shown = self.experiment(experiment, truth, &mut beside);
                            self.has_failed.fetch_or(shown.is_err(), Ordering::Relaxed);
                            shown
                        };
                        running.push(Ok(scope.spawn(watch)));
                    }
                }
            }
            let join = |thread: std::thread::ScopedJoinHandle<'_, _>| {
                thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            running.into_iter().map(|thread| thread.and_then(join)).collect::<Vec<_>>()
        });
        let (mut shown, mut files) = (Vec::new(), Vec::new());
        for experiment in ended {
            let (experiment, made) = experiment?;
            shown.push(experiment);
            files.extend(made);
        }
        Ok((shown, files))
    }

    /// Runs one experiment live, evaluates it and draws its pictures.
    fn experiment(
        &self,
        experiment: Experiment,
        truth: Simulation,
        progress: &mut Progress,
    ) -> Result<(Shown, Vec<File>), ReportError> {
        let frames = truth.frames_v.nrows();
        let goes_on = || self.goes_on();
        let live = live::run(&experiment, frames, self, &goes_on, progress)?;
        let accuracy = Accuracy::of(&live, &truth);
        let rate_hz = self.instrument.frame_rate_hz;
        let shown = Shown { experiment, truth, live, accuracy, rate_hz };
        if !shown.live.is_whole {
            return Ok((shown, Vec::new()));
        }
        let files = progress.steps(experiment.stages[2], 1, |bar| {
            pictures::of_experiment(&shown, &self.skin, bar)
        })?;
        Ok((shown, files))
    }

    /// Writes pictures, page and results.
    fn report(
        &self,
        shown: &[Shown],
        mut files: Vec<File>,
        nodes: usize,
        seconds: f64,
        progress: &mut Progress,
    ) -> Result<Answer, ReportError> {
        let mut out = OutFolder::new(self.folder.path())?;
        progress.stage("report", || {
            files.extend(pictures::of_both(shown, &self.skin)?);
            let page = page::page(shown, &files, self.model, self.folder, nodes, seconds);
            for (name, bytes) in &files {
                out.write(name, |w| w.write_all(bytes).map_err(io))?;
            }
            out.write(REPORT, |w| page.write(w))
        })?;
        let mut names = out.names();
        names.push(NUMBERS);
        names.extend(EXPERIMENTS.map(|experiment| experiment.recording));
        names.extend(["scene.toml", EXPERIMENTS[0].folder, EXPERIMENTS[1].folder]);
        let json = json!({
            "scene": "paper-disc",
            "seconds": seconds,
            "simulation_nodes": nodes,
            "reconstruction_nodes": self.model.skin().mesh.surface().nodes().len(),
            "experiments": shown.iter().map(numbers).collect::<Vec<_>>(),
            "interrupted": false,
            "report": self.folder.join(REPORT).display().to_string(),
            "files": names,
        });
        out.write(NUMBERS, |w| writeln!(w, "{json:#}").map_err(io))?;
        out.commit(&[])?;
        Ok(Answer { text: text(shown, self.folder, seconds), json })
    }
}

/// Returns the command that replays a recording.
fn replay_command(folder: &Path, experiment: &Experiment) -> String {
    format!(
        "eit replay {} --from {} --out {}-again",
        folder.join("scene.toml").display(),
        folder.join(experiment.recording).display(),
        experiment.folder
    )
}

fn numbers(shown: &Shown) -> Value {
    let summary = &shown.live.summary;
    json!({
        "name": shown.experiment.name,
        "frames": summary.frames,
        "line": shown.live.line,
        "images": summary.images,
        "touches": summary.touches,
        "latency_s": latency_json(|share| summary.latency_s(share)),
        "image_latency_s": latency_json(|share| summary.image_latency_s(share)),
        "judged": shown.accuracy.json(),
        "simulation_s": shown.truth.report.time_s,
        "live_s": summary.span_s,
        "notices": summary.notices,
    })
}

fn text(shown: &[Shown], folder: &DemoFolder, seconds: f64) -> String {
    let mut lines = Vec::new();
    for Shown { experiment, live, accuracy, .. } in shown {
        let [raw, made] = accuracy.relative_errors().map(|error| 100.0 * error);
        let ms = |latency_s: Option<f64>| 1e3 * latency_s.unwrap_or(f64::NAN);
        let latency_ms = ms(live.summary.latency_s(0.5));
        let image_ms = ms(live.summary.image_latency_s(0.5));
        lines.push(format!(
            "{}: position error {:.1} mm; fingers found in {} of {} cases, {} false touches ({} of \
             them with no finger on the skin); relative error of the {} images {raw:.0} %, after \
             the U-net {made:.0} %; {latency_ms:.1} ms from a frame to its touches, {image_ms:.0} \
             ms to its image",
            experiment.name,
            1e3 * accuracy.distance_m(),
            accuracy.found,
            accuracy.fingers,
            accuracy.false_touches,
            accuracy.without_finger,
            live.summary.frames,
        ));
    }
    if let Some(line) = shown.iter().map(|s| &s.live.line).find(|line| line.starts_with("TCP")) {
        lines.push(format!("connection to the instrument: {line}"));
    }
    lines.push(format!("all values are medians; total time {seconds:.0} s"));
    lines.push(format!("report: {}", folder.join(REPORT).display()));
    lines.extend(
        shown
            .first()
            .map(|s| format!("to replay: {}", replay_command(folder.path(), &s.experiment))),
    );
    lines.join("\n")
}

/// Answer after Ctrl-C.
fn interrupted(folder: &DemoFolder, shown: &[Shown]) -> Answer {
    let mut text =
        "interrupted: no report and no pictures; the files written are complete".to_owned();
    let mut files = vec!["scene.toml"];
    for experiment in EXPERIMENTS {
        let live = shown.iter().find(|shown| shown.experiment.name == experiment.name);
        let own = folder.join(experiment.folder);
        if let Some(Shown { live, .. }) = live {
            text += &format!(
                "\n{}: {} frames with images; {} and {}",
                experiment.name,
                live.summary.frames,
                folder.join(experiment.recording).display(),
                own.display(),
            );
            files.push(experiment.recording);
            files.push(experiment.folder);
        } else if own.exists() {
            text += &format!("\n{}: simulated, not run live; {}", experiment.name, own.display());
            files.push(experiment.folder);
        }
    }
    let json = json!({
        "interrupted": true,
        "experiments": shown.iter().map(numbers).collect::<Vec<_>>(),
        "files": files,
    });
    Answer { text, json }
}
