//! What a plan needs to know about the recording of a scene.

use crate::frames::Frames;
use crate::method::Method;
use crate::progress::Progress;
use crate::skin::Skin;
use std::sync::Arc;

/// Frames that a plan is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Sequence {
    /// No readable recording.
    Unknown,
    /// A sequence of known length.
    Frames(usize),
    /// This number of frames without differences beyond noise: total variation averages them into one.
    Still(usize),
}

/// Reads the skin's recording if possible. Errors are ignored here, because the plan does not require it and
/// a reconstruction reports them.
pub(crate) fn read(skin: &Skin, progress: &mut Progress) -> Option<Frames> {
    progress.stage("read frames", || skin.read_frames(&[], None)).ok()
}

impl Sequence {
    /// Checks whether the scene is static, if the method makes use of that and the noise is known.
    pub(crate) fn of(
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

    /// Returns the number of frames solved for; `None` if unknown.
    pub(crate) fn solved(self) -> Option<usize> {
        match self {
            Self::Unknown => None,
            Self::Frames(count) => Some(count),
            Self::Still(_) => Some(1),
        }
    }
}
