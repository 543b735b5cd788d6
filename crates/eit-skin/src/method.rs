//! Chooses the reconstruction method: the one requested, or the one that suits the scene.

use crate::error::SkinError;
use crate::scene::StageSettings;
use eit_core::event;

/// A reconstruction method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Method {
    /// Total variation in space and time.
    StTv,
    /// Total variation in space, frame by frame.
    Tv,
    /// One-step difference reconstruction.
    GaussNewton,
    /// One-step difference reconstruction of the whole sequence, with correlation in time.
    TimePrior,
    /// Iterative reconstruction with the non-linear model.
    GaussNewtonAbsolute,
}

impl Method {
    /// All methods, in the order of the documentation.
    pub const ALL: [Self; 5] =
        [Self::StTv, Self::Tv, Self::GaussNewton, Self::TimePrior, Self::GaussNewtonAbsolute];

    /// Returns the name used in scene files.
    pub fn name(self) -> &'static str {
        match self {
            Self::StTv => "st-tv",
            Self::Tv => "tv",
            Self::GaussNewton => "gauss-newton",
            Self::TimePrior => "time-prior",
            Self::GaussNewtonAbsolute => "gauss-newton-absolute",
        }
    }

    /// Describes the method in a few words, such as for a caption.
    pub fn description(self) -> &'static str {
        match self {
            Self::StTv => "spatio-temporal total variation",
            Self::Tv => "total variation frame by frame",
            Self::GaussNewton => "one-step Gauss-Newton",
            Self::TimePrior => "one-step Gauss-Newton with a prior in time",
            Self::GaussNewtonAbsolute => "iterated absolute Gauss-Newton",
        }
    }

    /// Returns whether the method minimises total variation.
    pub fn is_tv(self) -> bool {
        matches!(self, Self::StTv | Self::Tv)
    }

    /// Parses a name; `key` tells where it comes from.
    ///
    /// # Errors
    ///
    /// An unknown name, with the known ones.
    pub(crate) fn parse(key: &str, name: &str) -> Result<Self, SkinError> {
        Self::ALL.into_iter().find(|m| m.name() == name).ok_or_else(|| {
            SkinError::input(format!("{key} = \"{name}\": the methods are {}", Self::names()))
        })
    }

    /// The known names, for messages.
    fn names() -> String {
        Self::ALL.map(|m| format!("\"{}\"", m.name())).join(", ")
    }
}

/// A method and the reason for choosing it.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct MethodChoice {
    /// The method to use.
    pub method: Method,
    /// Reason for the choice.
    pub why: &'static str,
}

/// Chooses the method: that of the command line, else that of the scene, else the one that suits the scene's
/// keys, its noise and the number of frames (if known).
///
/// Without noise stated in the scene, total variation is not chosen, even if the reference frames show noise:
/// its weights follow from the noise, so the user should have checked it.
///
/// # Errors
///
/// An unknown method name.
pub fn choose(
    settings: &StageSettings,
    flag: Option<&str>,
    frames: Option<usize>,
) -> Result<MethodChoice, SkinError> {
    let keys = &settings.reconstruction;
    let chosen = |method: Method, why| {
        event!(INFO, "chose the method", method = method.name(), why = why);
        Ok(MethodChoice { method, why })
    };
    if let Some(name) = flag {
        let method = Method::ALL.into_iter().find(|method| method.name() == name);
        let method = method.ok_or_else(|| {
            SkinError::argument(
                "method",
                format!("\"{name}\": the methods are {}", Method::names()),
            )
        })?;
        return chosen(method, "requested");
    }
    if let Some(name) = &keys.method {
        let why = match keys.is_chosen_in_time {
            true => "the smallest error within frame_time_s",
            false => "stated in the scene",
        };
        return chosen(Method::parse("reconstruction.method", name)?, why);
    }
    let noise = settings.noise.additive_v.is_some() || settings.noise.quiet_frames.is_some();
    let total_variation = keys.keys_of_tv().chain(keys.bounds()).next().is_some();
    if !total_variation && keys.keys_of_gauss_newton().next().is_some() {
        return chosen(Method::GaussNewton, "the scene sets its keys");
    }
    match (total_variation, noise, frames) {
        (false, false, _) => chosen(
            Method::GaussNewton,
            "the scene states no noise ([noise] additive_v or quiet_frames), from which the weights of \
             st-tv follow",
        ),
        (_, _, Some(1)) => chosen(Method::Tv, "one frame: nothing to couple in time"),
        (true, ..) => chosen(Method::StTv, "the scene sets its keys"),
        (false, true, _) => chosen(Method::StTv, "the scene states its noise"),
    }
}
