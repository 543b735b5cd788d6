//! `eit report`: error against run time of every solver on every built-in scene, on this machine.
//!
//! A scene consists of a skin, two slowly moving fingers (once soft, once with a sharp edge) and
//! noise, or of fingers on the simulated fabric. Data are simulated on a finer mesh
//! than that of the reconstruction. A direct method gives one point; an iterative one gives a curve
//! over the target gaps, each from a cold start. The forward problem of every skin is solved on
//! many meshes; some skins are included only for that. Each time is accompanied by its floor: the
//! same work at this machine's best rates.
//!
//! The report is rewritten after every scene, so an interrupted run keeps the completed scenes.

mod budgets;
mod cases;
mod fabric;
mod forward;
mod image_plots;
mod image_tables;
mod images;
mod inverse;
mod merged;
mod named_net;
mod page;
mod picture;
mod recording;
mod results;
mod roofline;
mod settings;
mod table;
mod work_precision;

use crate::Answer;
use crate::error::ReportError;
use crate::output::OutFolder;
use crate::settings::ReportSettings;
use cases::{Case, Fingers, picture};
use eit_skin::plan::machine::Machine;
use eit_skin::{Progress, StopFlag};
use results::BenchmarkResults;
use roofline::Roofline;
use settings::{BenchmarkSettings, FULL, SHORT};

/// Files of a report beside its pictures.
const FILES: [&str; 6] =
    ["report.html", "report.md", "report.json", "incomplete.txt", "inverse.csv", "forward.csv"];

/// Simulates, runs every solver and draws; writes the report after each scene, and removes the files
/// of earlier reports that this one does not write.
///
/// # Errors
///
/// Settings that select no scene, weights that cannot be read, a folder that cannot be written to;
/// failures of solvers that the report needs.
pub fn run(
    report: &ReportSettings,
    stop: &StopFlag,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let size = if report.full { &FULL } else { &SHORT };
    let names: Vec<String> = FILES.into_iter().map(str::to_owned).chain(pictures()).collect();
    let scenes = cases::chosen(report)?;
    // reject a folder that cannot be written to before any work
    OutFolder::new(&report.out)?;
    let machine = progress.stage("this machine", || Ok::<_, ReportError>(Machine::measure()))?;
    let settings = BenchmarkSettings { report, size, roofline: &Roofline { machine }, stop };
    let (mut results, mut answer) = (BenchmarkResults::default(), None);
    for (number, scene) in scenes.iter().enumerate() {
        progress.group(format!("{} ({} of {})", scene.name, number + 1, scenes.len()));
        if !one(scene, &settings, &mut results, progress)? {
            return Err(interrupted(report, number, scenes.len()));
        }
        let missing: Vec<&str> = scenes[number + 1..].iter().map(|case| &*case.name).collect();
        let mut out = OutFolder::new(&report.out)?;
        answer = Some(page::write(&results, &settings, &missing, &mut out, progress)?);
        out.commit(&names.iter().map(String::as_str).collect::<Vec<_>>())?;
    }
    answer.ok_or_else(|| ReportError::input("--scenes selects no scene"))
}

/// Runs one scene; returns false, keeping nothing of the scene, if the user interrupts.
fn one(
    case: &Case,
    settings: &BenchmarkSettings<'_>,
    results: &mut BenchmarkResults,
    progress: &mut Progress,
) -> Result<bool, ReportError> {
    // scenes with the same skin share its forward problem
    let is_known = results.forward.iter().any(|known| known.case.scene == case.scene);
    let mut forward = None;
    if !(is_known || settings.report.images) {
        let found = progress.steps("forward problem", forward::steps(settings.size), |bar| {
            forward::run(case, settings, bar)
        })?;
        let Some(found) = found else { return Ok(false) };
        forward = Some(found);
    }
    let mut images = None;
    if case.fingers != Fingers::NoImages {
        let Some(found) = images::run(case, settings, progress)? else { return Ok(false) };
        images = Some(found);
    }
    results.forward.extend(forward);
    results.images.extend(images);
    Ok(true)
}

/// Error of a run interrupted after some of the requested scenes.
fn interrupted(report: &ReportSettings, finished: usize, wanted: usize) -> ReportError {
    ReportError::Failure(match finished {
        0 => "interrupted before the first scene was finished: nothing was written".to_owned(),
        _ => format!(
            "interrupted: {} contains the report of {finished} of {wanted} scenes, marked as incomplete",
            report.out.display()
        ),
    })
}

/// Names of the pictures of all built-in skins and scenes.
fn pictures() -> impl Iterator<Item = String> {
    Case::built_in().flat_map(|case| {
        let images = picture("images", &case.name);
        let shapes = ["bell", "pad", "one", "two"].map(|shape| format!("{images}_{shape}.png"));
        let [forward, error] = [("forward", case.skin()), ("error", &*case.name)]
            .map(|(kind, name)| format!("{}.png", picture(kind, name)));
        shapes.into_iter().chain([forward, error])
    })
}

#[cfg(test)]
mod tests {
    use super::cases::{Case, Fingers};
    use super::settings::GAPS;
    use eit_skin::method::Method;
    use eit_skin::plan::measured::{Table, Wanted};
    use eit_skin::scene::ReconstructionSettings;

    /// The table of plans comes from one full run of this report: every scene, method and gap.
    #[test]
    fn the_measured_table_is_whole_and_of_one_run() {
        let table = Table::load().unwrap();
        let settings = &ReconstructionSettings::default();
        let mut rates = Vec::new();
        for case in Case::built_in().filter(|case| case.fingers != Fingers::NoImages) {
            for method in Method::ALL {
                let sequence = matches!(method, Method::StTv | Method::TimePrior);
                if case.fingers == Fingers::Still && sequence {
                    continue;
                }
                for gap in GAPS {
                    let wanted = Wanted { method, settings, pixels: 64, target_gap: gap };
                    let row = table.of(&case.name, &wanted).unwrap();
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
