//! The one error type of this crate.

/// What can be wrong with a Jacobian, a prior, settings or data.
///
/// Every variant carries the numbers that were found. Indices of frames, measurements and
/// elements are 0-based, in protocol and mesh order.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InverseError {
    /// An array has the wrong length.
    #[error("{what}: {found} values, but {wanted} are needed")]
    WrongLength {
        /// Which array.
        what: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        wanted: usize,
    },
    /// A Jacobian without rows or columns.
    #[error("the Jacobian is {measurements} x {elements}: it needs a measurement and an element")]
    EmptyJacobian {
        /// Rows.
        measurements: usize,
        /// Columns.
        elements: usize,
    },
    /// A Jacobian entry that is NaN or infinite.
    #[error(
        "the Jacobian is {value} at measurement {measurement}, element {element}: it must be finite"
    )]
    NonFiniteJacobian {
        /// Row.
        measurement: usize,
        /// Column.
        element: usize,
        /// The entry.
        value: f64,
    },
    /// No used measurement senses any element.
    #[error(
        "the {measurements} used measurements sense nothing (J P J' is zero): check the Jacobian's \
         units and which measurements are left out"
    )]
    NoSensitivity {
        /// Used measurements.
        measurements: usize,
    },
    /// Every measurement is left out.
    #[error("all {measurements} measurements are left out: at least one must be used")]
    NothingUsed {
        /// Measurements of the protocol.
        measurements: usize,
    },
    /// A measurement is asked for that the reconstruction was built without.
    #[error(
        "measurement {measurement} was left out before: build the reconstruction anew to use it"
    )]
    NotAvailable {
        /// Measurement index.
        measurement: usize,
    },
    /// A measurement is named that the protocol has not.
    #[error("measurement {measurement} does not exist: the protocol has {measurements} (from 0)")]
    UnknownMeasurement {
        /// Measurement index.
        measurement: usize,
        /// Measurements of the protocol.
        measurements: usize,
    },
    /// Masked measurements cannot be taken out of a reconstruction after the fact: at this
    /// hyperparameter they carry a part of the image almost alone.
    #[error(
        "leaving {masked} measurements out of this reconstruction would err by {expected_error:.0e} of \
         the image: use `OneStepGaussNewton::restricted_to` or a larger hyperparameter"
    )]
    MaskedDominates {
        /// How many are masked.
        masked: usize,
        /// Expected error by rounding, as a part of the image; 1 where no digit would be left.
        expected_error: f64,
    },
    /// A measured value, or its difference to the reference, is NaN or infinite.
    #[error(
        "frame {frame}, measurement {measurement} is {value}: leave the measurement out (`used`) \
         or repair the frame"
    )]
    NonFiniteData {
        /// Frame index (0 for a single frame).
        frame: usize,
        /// Measurement index.
        measurement: usize,
        /// The value.
        value: f64,
    },
    /// A reference value is NaN or infinite.
    #[error("reference frame, measurement {measurement} is {value}: it must be finite")]
    NonFiniteReference {
        /// Measurement index.
        measurement: usize,
        /// The value.
        value: f64,
    },
    /// Normalised data needs a reference voltage that is not zero.
    #[error(
        "measurement {measurement} of {what} is {value:e} V: normalised data divides by it; leave \
         the measurement out (`used`) or use plain differences"
    )]
    ZeroReference {
        /// "the reference frame" or "the model voltages".
        what: &'static str,
        /// Measurement index.
        measurement: usize,
        /// The value, volts.
        value: f64,
    },
    /// A setting is out of its range.
    #[error("{quantity} is {value}: it must be {must}")]
    OutOfRange {
        /// The quantity with its unit.
        quantity: &'static str,
        /// The value given.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// One entry of a list is out of its range.
    #[error("{quantity} of measurement {measurement} is {value}: it must be {must}")]
    MeasurementOutOfRange {
        /// The quantity with its unit.
        quantity: &'static str,
        /// Measurement index.
        measurement: usize,
        /// The value given.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A prior whose covariance is not positive semi-definite, or overflows.
    #[error("prior {prior}: J P J' is not finite and positive semi-definite (pivot {pivot})")]
    BadCovariance {
        /// The prior's name.
        prior: &'static str,
        /// Pivot or measurement at which it showed.
        pivot: usize,
    },
    /// A matrix factorisation failed.
    #[error("{what} failed at size {size}: the input is too badly scaled for double precision")]
    Factorisation {
        /// Which one.
        what: &'static str,
        /// Rows of the matrix.
        size: usize,
    },
    /// A hyperparameter rule that reads data was given none.
    #[error(
        "{rule} chooses the hyperparameter from data: give it a frame that differs from the \
         reference frame in what the skin can change"
    )]
    NoDifference {
        /// The rule.
        rule: &'static str,
    },
    /// The prior changes with the Jacobian, where an iterated reconstruction needs one that stays.
    #[error(
        "prior {prior} depends on the Jacobian, which changes from step to step: use Tikhonov, \
         Laplace or Gaussian"
    )]
    PriorNotFixed {
        /// The prior's name.
        prior: &'static str,
    },
    /// One element's conductivity is out of its range.
    #[error("{quantity} of element {element} is {value} S: it must be {must}")]
    ElementOutOfRange {
        /// The quantity.
        quantity: &'static str,
        /// Element index.
        element: usize,
        /// The value given, siemens.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A frame that no conductivity of the model explains.
    #[error(
        "the frame has the correlation {correlation:.3} with the model's voltages: check the sign \
         of the data, the protocol, and the number and order of electrodes"
    )]
    UnlikeModel {
        /// Cosine between the two; NaN for a frame of zeros.
        correlation: f64,
    },
    /// The forward model refused.
    #[error("forward model: {0}")]
    Forward(#[from] eit_fem::FemError),
    /// A data constraint that no image can fulfil.
    #[error(
        "frame {frame}: delta is {delta:.4e}, but no image comes nearer to the data than {least:.4e} \
         (what reciprocal and duplicate measurements disagree by): use a larger delta"
    )]
    DeltaTooSmall {
        /// Frame index.
        frame: usize,
        /// Radius of the frame.
        delta: f64,
        /// Least residual norm of any image.
        least: f64,
    },
    /// A cell of an image that is NaN or infinite.
    #[error("image {frame}, cell {cell} is {value}: it must be finite")]
    NonFiniteImage {
        /// Image index, counted from the first that was pushed.
        frame: usize,
        /// Cell index.
        cell: usize,
        /// The value.
        value: f64,
    },
    /// Too few frames without touch to learn the noise from.
    #[error("{found} quiet frames are given, {needed} are needed to measure the noise")]
    TooFewQuietFrames {
        /// Frames given.
        found: usize,
        /// Frames needed.
        needed: usize,
    },
    /// No cell of an image, or no measurement, shows noise.
    #[error("{what}: state the noise, or give quiet frames that show it")]
    NoiseUnknown {
        /// What is missing.
        what: &'static str,
    },
    /// Time stands still, runs backwards or is not finite.
    #[error("frame {frame} is at {time_s} s, after a frame at {before_s} s: time must increase")]
    TimeOrder {
        /// Frame index, counted from the first that was pushed.
        frame: usize,
        /// Its time, seconds.
        time_s: f64,
        /// Time of the frame before, seconds.
        before_s: f64,
    },
    /// More touches in one frame than there is room for.
    #[error("{found} touches in one frame: at most {most} can be followed")]
    TooManyTouches {
        /// Touches given.
        found: usize,
        /// The most that fit.
        most: usize,
    },
    /// A touch that is not on the skin.
    #[error(
        "touch {touch} at {position_m:?} m is {distance_m:e} m from the skin: it must be within \
         {limit_m:e} m"
    )]
    OutsideSkin {
        /// Touch index.
        touch: usize,
        /// Its position, metres.
        position_m: [f64; 3],
        /// Distance to the skin, metres.
        distance_m: f64,
        /// Largest distance, metres.
        limit_m: f64,
    },
    /// Too few presses to learn from.
    #[error("{found} presses, but at least {needed} are needed to learn from")]
    TooFewPresses {
        /// Presses given.
        found: usize,
        /// Presses needed.
        needed: usize,
    },
    /// A press that changed nothing.
    #[error("press {press}: its frame is zero, as if nothing had touched the skin")]
    EmptyPress {
        /// Press index.
        press: usize,
    },
    /// A press whose place is not finite.
    #[error("press {press} is at {place_m:?} m: places must be finite")]
    NonFinitePlace {
        /// Press index.
        press: usize,
        /// Its place, metres.
        place_m: [f64; 3],
    },
    /// Presses that tell nothing of places.
    #[error("all {presses} presses are alike: press at different places")]
    PressesAtOnePlace {
        /// Presses given.
        presses: usize,
    },
}
