//! The images of a scene: recordings, every solver on each, what its plan promised, pictures.

use super::super::bench::Bench;
use super::case::{self, Case};
use super::inverse::{Lane, Outcome};
use super::promise::{self, Promise};
use super::{How, Recording, Size, fabric, merged, plots};
use crate::error::ReportError;
use crate::simulate::{FingerShape, simulate};
use eit_skin::Progress;
use eit_skin::denoise::Net;
use eit_skin::plan::measured::Measured;
use eit_skin::scene::DenoiseSettings;

/// Everything about the images of a scene.
pub(super) struct Findings {
    pub case: Case,
    pub rows: Vec<Measured>,
    /// Solver, shape, reason.
    pub failures: Vec<(String, &'static str, String)>,
    pub promises: Vec<Promise>,
    /// Files of pictures and their bytes.
    pub pictures: Vec<(&'static str, Vec<u8>)>,
    /// Noise, meshes, pixels.
    pub note: String,
}

/// Simulates, runs every solver, draws; `None` if the user wants an end.
pub(super) fn findings(
    case: &Case,
    How { args, size, floors, stop }: &How<'_>,
    progress: &mut Progress,
) -> Result<Option<Findings>, ReportError> {
    let mut silent = Progress::silent();
    let benches: Vec<Bench> = size
        .pixels
        .iter()
        .map(|&pixels| Bench::of(case.skin.scene, pixels, &mut silent))
        .collect::<Result<_, _>>()?;
    let judge = &benches[benches.len() - 1];
    // nets know the fabric: on other fingers they are judged by --denoise
    let nets = if case.is_fabric { nets(judge, &args.weights)? } else { Vec::new() };
    let (mut courses, mut failures, mut recordings) = (Vec::new(), Vec::new(), Vec::new());
    let recorded_now =
        if args.plans { Vec::new() } else { recorded((case, 0), judge, size, progress)? };
    for recording in recorded_now {
        let peers = args.peers.as_deref();
        let lane = Lane {
            benches: &benches,
            recording: &recording,
            size,
            floors,
            nets: &nets,
            peers,
            stop,
        };
        let Outcome { courses: found, failures: failed } =
            progress.steps("solvers", lane.solvers(), |bar| Ok::<_, ReportError>(lane.run(bar)))?;
        failures.extend(failed.into_iter().map(|(solver, why)| (solver, recording.shape, why)));
        courses.push(found);
        recordings.push(recording);
    }
    if stop.is_set() {
        return Ok(None);
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
        judge.skin().mesh.surface().nodes().len(),
        pixels = judge.raster.pixels(),
    );
    let pictures = plots::draw(case, (&rows, &note), judge, (&recordings, &courses))?;
    Ok(Some(Findings { case: *case, rows, failures, promises, pictures, note }))
}

/// The two recordings of a scene: soft and hard fingers, or one finger and two on the fabric. Each
/// `take` has its own paths and noise.
fn recorded(
    (case, take): (&Case, u64),
    judge: &Bench,
    size: &Size,
    progress: &mut Progress,
) -> Result<Vec<Recording>, ReportError> {
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
        let simulated = simulate(judge.skin(), &settings, &judge.raster, progress)?;
        let truth = judge.pixels_of(simulated.truth.view())?;
        Ok(Recording { shape, simulated, truth })
    };
    FingerShape::ALL.into_iter().map(of).collect()
}

/// The nets among `names` that were trained for this skin and raster. That the default one is for
/// another skin is no error; that one which was asked for is, is told by its absence.
fn nets(judge: &Bench, names: &[String]) -> Result<Vec<(String, Net)>, ReportError> {
    let mut nets = Vec::new();
    for name in names {
        let settings = DenoiseSettings { weights: name.clone(), any_skin: false };
        match Net::load(&settings, &judge.skin().net_target()) {
            Ok(net) => nets.push((net_name(name), net)),
            Err(error) if name != "default" && !std::path::Path::new(name).exists() => {
                return Err(error.into());
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
