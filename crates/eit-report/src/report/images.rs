//! The images of a scene: recordings, every solver on each, comparison with the plan, pictures.

use super::cases::{Case, FINGERS, Fingers};
use super::fabric::{self, FABRIC_SCRIPTS};
use super::image_plots;
use super::inverse::problem::InverseProblem;
use super::inverse::{self, SolverFailure};
use super::merged::{self, Merged};
use super::named_net::NamedNet;
use super::picture::Picture;
use super::recording::{RecordingResults, SimulatedRecording};
use super::settings::{BenchmarkSettings, Size};
use crate::comparison::ReconstructionModel;
use crate::comparison::{FingerShape, simulate};
use crate::error::ReportError;
use eit_skin::Progress;
use eit_skin::denoise::Net;
use eit_skin::plan::measured::Measured;
use eit_skin::scene::DenoiseSettings;
use serde::Serialize;

/// Results for the images of a scene.
pub(super) struct ImageResults {
    pub case: Case,
    pub rows: Vec<Measured>,
    pub failures: Vec<SolverFailure>,
    pub left_out: Vec<LeftOutNet>,
    pub pictures: Vec<Picture>,
    /// Description of noise, meshes and pixels.
    pub note: String,
}

/// A network that was asked for, but not for this skin and raster.
#[derive(Serialize)]
pub(super) struct LeftOutNet {
    #[serde(rename = "solver")]
    pub net: String,
    pub why: String,
}

/// Simulates, runs every solver and draws; `None` if the user interrupts.
pub(super) fn run(
    case: &Case,
    settings: &BenchmarkSettings<'_>,
    progress: &mut Progress,
) -> Result<Option<ImageResults>, ReportError> {
    let BenchmarkSettings { report, size, roofline, stop } = *settings;
    let mut silent = Progress::silent();
    let models: Vec<ReconstructionModel> = size
        .pixels
        .iter()
        .map(|&pixels| ReconstructionModel::new(&case.scene, pixels, &mut silent))
        .collect::<Result<_, _>>()?;
    let finest = &models[models.len() - 1];
    // networks are trained on the fabric
    let (nets, left_out) = match case.fingers {
        Fingers::Fabric => nets(finest, &report.weights)?,
        _ => (Vec::new(), Vec::new()),
    };
    let (mut recordings, mut failures) = (Vec::new(), Vec::new());
    for recording in recorded(case, finest, size, progress)? {
        let (models, nets) = (&models[..], &nets[..]);
        let problem = InverseProblem { models, recording: &recording, size, roofline, nets, stop };
        let curves = progress.steps("solvers", inverse::solvers(&problem), |bar| {
            Ok::<_, ReportError>(inverse::run(&problem, &mut failures, bar))
        })?;
        recordings.push(RecordingResults { recording, curves });
    }
    if stop.is_set() {
        return Ok(None);
    }
    let Some(RecordingResults { recording: shown, .. }) = recordings.first() else {
        return Err(ReportError::Failure("no recording was simulated".to_owned()));
    };
    let frames = shown.truth.nrows();
    let Merged { rows, missing } = merged::rows(case, frames, &recordings, &roofline.machine);
    failures.extend(missing.into_iter().map(|solver| SolverFailure {
        solver,
        shape: "one",
        why: "the other failed".to_owned(),
    }));
    let note = note(case, shown, finest);
    let pictures = image_plots::draw(case, &rows, &note, finest, &recordings)?;
    Ok(Some(ImageResults { case: case.clone(), rows, failures, left_out, pictures, note }))
}

/// Describes noise, meshes and pixels.
fn note(case: &Case, shown: &SimulatedRecording, finest: &ReconstructionModel) -> String {
    let touched = match case.fingers {
        Fingers::Fabric => "of one finger and of two".to_owned(),
        _ => format!("of {FINGERS} fingers, soft or hard, noise {} dB", case.noise_db),
    };
    format!(
        "{}: {}; {} frame{} {touched}; simulated on {} nodes, reconstructed on {}, evaluated on \
         {pixels} x {pixels} pixels",
        case.name,
        case.what,
        shown.truth.nrows(),
        if case.fingers == Fingers::Still { "" } else { "s" },
        shown.simulated.nodes,
        finest.skin().mesh.surface().nodes().len(),
        pixels = finest.raster.pixels(),
    )
}

