//! Errors: one line that says what, where and how to mend it.

use eit_denoise::DenoiseError;
use eit_fem::FemError;
use eit_hw::HwError;
use eit_inverse::InverseError;
use eit_mesh::MeshError;
use std::path::Path;

/// Why something about a skin failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SkinError {
    /// An error and its place: a file, a scene, a frame.
    #[error("{place}: {source}")]
    Within {
        /// Where.
        place: String,
        /// What.
        source: Box<SkinError>,
    },
    /// A setting outside its range.
    #[error("{key} is {value}: it must be {must}")]
    OutOfRange {
        /// Key of the scene.
        key: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// Two settings that cannot be together.
    #[error("{one} and {other} exclude each other: keep one")]
    Exclusive {
        /// Key of the scene.
        one: &'static str,
        /// The other.
        other: &'static str,
    },
    /// A setting that would silently have no effect.
    #[error("{key} has no effect {because}")]
    NoEffect {
        /// Key of the scene.
        key: String,
        /// "without ..." or "with ...".
        because: String,
    },
    /// A setting that is needed.
    #[error("{key} is missing: {why} needs it")]
    Missing {
        /// Key of the scene.
        key: String,
        /// What needs it.
        why: String,
    },
    /// A list of another length than the electrodes.
    #[error("{key} has {found} values for {electrodes} electrodes: give one number or one each")]
    WrongCount {
        /// Key of the scene.
        key: String,
        /// Values that it has.
        found: usize,
        /// Electrodes of the skin.
        electrodes: usize,
    },
    /// A frame of another length than the protocol.
    #[error(
        "a frame of {values} values with {flags} flags, but the protocol has {measurements} \
         measurements"
    )]
    FrameLength {
        /// Values of the frame.
        values: usize,
        /// Quality flags of the frame.
        flags: usize,
        /// Measurements of the protocol.
        measurements: usize,
    },
    /// A list of another length than the protocol.
    #[error("{what} has {found} values, but the protocol has {measurements} measurements")]
    MeasurementCount {
        /// Which list.
        what: &'static str,
        /// Values that it has.
        found: usize,
        /// Measurements of the protocol.
        measurements: usize,
    },
    /// An electrode that the skin does not have.
    #[error("electrode {electrode}, counted from 0, of a skin with {electrodes} electrodes")]
    NoSuchElectrode {
        /// Its number, from 0.
        electrode: usize,
        /// Electrodes of the skin.
        electrodes: usize,
    },
    /// Frames that the recording does not have.
    #[error("{what}: the recording has frames 0 to {last}")]
    NoSuchFrame {
        /// What asked for them.
        what: String,
        /// Last frame of the recording.
        last: usize,
    },
    /// Arrays beyond memory.
    #[error("{what} take {gigabytes:.0} GB: {advice}")]
    TooLarge {
        /// Which.
        what: String,
        /// Their size.
        gigabytes: f64,
        /// How to make them smaller.
        advice: &'static str,
    },
    /// Rounding may have cost all digits of the voltages.
    #[error(
        "no digit of the voltages is certain: conductances on this skin span {decades:.0} decades \
         (contact impedances times conductivity against element size, or contrast); bring them \
         nearer to each other"
    )]
    NoCertainDigit {
        /// Powers of ten between the smallest and the largest conductance.
        decades: f64,
    },
    /// Noise that is needed and neither stated nor measured.
    #[error("{who} needs the noise: state [noise] additive_v or quiet_frames")]
    UnknownNoise {
        /// What needs it.
        who: &'static str,
    },
    /// Settings or data that do not fit together; the message names them.
    #[error("{0}")]
    Input(String),
    /// Everything was right and it still failed.
    #[error("{0}")]
    Failure(String),
    /// Of a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Of the forward model.
    #[error(transparent)]
    Fem(#[from] FemError),
    /// Of a reconstruction.
    #[error(transparent)]
    Inverse(#[from] InverseError),
    /// Of an instrument or a recording.
    #[error(transparent)]
    Hw(#[from] HwError),
    /// Of a U-net.
    #[error(transparent)]
    Denoise(#[from] DenoiseError),
}

impl SkinError {
    /// Bad input.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    /// Refuses a list that has not one value for each measurement.
    pub(crate) fn check_measurements(
        what: &'static str,
        found: usize,
        measurements: usize,
    ) -> Result<(), Self> {
        match found == measurements {
            true => Ok(()),
            false => Err(Self::MeasurementCount { what, found, measurements }),
        }
    }

    /// A failure at a path.
    pub fn at(path: &Path, error: impl std::fmt::Display) -> Self {
        Self::Failure(format!("{}: {error}", path.display()))
    }

    /// The same error with the place in front.
    pub fn within(self, place: &str) -> Self {
        Self::Within { place: place.to_owned(), source: Box::new(self) }
    }

    /// Whether the caller's input is at fault; otherwise everything was right and it still failed.
    pub fn is_input(&self) -> bool {
        match self {
            Self::Within { source, .. } => source.is_input(),
            Self::Failure(_) | Self::NoCertainDigit { .. } => false,
            Self::Mesh(error) => {
                !matches!(error, MeshError::RefinementIncomplete { .. } | MeshError::Io { .. })
            }
            Self::Fem(error) => !matches!(
                error,
                FemError::NotPositiveDefinite { .. }
                    | FemError::PivotOutOfPhase { .. }
                    | FemError::OutOfMemory { .. }
            ),
            Self::Inverse(error) => !matches!(error, InverseError::Factorisation { .. }),
            Self::Denoise(error) => {
                !matches!(error, DenoiseError::Io { .. } | DenoiseError::Burn { .. })
            }
            Self::Hw(error) => !matches!(
                error,
                HwError::Write { .. }
                    | HwError::Lost { .. }
                    | HwError::Overflow { .. }
                    | HwError::Identity { .. }
            ),
            _ => true,
        }
    }
}
