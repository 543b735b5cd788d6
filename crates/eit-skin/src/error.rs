//! Errors: one line that says what is wrong, where, and how to fix it.

use eit_denoise::DenoiseError;
use eit_fem::FemError;
use eit_hw::{Frame, HwError};
use eit_inverse::InverseError;
use eit_mesh::MeshError;
use std::path::Path;

/// An error while building or using a skin.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SkinError {
    /// An error with its location: a file, a scene or a frame.
    #[error("{place}: {source}")]
    Within {
        /// File, scene or frame.
        place: String,
        /// Error without its location.
        source: Box<SkinError>,
    },
    /// A setting outside its range.
    #[error("{key} is {value}: it must be {must}")]
    OutOfRange {
        /// Key of the scene.
        key: &'static str,
        /// Value that was rejected.
        value: f64,
        /// Allowed values.
        must: &'static str,
    },
    /// A length that no skin has, most likely one in millimetres.
    #[error(
        "{key} is {value_m}: lengths are in metres, of which a skin has at most {most_m}; {value_m} looks like \
         millimetres, which are {} metres", value_m / 1e3
    )]
    NotMetres {
        /// Key of the scene, with the place in a list.
        key: String,
        /// Length that was rejected, metres.
        value_m: f64,
        /// Largest length of a skin, metres.
        most_m: f64,
    },
    /// An argument of the caller, or a field of its settings, that is missing or invalid.
    #[error("{name}: {problem}")]
    Argument {
        /// Its name in the function or the settings; an option of a command line has the same, with dashes.
        name: &'static str,
        /// What is wrong with it, and how to fix it.
        problem: String,
    },
    /// Two settings that exclude each other.
    #[error("{one} and {other} exclude each other: keep one")]
    Exclusive {
        /// Key of the scene.
        one: &'static str,
        /// The other key.
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
    /// A required setting is missing.
    #[error("{key} is missing: {why} needs it")]
    Missing {
        /// Key of the scene.
        key: String,
        /// What needs it.
        why: String,
    },
    /// A list with the wrong length for the number of electrodes.
    #[error(
        "{key} has {found} values for {electrodes} electrodes: give one number, or one per electrode"
    )]
    WrongCount {
        /// Key of the scene.
        key: String,
        /// Number of values in the list.
        found: usize,
        /// Number of electrodes of the skin.
        electrodes: usize,
    },
    /// A frame with the wrong length for the protocol.
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
    /// A list with the wrong length for the protocol.
    #[error("{what} has {found} values, but the protocol has {measurements} measurements")]
    MeasurementCount {
        /// Which list.
        what: &'static str,
        /// Number of values in the list.
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
    /// A frame number beyond the end of the recording.
    #[error("{what}: the recording has frames 0 to {last}")]
    NoSuchFrame {
        /// What refers to the frame.
        what: String,
        /// Last frame of the recording.
        last: usize,
    },
    /// Arrays that are too large for memory.
    #[error("{what} take {gigabytes:.0} GB: {advice}")]
    TooLarge {
        /// Which arrays.
        what: String,
        /// Their size, gigabytes.
        gigabytes: f64,
        /// How to make them smaller.
        advice: &'static str,
    },
    /// Live images by total variation with more pixels than a live view can have.
    #[error(
        "{measurements} measurements on {pixels} x {pixels} pixels are too many for total variation of live \
         frames: use at most {most} [reconstruction] pixels, method = \"gauss-newton\", or `eit reconstruct` \
         on a recording"
    )]
    TooManyPixels {
        /// Number of measurements.
        measurements: usize,
        /// Pixels along the longer side of an image.
        pixels: usize,
        /// Most pixels along the longer side for that number of measurements.
        most: usize,
    },
    /// Rounding may have destroyed every digit of the voltages.
    #[error(
        "no digit of the voltages is certain: conductances on this skin span {decades:.0} decades \
         (contact impedances times conductivity against element size, or contrast); bring them \
         closer together"
    )]
    NoCertainDigit {
        /// Powers of ten between the smallest and the largest conductance.
        decades: f64,
    },
    /// The noise is required, but neither stated nor measured.
    #[error("{who} needs the noise: state [noise] additive_v or quiet_frames")]
    UnknownNoise {
        /// What needs it.
        who: &'static str,
    },
    /// Presses of which those that are held out are placed no better than by the middle of the others.
    #[error(
        "nothing is learnt from these {presses} presses: one that is held out is placed {:.1} mm off by the others, and \
         {:.1} mm by their middle (means); does each line of the table name the place and the frames of its press?",
        1e3 * error_m, 1e3 * middle_m
    )]
    NothingLearnt {
        /// Number of presses.
        presses: usize,
        /// Mean error of held-out presses by the others, metres.
        error_m: f64,
        /// The same by their middle.
        middle_m: f64,
    },
    /// Settings or data that do not fit together; the message names them.
    #[error("{0}")]
    Input(String),
    /// A failure although the input was valid.
    #[error("{0}")]
    Failure(String),
    /// An error from eit-mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// An error of the forward model.
    #[error(transparent)]
    Fem(#[from] FemError),
    /// An error of the reconstruction.
    #[error(transparent)]
    Inverse(#[from] InverseError),
    /// An error of an instrument or a recording.
    #[error(transparent)]
    Hw(#[from] HwError),
    /// An error of a U-net.
    #[error(transparent)]
    Denoise(#[from] DenoiseError),
}

impl SkinError {
    /// Creates an error for invalid input.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    /// Creates an error for an argument of the caller.
    pub(crate) fn argument(name: &'static str, problem: impl Into<String>) -> Self {
        Self::Argument { name, problem: problem.into() }
    }

    /// Returns the argument of the caller that is at fault, if it is one, and what is wrong with it, so that a program can
    /// name its own option.
    pub fn as_argument(&self) -> Option<(&'static str, &str)> {
        match self {
            Self::Argument { name, problem } => Some((name, problem)),
            Self::Within { source, .. } => source.as_argument(),
            _ => None,
        }
    }

    /// Rejects a list that does not have one value per measurement.
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

    /// Rejects a frame that does not have one value and one flag per measurement.
    pub(crate) fn check_frame(frame: &Frame, measurements: usize) -> Result<(), Self> {
        let (values, flags) = (frame.values.len(), frame.quality.len());
        match (values, flags) == (measurements, measurements) {
            true => Ok(()),
            false => Err(Self::FrameLength { values, flags, measurements }),
        }
    }

    /// Creates a failure at a path.
    pub(crate) fn at(path: &Path, error: impl std::fmt::Display) -> Self {
        Self::Failure(format!("{}: {error}", path.display()))
    }

    /// Adds a location in front of the error.
    pub fn within(self, place: &str) -> Self {
        Self::Within { place: place.to_owned(), source: Box::new(self) }
    }

    /// Returns whether invalid input caused the error; otherwise something failed although the input was
    /// valid.
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
