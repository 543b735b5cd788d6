//! Error against run time: every solver on every built-in scene, measured now and here.
//!
//! A scene is a skin, two slowly moving fingers (once soft, once with an edge) and noise, or the
//! paper's experiments on the simulated fabric; simulated on a finer mesh, reconstructed on another.
//! A direct method is one point, an iterated one a curve over the gap it is run to from cold. Beside
//! each time stands the floor: the same work at this machine's best rates.

mod best;
pub(crate) mod case;
mod fabric;
mod floor;
mod forward;
mod inverse;
mod merged;
mod page;
mod peers;
mod plots;
mod point;
mod promise;

use super::Answer;
use super::bench::Bench;
use crate::cli::ReportArgs;
use crate::denoise::Net;
use crate::error::CliError;
use crate::machine::Machine;
use crate::measured::Measured;
use crate::output::OutFolder;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::simulate::{FingerShape, Simulated, simulate};
use case::{CASES, Case};
use floor::Floors;
use forward::ForwardCourse;
use inverse::{Lane, Outcome};
use ndarray::Array2;
use promise::Promise;

/// Sizes of the race.
struct Size {
    frames: usize,
    /// Pixels along the skin, ascending; the last raster judges all.
    pixels: &'static [usize],
    /// Gaps that iterated methods run to, one after the other, each from cold.
    gaps: &'static [f64],
    /// A run ends then at the latest, and is the last of its curve.
    deadline_s: f64,
    /// Most runs of a setting; those that have taken so long together are not repeated.
    runs: usize,
    repeat_below_s: f64,
    /// Runs of a direct method and of a stream.
    direct_runs: usize,
    stream_runs: usize,
    /// Nodes of the forward problem's meshes, and runs on each.
    nodes: &'static [usize],
    forward_runs: usize,
}

/// Gaps of a full run.
pub(crate) const GAPS: [f64; 4] = [3e-1, 1e-1, 1e-2, 1e-3];

const FULL: Size = Size {
    frames: 20,
    pixels: &[16, 32, 64],
    gaps: &GAPS,
    deadline_s: 20.0,
    runs: 3,
    repeat_below_s: 6.0,
    direct_runs: 15,
    stream_runs: 2,
    nodes: &[500, 1_000, 2_000, 4_000, 8_000, 16_000],
    forward_runs: 9,
};
const QUICK: Size = Size {
    frames: 6,
    pixels: &[16, 32],
    gaps: &[1e-1, 1e-2],
    deadline_s: 2.0,
    runs: 2,
    repeat_below_s: 0.1,
    direct_runs: 3,
    stream_runs: 1,
    nodes: &[1_000, 2_000],
    forward_runs: 3,
};

/// A simulated recording and its truth.
pub(super) struct Recording {
    pub shape: &'static str,
    pub simulated: Simulated,
    /// Siemens, [frame, masked pixel] on the raster that judges.
    pub truth: Array2<f64>,
}

