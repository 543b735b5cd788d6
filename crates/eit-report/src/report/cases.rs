//! The scenes of the report: a skin whose forward problem is solved, with or without images of touches.

use crate::comparison::{Finger, FingerShape, SLOW_M, SequenceSettings};
use crate::error::ReportError;
use crate::settings::ReportSettings;
use eit_skin::Scene;
use std::path::Path;

/// A skin and the conductivity used for its forward problem.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ForwardCase {
    /// Name of a built-in scene, or a scene file.
    pub scene: String,
    /// Name in output files.
    pub name: String,
    /// What distinguishes it.
    pub what: String,
    /// Relative change of conductivity under two soft fingers; `None` if nothing touches the skin.
    pub change: Option<f64>,
}

/// What touches a skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fingers {
    /// A sequence of two slow fingers.
    Moving,
    /// Two fingers in a single frame.
    Still,
    /// The paper's experiments on the simulated fabric, which determines noise and change.
    Fabric,
}

/// A scene whose images are compared.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ImageCase {
    /// Name in output files.
    pub name: String,
    /// Name of a built-in scene, or a scene file.
    pub scene: String,
    /// What distinguishes it.
    pub what: String,
    /// Noise, decibels below the voltages.
    pub noise_db: f64,
    /// Relative change of conductivity at the centre of a finger.
    pub change: f64,
    pub fingers: Fingers,
}

/// A scene of the report.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReportScene {
    pub forward: ForwardCase,
    /// `None` for a skin that only adds a shape.
    pub images: Option<ImageCase>,
}

/// Built-in skins: scene, what distinguishes it, change of conductivity in the forward problem.
const SKINS: [(&str, &str, Option<f64>); 8] = [
    ("paper-disc", "the paper's skin", None),
    ("stiff-contact", "contact impedances over nine decades", None),
    (
        "high-contrast",
        "conductivity up to eleven times higher under two soft fingers, one value per element",
        Some(10.0),
    ),
    ("general-32", "32 electrodes, currents on all of them at once", None),
    ("single-frame", "the paper's skin, currents through opposite electrodes", None),
    ("plate-with-hole", "corners, a hole, electrodes of two widths on both rims", None),
    ("patches", "16 round patches inside the skin", None),
    ("hemisphere", "a dome with the paper's electrodes on its rim", None),
];

/// Images of built-in skins: name, scene, what distinguishes it, noise in decibels, change under a
/// finger.
const IMAGES: [(&str, &str, &str, f64, f64, Fingers); 7] = [
    (
        "paper-disc-60",
        "paper-disc",
        "the paper's skin, a good instrument",
        60.0,
        0.5,
        Fingers::Moving,
    ),
    (
        "paper-disc-40",
        "paper-disc",
        "the paper's skin, a poor instrument",
        40.0,
        0.5,
        Fingers::Moving,
    ),
    (
        "paper-fabric",
        "paper-disc",
        "the paper's experiments on the simulated fabric: electrodes move with the finger",
        f64::NAN,
        f64::NAN,
        Fingers::Fabric,
    ),
    (
        "stiff-contact",
        "stiff-contact",
        "contact impedances over nine decades",
        60.0,
        0.5,
        Fingers::Moving,
    ),
    (
        "high-contrast",
        "high-contrast",
        "conductivity up to eleven times higher under a finger",
        60.0,
        10.0,
        Fingers::Moving,
    ),
    (
        "general-32",
        "general-32",
        "32 electrodes, currents on all of them at once",
        60.0,
        0.5,
        Fingers::Moving,
    ),
    ("single-frame", "single-frame", "one frame, nothing in time", 60.0, 0.5, Fingers::Still),
];

/// Number of fingers on every skin.
pub(super) const FINGERS: usize = 2;

/// The first part of a picture's file name, and the scene's.
pub(super) fn picture(kind: &str, name: &str) -> String {
    format!("{kind}_{}", name.replace('-', "_"))
}

