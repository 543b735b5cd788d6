//! The scenes of the report: a skin whose forward problem is solved, and what touches it in images.

use crate::comparison::{Finger, FingerShape, SLOW_M, SequenceSettings};
use crate::error::ReportError;
use crate::settings::ReportSettings;
use Fingers::{Fabric, Moving, NoImages, Still};
use eit_skin::Scene;
use std::path::Path;

/// What touches a skin in its images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fingers {
    /// A sequence of two slow fingers.
    Moving,
    /// Two fingers in a single frame.
    Still,
    /// One and two fingers on the simulated fabric, which determines noise and change.
    Fabric,
    /// No images: the skin only adds a shape to the forward problems.
    NoImages,
}

/// A scene of the report.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Case {
    /// Name in output files.
    pub name: String,
    /// Name of a built-in scene, or a scene file.
    pub scene: String,
    /// What distinguishes it.
    pub what: String,
    pub fingers: Fingers,
    /// Noise, decibels below the voltages.
    pub noise_db: f64,
    /// Relative change of conductivity at the centre of a finger.
    pub change: f64,
}

/// Built-in scenes: name, scene, what distinguishes it, fingers, noise, change.
const BUILT_IN: [(&str, &str, &str, Fingers, f64, f64); 10] = [
    ("paper-disc-60", "paper-disc", "the paper's skin, a good instrument", Moving, 60.0, 0.5),
    ("paper-disc-40", "paper-disc", "the paper's skin, a poor instrument", Moving, 40.0, 0.5),
    ("paper-fabric", "paper-disc", "simulated fabric, electrodes move with it", Fabric, 0.0, 0.0),
    ("stiff-contact", "stiff-contact", "contacts over nine decades", Moving, 60.0, 0.5),
    ("high-contrast", "high-contrast", "up to eleven times higher", Moving, 60.0, 10.0),
    ("general-32", "general-32", "32 electrodes, currents on all at once", Moving, 60.0, 0.5),
    ("single-frame", "single-frame", "one frame, nothing in time", Still, 60.0, 0.5),
    ("plate-with-hole", "plate-with-hole", "corners, a hole, two rims", NoImages, 60.0, 0.5),
    ("patches", "patches", "16 round patches inside the skin", NoImages, 60.0, 0.5),
    ("hemisphere", "hemisphere", "a dome, electrodes on its rim", NoImages, 60.0, 0.5),
];

/// Number of fingers on every skin.
pub(super) const FINGERS: usize = 2;

/// File name of a picture without its ending.
pub(super) fn picture(kind: &str, name: &str) -> String {
    format!("{kind}_{}", name.replace('-', "_"))
}

impl Case {
    /// All built-in ones, starting with the paper's.
    pub(super) fn built_in() -> impl Iterator<Item = Self> {
        BUILT_IN.into_iter().map(|(name, scene, what, fingers, noise_db, change)| {
            let [name, scene, what] = [name, scene, what].map(str::to_owned);
            Self { name, scene, what, fingers, noise_db, change }
        })
    }

    /// A scene file: two fingers that raise the conductivity by half, noise of 60 dB.
    fn of_file(file: &str) -> Result<Self, ReportError> {
        Scene::load(file)?.check_stages()?;
        let name = Path::new(file).file_stem().map_or(file.into(), |stem| stem.to_string_lossy());
        let [scene, what] = [file, file].map(str::to_owned);
        let name = name.into_owned();
        Ok(Self { name, scene, what, fingers: Moving, noise_db: 60.0, change: 0.5 })
    }

    /// Name of its skin, which several scenes may share.
    pub(super) fn skin(&self) -> &str {
        if self.scene.ends_with(".toml") { &self.name } else { &self.scene }
    }

    /// Change of conductivity under two soft fingers in the forward problem, where it is larger than
    /// the conductivity itself; elsewhere nothing touches the skin.
    pub(super) fn forward_change(&self) -> Option<f64> {
        (self.change > 1.0).then_some(self.change)
    }

    /// Settings of the sequence for one shape of finger.
    pub(super) fn sequence(&self, shape: FingerShape, frames: usize) -> SequenceSettings {
        SequenceSettings {
            touches: FINGERS,
            frames: if self.fingers == Still { 1 } else { frames },
            step_m: SLOW_M,
            finger: Finger { shape, change: self.change, ..Default::default() },
            noise_db: self.noise_db,
            ..Default::default()
        }
    }
}

/// Returns the scenes named on the command line (all built-in ones if none are), restricted to what the
/// command requests.
pub(super) fn chosen(settings: &ReportSettings) -> Result<Vec<Case>, ReportError> {
    let find = |name: &String| match Case::built_in().find(|case| case.name == *name) {
        Some(case) => Ok(case),
        None if name.ends_with(".toml") => Case::of_file(name),
        None => {
            let known: Vec<&str> = BUILT_IN.iter().map(|case| case.0).collect();
            let known = known.join(", ");
            Err(ReportError::input(format!(
                "--scenes {name}: the scenes are {known}, or a file F.toml"
            )))
        }
    };
    let mut cases: Vec<Case> = match settings.scenes.is_empty() {
        true => Case::built_in().collect(),
        false => settings.scenes.iter().map(find).collect::<Result<_, _>>()?,
    };
    if settings.images {
        cases.retain(|case| case.fingers != NoImages);
        if cases.is_empty() {
            let names = settings.scenes.join(", ");
            return Err(ReportError::input(format!(
                "--images: the report has no images of {names}"
            )));
        }
    }
    if settings.forward {
        let all = std::mem::take(&mut cases);
        for case in all {
            if cases.iter().all(|known| known.scene != case.scene) {
                cases.push(Case { name: case.skin().to_owned(), fingers: NoImages, ..case });
            }
        }
    }
    Ok(cases)
}
