//! The recording of a scene, as far as a plan has to know it.

use crate::frames::Frames;
use crate::method::Method;
use crate::progress::Progress;
use crate::skin::Skin;
use std::sync::Arc;

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

/// The skin's recording, where it can be read. What is wrong with one is told by a reconstruction: a
/// plan does without.
pub fn read(skin: &Skin, progress: &mut Progress) -> Option<Frames> {
    progress.stage("read frames", || skin.read_frames(&[], None)).ok()
}

impl Sequence {
    /// Looks whether the scene is static where the method cares and the noise is known.
    pub fn of(
        skin: &Skin,
        method: Method,
        recording: Option<Frames>,
        progress: &mut Progress,
    ) -> Self {
        let Some(frames) = recording else { return Self::Unknown };
        let count = frames.values.nrows();
        let still = method.is_tv() && count > 1 && {
            let linearised = skin.linearise(progress).map(Arc::new);
            let fitted = linearised.and_then(|linearised| linearised.fit(frames));
            fitted.and_then(|fitted| fitted.is_still()).unwrap_or(false)
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