/// Everything about a scene.
struct Findings {
    pub case: Case,
    pub rows: Vec<Measured>,
    /// Solver, shape, reason.
    pub failures: Vec<(String, &'static str, String)>,
    pub forward: ForwardCourse,
    pub promises: Vec<Promise>,
    /// Files of pictures and their bytes.
    pub pictures: Vec<(&'static str, Vec<u8>)>,
    /// Noise, meshes, pixels.
    pub note: String,
}

/// Simulates, runs every solver, draws, writes.
pub(super) fn run(
    args: &ReportArgs,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, CliError> {
    let size = if args.quick { QUICK } else { FULL };
    let cases = chosen(&args.scenes)?;
    args.peers.as_deref().map_or(Ok(()), peers::check)?;
    let machine = progress.stage("this machine", || Ok::<_, CliError>(Machine::measure()))?;
    let floors = Floors { machine };
    let mut results: Vec<Findings> = Vec::new();
    for (number, case) in cases.iter().enumerate() {
        progress.group(format!("{} ({} of {})", case.name, number + 1, cases.len()));
        // cases of one skin share its forward problem
        let same = results.iter().find(|known| known.case.scene == case.scene);
        let forward = same.map(|known| known.forward.clone());
        results.push(one(case, &size, (&floors, args, forward), progress)?);
    }
    page::write(&results, (&size, &floors.machine, args.quick), out, progress)
}

/// The scenes of the command line; all without.
fn chosen(names: &[String]) -> Result<Vec<Case>, CliError> {
    if names.is_empty() {
        return Ok(CASES.to_vec());
    }
    let find = |name: &String| {
        CASES.into_iter().find(|case| case.name == name).ok_or_else(|| {
            let known: Vec<&str> = CASES.iter().map(|case| case.name).collect();
            CliError::input(format!("--scenes {name}: the scenes are {}", known.join(", ")))
        })
    };
    names.iter().map(find).collect()
}

/// One scene.
fn one(
    case: &Case,
    size: &Size,
    (floors, args, forward): (&Floors, &ReportArgs, Option<ForwardCourse>),
    progress: &mut Progress,
) -> Result<Findings, CliError> {
    let scene = Scene::load(case.scene)?;
    let forward = match forward {
        Some(forward) => forward,
        None if args.plans => ForwardCourse::default(),
        None => progress.steps("forward problem", size.nodes.len(), |bar| {
            forward::course(&scene, (size, args.peers.as_deref()), floors, bar)
        })?,
    };
    let mut silent = Progress::silent();
    let benches: Vec<Bench> = size
        .pixels
        .iter()
        .map(|&pixels| Bench::of(case.scene, pixels, &mut silent))
        .collect::<Result<_, _>>()?;
    let judge = &benches[benches.len() - 1];
    // nets know the fabric: on other fingers they are judged by --denoise
    let nets = if case.is_fabric { nets(&scene, judge, &args.weights)? } else { Vec::new() };
    let (mut courses, mut failures, mut recordings) = (Vec::new(), Vec::new(), Vec::new());
    let recorded_now =
        if args.plans { Vec::new() } else { recorded((case, 0), judge, size, progress)? };
    for recording in recorded_now {
        let peers = args.peers.as_deref();
        let lane =
            Lane { benches: &benches, recording: &recording, size, floors, nets: &nets, peers };
        let Outcome { courses: found, failures: failed } =
            progress.steps("solvers", lane.solvers(), |bar| Ok::<_, CliError>(lane.run(bar)))?;
        failures.extend(failed.into_iter().map(|(solver, why)| (solver, recording.shape, why)));
        courses.push(found);
        recordings.push(recording);
    }
    // recordings that no table has seen
    let others = recorded((case, 1), judge, size, progress)?;
    let shown = &others[0];
    let frames = shown.truth.nrows();
    let (rows, missing) = merged::rows((case, frames), &courses, &floors.machine);
    failures.extend(missing.into_iter().map(|name| (name, "one", "the other failed".to_owned())));
    let judged = (judge, case.is_fabric);
    let promises = progress.stage("the plan", || promise::of(judged, &others, floors))?;
    let touched = match case.is_fabric {
        true => "of one finger and of two".to_owned(),
        false => format!("of {} fingers, soft or hard, noise {} dB", case::FINGERS, case.noise_db),
    };
    let note = format!(
        "{}: {}; {} frame{} {touched}; simulated on {} nodes, reconstructed on {}, judged on \
         {pixels} x {pixels} pixels",
        case.name,
        case.what,
        frames,
        if case.is_still { "" } else { "s" },
        shown.simulated.nodes,
        judge.setup.mesh.surface().nodes().len(),
        pixels = judge.raster.pixels(),
    );
    let pictures = plots::draw(case, (&rows, &note), judge, (&recordings, &courses))?;
    Ok(Findings { case: *case, rows, failures, forward, promises, pictures, note })
}

/// The two recordings of a scene: soft and hard fingers, or one finger and two on the fabric. Each
/// `take` has its own paths and noise.
fn recorded(
    (case, take): (&Case, u64),
    judge: &Bench,
    size: &Size,
    progress: &mut Progress,
) -> Result<Vec<Recording>, CliError> {
    if case.is_fabric {
        return fabric::SCRIPTS
            .into_iter()
            .map(|(name, script, seed)| {
                let script = (name, script, seed + 10 * take);
                fabric::recording(judge, script, size, progress)
            })
            .collect();
    }
    let of = |(shape, finger): (&'static str, FingerShape)| {
        let settings = case.movie(finger, size.frames, take);
        let simulated = simulate(&judge.scene, &settings, &judge.raster, progress)?;
        let truth = judge.pixels_of(simulated.truth.view())?;
        Ok(Recording { shape, simulated, truth })
    };
    FingerShape::ALL.into_iter().map(of).collect()
}

/// The nets among `names` that were trained for this skin and raster. That the default one is for
/// another skin is no error; that one which was asked for is, is told by its absence.
fn nets(scene: &Scene, judge: &Bench, names: &[String]) -> Result<Vec<(String, Net)>, CliError> {
    let mut nets = Vec::new();
    for name in names {
        match Net::load(scene, name, judge.raster.pixels(), false) {
            Ok(net) => nets.push((net_name(name), net)),
            Err(error) if name != "default" && !std::path::Path::new(name).exists() => {
                return Err(error);
            }
            Err(_) => {}
        }
    }
    Ok(nets)
}

/// "U-net", or with the name of its file.
fn net_name(name: &str) -> String {
    let stem = std::path::Path::new(name).file_stem().map(|stem| stem.to_string_lossy());
    match stem {
        Some(stem) if name != "default" => format!("U-net {stem}"),
        _ => "U-net".to_owned(),
    }
}
