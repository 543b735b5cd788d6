//! The scenes of the benchmark: a skin whose forward problem is solved, with or without images.

use super::forward_cases::{FORWARD_CASES, ForwardCase};
use super::image_cases::{IMAGE_CASES, ImageCase};
use crate::error::ReportError;
use crate::settings::ReportSettings;

/// A scene of the benchmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BenchmarkScene {
    /// Its skin.
    pub forward: ForwardCase,
    /// Its images; `None` for a skin that only adds a shape.
    pub images: Option<ImageCase>,
}

impl BenchmarkScene {
    /// Key in output files.
    pub fn name(&self) -> &'static str {
        self.images.map_or(self.forward.scene, |case| case.name)
    }
}

/// Returns all scenes, those with images first.
fn all() -> Vec<BenchmarkScene> {
    let imaged = |case: ImageCase| BenchmarkScene { forward: case.forward, images: Some(case) };
    let is_imaged = |forward: &ForwardCase| IMAGE_CASES.iter().any(|case| case.forward == *forward);
    let others = FORWARD_CASES.into_iter().filter(|forward| !is_imaged(forward));
    let of_shape = |forward| BenchmarkScene { forward, images: None };
    IMAGE_CASES.into_iter().map(imaged).chain(others.map(of_shape)).collect()
}

/// Returns the scenes named on the command line (all if none are), restricted to what the command
/// requests.
pub(super) fn chosen(settings: &ReportSettings) -> Result<Vec<BenchmarkScene>, ReportError> {
    let all = all();
    let find = |name: &String| {
        all.iter().find(|scene| scene.name() == name).copied().ok_or_else(|| {
            let known: Vec<&str> = all.iter().map(BenchmarkScene::name).collect();
            ReportError::input(format!("--scenes {name}: the scenes are {}", known.join(", ")))
        })
    };
    let mut scenes = match settings.scenes.is_empty() {
        true => all.clone(),
        false => settings.scenes.iter().map(find).collect::<Result<_, _>>()?,
    };
    if settings.plans || settings.images {
        // a plan predicts images
        scenes.retain(|scene| scene.images.is_some());
        if scenes.is_empty() {
            let names = settings.scenes.join(", ");
            return Err(ReportError::input(match settings.plans {
                true => format!(
                    "--plans: the report has no images of {names}, so it cannot compare a plan with them"
                ),
                false => format!("--images: the report has no images of {names}"),
            }));
        }
    }
    if settings.forward {
        let mut skins: Vec<BenchmarkScene> = Vec::new();
        for BenchmarkScene { forward, .. } in scenes {
            if skins.iter().all(|known| known.forward != forward) {
                skins.push(BenchmarkScene { forward, images: None });
            }
        }
        return Ok(skins);
    }
    Ok(scenes)
}