/// Returns the two recordings of a scene: soft and hard fingers, or one and two fingers on the
/// fabric.
fn recorded(
    case: &Case,
    model: &ReconstructionModel,
    size: &Size,
    progress: &mut Progress,
) -> Result<Vec<SimulatedRecording>, ReportError> {
    if case.fingers == Fingers::Fabric {
        return FABRIC_SCRIPTS
            .iter()
            .map(|script| fabric::recording(model, script, size.frames, progress))
            .collect();
    }
    let of = |finger: FingerShape| {
        let settings = case.sequence(finger, size.frames);
        let simulated = simulate(model.skin(), &settings, &model.raster, progress)?;
        let truth = model.pixels_of(simulated.truth.view())?;
        Ok(SimulatedRecording { shape: finger.name(), simulated, truth })
    };
    FingerShape::ALL.into_iter().map(of).collect()
}

/// Loads the networks among `names` that were trained for this skin and raster, and states why the
/// others are left out; only a missing file is an error.
fn nets(
    model: &ReconstructionModel,
    names: &[String],
) -> Result<(Vec<NamedNet>, Vec<LeftOutNet>), ReportError> {
    let (mut nets, mut left_out) = (Vec::new(), Vec::new());
    for name in names {
        let settings = DenoiseSettings { weights: name.clone(), any_skin: false };
        match Net::load(&settings, &model.skin().net_target()) {
            Ok(net) => nets.push(NamedNet { name: net_name(name), net }),
            Err(error) if name != "default" && !std::path::Path::new(name).exists() => {
                return Err(error.into());
            }
            Err(error) => {
                left_out.push(LeftOutNet { net: net_name(name), why: error.to_string() });
            }
        }
    }
    Ok((nets, left_out))
}

/// Returns "U-net", with the name of its file if it has one.
fn net_name(name: &str) -> String {
    let stem = std::path::Path::new(name).file_stem().map(|stem| stem.to_string_lossy());
    match stem {
        Some(stem) if name != "default" => format!("U-net {stem}"),
        _ => "U-net".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_default(pixels: usize) -> (Vec<NamedNet>, Vec<LeftOutNet>) {
        let model =
            ReconstructionModel::new("paper-disc", pixels, &mut Progress::silent()).unwrap();
        nets(&model, &["default".to_owned()]).unwrap()
    }

    /// The shipped network fits the skin and the raster of the full report, so its rows cannot vanish from it.
    #[test]
    fn the_default_net_is_for_the_papers_disc_at_64_pixels() {
        let (nets, left_out) = of_default(64);
        let whys: Vec<&str> = left_out.iter().map(|net| net.why.as_str()).collect();
        assert_eq!(whys, [""; 0]);
        assert_eq!(nets.iter().map(|net| net.name.as_str()).collect::<Vec<_>>(), ["U-net"]);
    }

    /// On the raster of the quick report it cannot run; the report says so, with both sizes.
    #[test]
    fn a_net_for_another_raster_is_left_out_with_the_reason() {
        let (nets, left_out) = of_default(32);
        assert!(nets.is_empty());
        let [LeftOutNet { net, why }] = &left_out[..] else {
            panic!("{} left out", left_out.len())
        };
        assert_eq!(net, "U-net");
        assert!(why.contains("32") && why.contains("64"), "{why}");
    }

    /// A file that does not exist is an error, not a network left out.
    #[test]
    fn a_missing_file_is_an_error() {
        let model = ReconstructionModel::new("paper-disc", 32, &mut Progress::silent()).unwrap();
        let error = nets(&model, &["no/such/net.safetensors".to_owned()]).err().unwrap();
        assert!(error.to_string().contains("no/such/net.safetensors"), "{error}");
    }
}
