//! Which method reconstructs: the one that is asked for, or the one that the scene calls for.

use crate::error::SkinError;
use crate::scene::StageSettings;

/// A method of reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Total variation in space and time.
    StTv,
    /// Total variation in space, each frame by itself.
    Tv,
    /// One-step difference.
    GaussNewton,
    /// One-step difference of the whole sequence, correlated in time.
    TimePrior,
    /// Kalman smoother.
    Kalman,
    /// Iterated on the non-linear model.
    GaussNewtonAbsolute,
}

impl Method {
    /// All, in the order of the documents.
    pub const ALL: [Self; 6] = [
        Self::StTv,
        Self::Tv,
        Self::GaussNewton,
        Self::TimePrior,
        Self::Kalman,
        Self::GaussNewtonAbsolute,
    ];

    /// As in the scene file.
    pub fn name(self) -> &'static str {
        match self {
            Self::StTv => "st-tv",
            Self::Tv => "tv",
            Self::GaussNewton => "gauss-newton",
            Self::TimePrior => "time-prior",
            Self::Kalman => "kalman",
            Self::GaussNewtonAbsolute => "gauss-newton-absolute",
        }
    }

    /// For small print.
    pub fn words(self) -> &'static str {
        match self {
            Self::StTv => "spatio-temporal total variation",
            Self::Tv => "total variation frame by frame",
            Self::GaussNewton => "one-step Gauss-Newton",
            Self::TimePrior => "one-step Gauss-Newton with a prior in time",
            Self::Kalman => "Kalman smoother",
            Self::GaussNewtonAbsolute => "iterated absolute Gauss-Newton",
        }
    }

    /// Whether it minimises a total variation.
    pub fn is_tv(self) -> bool {
        matches!(self, Self::StTv | Self::Tv)
    }

    /// Reads a name; `key` says where it stands.
    pub fn parse(key: &str, name: &str) -> Result<Self, SkinError> {
        Self::ALL.into_iter().find(|m| m.name() == name).ok_or_else(|| {
            let names = Self::ALL.map(|m| format!("\"{}\"", m.name())).join(", ");
            SkinError::input(format!("{key} = \"{name}\": the methods are {names}"))
        })
    }
}

/// A method and why it was taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MethodChoice {
    /// The method.
    pub method: Method,
    /// Why it was taken.
    pub why: &'static str,
}

/// The method of the command line, or of the scene, or the one that the scene's keys, its noise
/// and the number of frames (where it is known) call for.
///
/// Noise that the scene does not state is no reason for a total variation, even if the reference
/// frames show some: its weights follow from the noise, so the user should have looked at it.
///
/// # Errors
///
/// A name that is no method's.
pub fn choose(
    settings: &StageSettings,
    flag: Option<&str>,
    frames: Option<usize>,
) -> Result<MethodChoice, SkinError> {
    let keys = &settings.reconstruction;
    let taken = |method, why| Ok(MethodChoice { method, why });
    if let Some(name) = flag {
        return taken(Method::parse("--method", name)?, "asked for");
    }
    if let Some(name) = &keys.method {
        let why = match keys.is_chosen_in_time {
            true => "the least error within frame_time_s",
            false => "stated in the scene",
        };
        return taken(Method::parse("reconstruction.method", name)?, why);
    }
    let noise = settings.noise.additive_v.is_some() || settings.noise.quiet_frames.is_some();
    let total_variation = keys.keys_of_tv().chain(keys.bounds()).next().is_some();
    if !total_variation && keys.keys_of_gauss_newton().next().is_some() {
        return taken(Method::GaussNewton, "the scene sets its keys");
    }
    match (total_variation, noise, frames) {
        (false, false, _) => taken(
            Method::GaussNewton,
            "the scene states no noise ([noise] additive_v or quiet_frames), which the weights of \
             st-tv follow from",
        ),
        (_, _, Some(1)) => taken(Method::Tv, "one frame: nothing to couple in time"),
        (true, ..) => taken(Method::StTv, "the scene sets its keys"),
        (false, true, _) => taken(Method::StTv, "the scene states its noise"),
    }
}
