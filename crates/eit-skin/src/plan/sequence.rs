//! The recording of a scene, as far as a plan has to know it.

use crate::frames::{self, Frames};
use crate::method::Method;
use crate::pipeline::{self, Setup};
use crate::progress::Progress;
use crate::scene::Scene;

/// Frames that a plan is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sequence {
    /// No recording that can be read.
    Unknown,
    /// So many.
    Frames(usize),
    /// So many that do not differ from each other beyond noise: total variation makes one of them.
    Still(usize),
}

/// The scene's recording, where it can be read. What is wrong with one is told by
/// `eit reconstruct`: a plan does without.
pub fn read(scene: &Scene, setup: &Setup, progress: &mut Progress) -> Option<Frames> {
    progress.stage("read frames", || frames::load(scene, &setup.protocol, &[], None)).ok()
}

impl Sequence {
    /// Looks whether the scene is static where the method cares and the noise is known.
    pub fn of(
        scene: &Scene,
        setup: &Setup,
        method: Method,
        recording: Option<&mut Frames>,
        progress: &mut Progress,
    ) -> Self {
        let Some(frames) = recording else { return Self::Unknown };
        let count = frames.values.nrows();
        let still = method.is_tv() && count > 1 && {
            let found = pipeline::linearise(scene, setup, progress)
                .and_then(|linearised| pipeline::tv::is_still(scene, setup, &linearised, frames));
            found.unwrap_or(false)
        };
        if still { Self::Still(count) } else { Self::Frames(count) }
    }

    /// Frames that are solved for; `None`: not known.
    pub fn solved(self) -> Option<usize> {
        match self {
            Self::Unknown => None,
            Self::Frames(count) => Some(count),
            Self::Still(_) => Some(1),
        }
    }
}
