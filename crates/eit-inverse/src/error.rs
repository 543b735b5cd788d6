//! The error type of this crate.

/// Errors caused by a Jacobian, a prior, settings or data.
///
/// Every variant carries the offending numbers. Indices of frames, measurements and elements are
/// 0-based, in protocol and mesh order.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InverseError {
    /// An array has the wrong length.
    #[error("{what}: {found} values, but {wanted} are needed")]
    WrongLength {
        /// Name of the array.
        what: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        wanted: usize,
    },
    /// A Jacobian has no rows or no columns.
    #[error(
        "the Jacobian is {measurements} x {elements}: it needs at least one measurement and one \
         element"
    )]
    EmptyJacobian {
        /// Number of rows, one per measurement.
        measurements: usize,
        /// Number of columns, one per element.
        elements: usize,
    },
    /// A Jacobian entry is NaN or infinite.
    #[error(
        "the Jacobian is {value} at measurement {measurement}, element {element}: it must be finite"
    )]
    NonFiniteJacobian {
        /// Row of the entry.
        measurement: usize,
        /// Column of the entry.
        element: usize,
        /// Value of the entry.
        value: f64,
    },
    /// No used measurement is sensitive to any element.
    #[error(
        "none of the {measurements} used measurements is sensitive to the image (J P J' is zero): \
         check the Jacobian's units and which measurements are excluded"
    )]
    NoSensitivity {
        /// Used measurements.
        measurements: usize,
    },
    /// Every measurement is excluded.
    #[error("all {measurements} measurements are excluded: at least one must be used")]
    NothingUsed {
        /// Measurements of the protocol.
        measurements: usize,
    },
    /// A requested measurement was excluded when the reconstruction was built.
    #[error(
        "measurement {measurement} was excluded when the reconstruction was built: rebuild the \
         reconstruction to use it"
    )]
    NotAvailable {
        /// Measurement index.
        measurement: usize,
    },
    /// A measurement index is beyond the protocol.
    #[error(
        "measurement {measurement} does not exist: the protocol has {measurements} measurements, \
         numbered from 0"
    )]
    UnknownMeasurement {
        /// Measurement index.
        measurement: usize,
        /// Measurements of the protocol.
        measurements: usize,
    },
    /// Masked measurements cannot be removed from a finished reconstruction: at this hyperparameter
    /// a part of the image depends almost entirely on them.
    #[error(
        "masking {masked} measurements of this reconstruction would cause a relative image error of \
         {expected_error:.0e}: use `OneStepGaussNewton::restricted_to` or a larger hyperparameter"
    )]
    MaskedDominates {
        /// Number of masked measurements.
        masked: usize,
        /// Expected rounding error relative to the image; 1 if no digit would be correct.
        expected_error: f64,
    },
    /// A measured value, or its difference from the reference, is NaN or infinite.
    #[error(
        "frame {frame}, measurement {measurement} is {value}: exclude the measurement (`used`) or \
         repair the frame"
    )]
    NonFiniteData {
        /// Frame index (0 for a single frame).
        frame: usize,
        /// Measurement index.
        measurement: usize,
        /// Value that was rejected.
        value: f64,
    },
    /// A reference value is NaN or infinite.
    #[error("reference frame, measurement {measurement} is {value}: it must be finite")]
    NonFiniteReference {
        /// Measurement index.
        measurement: usize,
        /// Value that was rejected.
        value: f64,
    },
    /// A voltage that normalised data divides by is zero.
    #[error(
        "measurement {measurement} of {what} is {value:e} V: normalised data divides by it; exclude \
         the measurement (`used`) or use plain differences"
    )]
    ZeroReference {
        /// "the reference frame" or "the model voltages".
        what: &'static str,
        /// Measurement index.
        measurement: usize,
        /// Voltage that was rejected, volts.
        value: f64,
    },
    /// A setting is out of range.
    #[error("{quantity} is {value}: it must be {must}")]
    OutOfRange {
        /// The quantity with its unit.
        quantity: &'static str,
        /// Value that was rejected.
        value: f64,
        /// Accepted range, in words.
        must: &'static str,
    },
    /// The value for one measurement is out of range.
    #[error("{quantity} of measurement {measurement} is {value}: it must be {must}")]
    MeasurementOutOfRange {
        /// The quantity with its unit.
        quantity: &'static str,
        /// Measurement index.
        measurement: usize,
        /// Value that was rejected.
        value: f64,
        /// Accepted range, in words.
        must: &'static str,
    },
    /// A prior covariance is not positive semi-definite, or overflows.
    #[error("prior {prior}: J P J' is not finite and positive semi-definite (pivot {pivot})")]
    BadCovariance {
        /// The prior's name.
        prior: &'static str,
        /// Pivot or measurement at which this was detected.
        pivot: usize,
    },
    /// A matrix factorisation failed.
    #[error("{what} failed at size {size}: the input is too badly scaled for double precision")]
    Factorisation {
        /// Name of the factorisation.
        what: &'static str,
        /// Number of rows of the matrix.
        size: usize,
    },
    /// A hyperparameter rule that needs data was given frames without a usable difference.
    #[error(
        "{rule} needs a signal to choose the hyperparameter: give it data that differs from the \
         reference frame in a way that a conductivity change can explain"
    )]
    NoDifference {
        /// Name of the rule.
        rule: &'static str,
    },
    /// The prior depends on the Jacobian, but an iterated reconstruction needs a fixed prior.
    #[error(
        "prior {prior} depends on the Jacobian, which changes at every step: use Tikhonov, Laplace \
         or Gaussian"
    )]
    PriorNotFixed {
        /// The prior's name.
        prior: &'static str,
    },
    /// The conductivity of one element is out of range.
    #[error("{quantity} of element {element} is {value} S: it must be {must}")]
    ElementOutOfRange {
        /// Name of the quantity, with its unit.
        quantity: &'static str,
        /// Element index.
        element: usize,
        /// Conductivity that was rejected, siemens.
        value: f64,
        /// Accepted range, in words.
        must: &'static str,
    },
    /// The frame's correlation with the model's voltages is not positive.
    #[error(
        "the correlation of the frame with the model's voltages is {correlation:.3}: check the sign \
         of the data, the protocol, and the number and order of electrodes"
    )]
    UnlikeModel {
        /// Cosine between the frame and the model's voltages; NaN for a frame of zeros.
        correlation: f64,
    },
    /// Error from the forward model.
    #[error("forward model: {0}")]
    Forward(#[from] eit_fem::FemError),
    /// No image can satisfy the data constraint.
    #[error(
        "frame {frame}: delta is {delta:.4e}, but the smallest residual of any image is {least:.4e} \
         (reciprocal or duplicate measurements disagree by this much): use a larger delta"
    )]
    DeltaTooSmall {
        /// Frame index.
        frame: usize,
        /// Radius of the frame's data constraint.
        delta: f64,
        /// Smallest residual norm of any image.
        least: f64,
    },
    /// No image within the bounds can satisfy the data constraint.
    #[error(
        "frame {frame}: delta is {delta:.4e}, but the smallest residual of any image between {lower_s:e} and \
         {upper_s:e} S is {least:.4e}: use a larger delta or wider bounds"
    )]
    DeltaTooSmallWithinBounds {
        /// Frame index.
        frame: usize,
        /// Radius of the frame's data constraint.
        delta: f64,
        /// Smallest residual norm of any image within the bounds.
        least: f64,
        /// Lower bound of the conductivity change, siemens.
        lower_s: f64,
        /// Upper bound of the conductivity change, siemens.
        upper_s: f64,
    },
    /// A timestamp does not increase or is not finite.
    #[error("frame {frame} is at {time_s} s, after a frame at {before_s} s: time must increase")]
    TimeOrder {
        /// Frame index, counted from the first frame pushed.
        frame: usize,
        /// Time of this frame, seconds.
        time_s: f64,
        /// Time of the frame before, seconds.
        before_s: f64,
    },
    /// A frame has more touches than the tracker can hold.
    #[error("{found} touches in one frame: at most {most} can be tracked")]
    TooManyTouches {
        /// Touches given.
        found: usize,
        /// Largest number of touches.
        most: usize,
    },
    /// A touch is too far from the skin.
    #[error(
        "touch {touch} at {position_m:?} m is {distance_m:e} m from the skin: it must be within \
         {limit_m:e} m"
    )]
    OutsideSkin {
        /// Touch index.
        touch: usize,
        /// Position of the touch, metres.
        position_m: [f64; 3],
        /// Distance to the skin, metres.
        distance_m: f64,
        /// Largest accepted distance, metres.
        limit_m: f64,
    },
    /// Too few presses for learning.
    #[error("{found} presses given: learning needs at least {needed}")]
    TooFewPresses {
        /// Presses given.
        found: usize,
        /// Presses needed.
        needed: usize,
    },
    /// A press changed no measurement.
    #[error("press {press}: its frame is all zero, as without a touch")]
    EmptyPress {
        /// Press index.
        press: usize,
    },
    /// The position of a press is not finite.
    #[error("press {press} is at {place_m:?} m: its position must be finite")]
    NonFinitePlace {
        /// Press index.
        press: usize,
        /// Position of the press, metres.
        place_m: [f64; 3],
    },
    /// The presses do not differ enough to learn positions from.
    #[error("all {presses} presses are alike: press at different positions")]
    PressesAtOnePlace {
        /// Presses given.
        presses: usize,
    },
}