impl ImageCase {
    /// Settings of the sequence for one shape of finger.
    pub(super) fn sequence(&self, shape: FingerShape, frames: usize) -> SequenceSettings {
        SequenceSettings {
            touches: FINGERS,
            frames: if self.fingers == Fingers::Still { 1 } else { frames },
            step_m: SLOW_M,
            finger: Finger { shape, change: self.change, ..Default::default() },
            noise_db: self.noise_db,
            ..Default::default()
        }
    }

    /// All built-in ones, starting with the paper's.
    pub(super) fn built_in() -> Vec<Self> {
        let of = |(name, scene, what, noise_db, change, fingers): (&str, &str, &str, _, _, _)| {
            let [name, scene, what] = [name, scene, what].map(str::to_owned);
            Self { name, scene, what, noise_db, change, fingers }
        };
        IMAGES.into_iter().map(of).collect()
    }
}

impl ForwardCase {
    /// All built-in ones, starting with the paper's.
    pub(super) fn built_in() -> Vec<Self> {
        let of = |(scene, what, change): (&str, &str, _)| {
            let [scene, what] = [scene, what].map(str::to_owned);
            Self { name: scene.clone(), scene, what, change }
        };
        SKINS.into_iter().map(of).collect()
    }
}

impl ReportScene {
    /// Name in output files.
    pub(super) fn name(&self) -> &str {
        self.images.as_ref().map_or(&self.forward.name, |case| &case.name)
    }

    /// All built-in scenes, those with images first.
    fn built_in() -> Vec<Self> {
        let (skins, images) = (ForwardCase::built_in(), ImageCase::built_in());
        let is_imaged = |skin: &ForwardCase| images.iter().any(|case| case.scene == skin.scene);
        let others: Vec<Self> = skins
            .iter()
            .filter(|skin| !is_imaged(skin))
            .map(|skin| Self { forward: skin.clone(), images: None })
            .collect();
        let imaged = images.into_iter().filter_map(|case| {
            let forward = skins.iter().find(|skin| skin.scene == case.scene)?.clone();
            Some(Self { forward, images: Some(case) })
        });
        imaged.chain(others).collect()
    }

    /// A scene file: two fingers that raise the conductivity by half, noise of 60 dB.
    fn of_file(file: &str) -> Result<Self, ReportError> {
        Scene::load(file)?.check_stages()?;
        let name = Path::new(file).file_stem().map_or(file.into(), |stem| stem.to_string_lossy());
        let (name, scene) = (name.into_owned(), file.to_owned());
        let images = ImageCase {
            name: name.clone(),
            scene: scene.clone(),
            what: file.to_owned(),
            noise_db: 60.0,
            change: 0.5,
            fingers: Fingers::Moving,
        };
        let forward = ForwardCase { scene, name, what: file.to_owned(), change: None };
        Ok(Self { forward, images: Some(images) })
    }
}

/// Returns the scenes named on the command line (all built-in ones if none are), restricted to what the
/// command requests.
pub(super) fn chosen(settings: &ReportSettings) -> Result<Vec<ReportScene>, ReportError> {
    let built_in = ReportScene::built_in();
    let find = |name: &String| {
        if let Some(scene) = built_in.iter().find(|scene| scene.name() == name) {
            return Ok(scene.clone());
        }
        if name.ends_with(".toml") {
            return ReportScene::of_file(name);
        }
        let known: Vec<&str> = built_in.iter().map(ReportScene::name).collect();
        let known = known.join(", ");
        Err(ReportError::input(format!(
            "--scenes {name}: the scenes are {known}, or a file F.toml"
        )))
    };
    let mut scenes = match settings.scenes.is_empty() {
        true => built_in.clone(),
        false => settings.scenes.iter().map(find).collect::<Result<_, _>>()?,
    };
    if settings.images {
        scenes.retain(|scene| scene.images.is_some());
        if scenes.is_empty() {
            let names = settings.scenes.join(", ");
            return Err(ReportError::input(format!(
                "--images: the report has no images of {names}"
            )));
        }
    }
    if settings.forward {
        let mut skins: Vec<ReportScene> = Vec::new();
        for ReportScene { forward, .. } in scenes {
            if skins.iter().all(|known| known.forward != forward) {
                skins.push(ReportScene { forward, images: None });
            }
        }
        return Ok(skins);
    }
    Ok(scenes)
}
