//! Error against run time: every solver on every built-in scene, measured now and here.
//!
//! A scene is a skin, two slowly moving fingers (once soft, once with an edge) and noise, or the
//! paper's experiments on the simulated fabric; simulated on a finer mesh, reconstructed on another.
//! A direct method is one point, an iterated one a curve over the gap it is run to from cold. Of every
//! skin, and of some for nothing else, the forward problem is run on many meshes. Beside each time
//! stands the floor: the same work at this machine's best rates.
//!
//! The report is written anew after every scene, so that a run that is ended leaves what it has.

mod best;
pub mod case;
mod fabric;
mod floor;
mod forward;
mod images;
mod inverse;
mod merged;
mod page;
mod peers;
mod plots;
mod point;
mod promise;
mod skins;
mod table;

use crate::Answer;
use crate::error::ReportError;
use crate::output::OutFolder;
use crate::settings::ReportSettings;
use crate::simulate::Simulated;
use eit_skin::Progress;
use eit_skin::StopFlag;
use eit_skin::plan::machine::Machine;
use floor::Floors;
use forward::ForwardCourse;
use images::Findings;
use ndarray::Array2;
use skins::Entry;

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
    /// Meshes of each family of the forward problem, every step finer by the root of two, and most
    /// runs on each.
    mesh_steps: &'static [i32],
    forward_runs: usize,
    /// Scales of the two meshes that stand for the truth where no series does, the finer one last.
    reference_scales: [f64; 2],
}

/// Gaps of a full run.
pub const GAPS: [f64; 4] = [3e-1, 1e-1, 1e-2, 1e-3];

const FULL: Size = Size {
    frames: 20,
    pixels: &[16, 32, 64],
    gaps: &GAPS,
    deadline_s: 20.0,
    runs: 3,
    repeat_below_s: 6.0,
    direct_runs: 15,
    stream_runs: 2,
    mesh_steps: &[0, 1, 2, 3, 4, 5, 6, 7],
    forward_runs: 9,
    reference_scales: [1.5, 1.0],
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
    mesh_steps: &[0, 2],
    forward_runs: 3,
    reference_scales: [3.0, 2.0],
};

/// A simulated recording and its truth.
pub(super) struct Recording {
    pub shape: &'static str,
    pub simulated: Simulated,
    /// Siemens, [frame, masked pixel] on the raster that judges.
    pub truth: Array2<f64>,
}

/// How the race is run.
struct How<'a> {
    args: &'a ReportSettings,
    size: &'a Size,
    floors: &'a Floors,
    /// Set when the user wants an end.
    stop: &'a StopFlag,
}

/// What is known so far.
#[derive(Default)]
struct Results {
    /// The forward problem of each skin.
    forward: Vec<ForwardCourse>,
    scenes: Vec<Findings>,
}

/// Simulates, runs every solver, draws; writes after each scene what there is.
pub(super) fn run(
    args: &ReportSettings,
    stop: &StopFlag,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let size = if args.quick { QUICK } else { FULL };
    let entries = skins::chosen(args)?;
    args.peers.as_deref().map_or(Ok(()), peers::check)?;
    // a folder that cannot be written to is refused before any work
    OutFolder::new(&args.out)?;
    let machine = progress.stage("this machine", || Ok::<_, ReportError>(Machine::measure()))?;
    let how = How { args, size: &size, floors: &Floors { machine }, stop };
    let (mut results, mut answer) = (Results::default(), None);
    for (number, entry) in entries.iter().enumerate() {
        progress.group(format!("{} ({} of {})", entry.name(), number + 1, entries.len()));
        if !one(entry, &how, &mut results, progress)? {
            return Err(interrupted(args, (number, entries.len())));
        }
        let missing: Vec<&str> = entries[number + 1..].iter().map(Entry::name).collect();
        let mut out = OutFolder::new(&args.out)?;
        answer = Some(page::write(&results, (&how, &missing), &mut out, progress)?);
        out.commit(&super::files())?;
    }
    answer.ok_or_else(|| ReportError::input("--scenes names no scene"))
}

/// One scene; false, and nothing kept of it, if the user wants an end.
fn one(
    entry: &Entry,
    how: &How<'_>,
    results: &mut Results,
    progress: &mut Progress,
) -> Result<bool, ReportError> {
    // scenes of one skin share its forward problem
    let is_known = results.forward.iter().any(|course| course.skin == entry.skin);
    let mut forward = None;
    if !(is_known || how.args.plans) {
        let course = progress.steps("forward problem", forward::steps(how.size), |bar| {
            forward::course(&entry.skin, how, bar)
        })?;
        let Some(course) = course else { return Ok(false) };
        forward = Some(course);
    }
    let mut images = None;
    if let Some(case) = &entry.case {
        let Some(findings) = images::findings(case, how, progress)? else { return Ok(false) };
        images = Some(findings);
    }
    results.forward.extend(forward);
    results.scenes.extend(images);
    Ok(true)
}

/// What is said when the user wants an end after some of the wanted scenes.
fn interrupted(args: &ReportSettings, (finished, wanted): (usize, usize)) -> ReportError {
    ReportError::Failure(match finished {
        0 => "interrupted before the first scene was finished: nothing is written".to_owned(),
        _ => format!(
            "interrupted: {} has the report of {finished} of {wanted} scenes and says that it is \
             incomplete",
            args.out.display()
        ),
    })
}

/// Names of the pictures of all skins and scenes.
pub(super) fn pictures() -> impl Iterator<Item = &'static str> {
    let of_scenes = case::CASES.into_iter().flat_map(|case| case.files);
    skins::SKINS.into_iter().map(|skin| skin.file).chain(of_scenes)
}

#[cfg(test)]
mod tests {
    use super::GAPS;
    use super::case::CASES;
    use eit_skin::method::Method;
    use eit_skin::plan::measured::{Table, Wanted};
    use eit_skin::scene::ReconstructionSettings;

    /// The table of plans is of one full run of this report: every scene, method and gap.
    #[test]
    fn the_measured_table_is_whole_and_of_one_run() {
        let table = Table::load().unwrap();
        let settings = &ReconstructionSettings::default();
        let mut rates = Vec::new();
        for case in CASES {
            for method in Method::ALL {
                let sequence = matches!(method, Method::StTv | Method::TimePrior | Method::Kalman);
                if case.is_still && sequence {
                    continue;
                }
                for gap in GAPS {
                    let wanted = Wanted { method, settings, pixels: 64, target_gap: gap };
                    let row = table.of(case.name, &wanted).unwrap();
                    assert!(row.relative_error > 0.0 && row.ms_a_frame > 0.0, "{row:?}");
                    assert!(row.pixels.is_none_or(|pixels| pixels == 64), "{row:?}");
                    assert!(row.target_gap.is_none_or(|own| own == gap), "{row:?}");
                    rates.push(row.machine_gflops);
                }
            }
        }
        assert!(rates.iter().all(|rate| *rate == rates[0]), "of several runs: {rates:?}");
    }
}
