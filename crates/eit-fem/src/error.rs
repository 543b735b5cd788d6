//! Error type of this crate. The file is long because it holds a single enum.

use crate::sparse::SparseError;

/// Error in a protocol, a forward problem or a simulated fabric.
///
/// Electrode indices in quadruples and patterns are 0-based, as in data files. Electrode numbers in
/// messages ("electrode 3") are 1-based, as labelled on a skin. Elements and measurements are
/// 0-based.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FemError {
    /// Too few electrodes for the requested pattern.
    #[error("{electrodes} electrodes are too few: {pattern} needs at least {needed}")]
    TooFewElectrodes {
        /// Number of electrodes.
        electrodes: usize,
        /// Description of the pattern.
        pattern: String,
        /// Smallest number of electrodes that the pattern works with.
        needed: usize,
    },
    /// Opposite drive with an odd number of electrodes.
    #[error(
        "{electrodes} electrodes have no opposite pairs: use an even number or drive = \"skip-N\""
    )]
    NoOpposite {
        /// Number of electrodes.
        electrodes: usize,
    },
    /// A quadruple or pair refers to an electrode that does not exist.
    #[error(
        "{what} {index} refers to electrode index {electrode}, but the {electrodes} electrodes have \
         indices 0 to {last}", last = electrodes.saturating_sub(1)
    )]
    UnknownElectrode {
        /// "quadruple", "drive pair" or "measured pair".
        what: &'static str,
        /// Its index in the list.
        index: usize,
        /// The invalid electrode index.
        electrode: u32,
        /// Number of electrodes.
        electrodes: usize,
    },
    /// A pair uses the same electrode twice.
    #[error("{what} {index} connects electrode index {electrode} with itself")]
    DegeneratePair {
        /// "quadruple", "drive pair" or "measured pair".
        what: &'static str,
        /// Its index in the list.
        index: usize,
        /// The electrode index.
        electrode: u32,
    },
    /// The protocol has no measurements.
    #[error("the protocol has no measurements: keep the driven electrodes or choose other pairs")]
    EmptyProtocol,
    /// The drive current is not finite and positive.
    #[error("current_a is {current_a}: it must be finite and above zero")]
    BadCurrent {
        /// The current, ampere.
        current_a: f64,
    },
    /// A pattern contains NaN or infinity.
    #[error("{what} pattern {pattern} contains {value} at electrode index {electrode}")]
    NonFinitePattern {
        /// "stimulation" or "measurement".
        what: &'static str,
        /// Pattern index.
        pattern: usize,
        /// Electrode index.
        electrode: usize,
        /// Value that was rejected.
        value: f64,
    },
    /// The entries of a pattern do not sum to zero, or all of them are zero.
    #[error(
        "{what} pattern {pattern} sums to {sum:e} with a largest entry of {largest:e}: the \
         entries must sum to zero and must not all be zero"
    )]
    UnbalancedPattern {
        /// "stimulation" or "measurement".
        what: &'static str,
        /// Pattern index.
        pattern: usize,
        /// Sum of the entries.
        sum: f64,
        /// Largest magnitude of an entry.
        largest: f64,
    },
    /// Protocol and mesh have different numbers of electrodes.
    #[error("the protocol is for {protocol} electrodes, but the mesh has {mesh}")]
    ElectrodeCount {
        /// Number of electrodes in the protocol.
        protocol: usize,
        /// Number of electrodes on the mesh.
        mesh: usize,
    },
    /// An array has the wrong length.
    #[error("{what}: {found} values given, {wanted} needed")]
    WrongLength {
        /// Name of the array.
        what: &'static str,
        /// Number of values given.
        found: usize,
        /// Number of values needed.
        wanted: usize,
    },
    /// A conductivity is zero, negative or not finite.
    #[error(
        "the conductivity of element {element} is {value_s} S: it must be finite and above zero \
         ({count} of the elements are not; model a hole by leaving elements out of the mesh)"
    )]
    BadConductivity {
        /// Index of the first such element.
        element: usize,
        /// Its conductivity, siemens.
        value_s: f64,
        /// Number of such elements.
        count: usize,
    },
    /// A contact impedance is negative or not a number.
    #[error(
        "the contact impedance of electrode {electrode} is {value}: it must be zero (a shunt), \
         above zero, or infinite (an ideal current source)"
    )]
    BadContactImpedance {
        /// Electrode number, from 1.
        electrode: usize,
        /// Its contact impedance, ohm metre (rim) or ohm square metre (patch).
        value: f64,
    },
    /// An admittivity is zero, is not finite, or has a negative real part.
    #[cfg(feature = "complex")]
    #[error(
        "the admittivity of element {element} is {value_s} S: its real part must be zero or above, \
         and not both parts zero ({count} of the elements are invalid; model a hole by leaving \
         elements out of the mesh)"
    )]
    BadAdmittivity {
        /// Index of the first such element.
        element: usize,
        /// Its admittivity, siemens.
        value_s: num_complex::Complex64,
        /// Number of such elements.
        count: usize,
    },
    /// A complex contact impedance is zero, is not finite, or has a negative real part.
    #[cfg(feature = "complex")]
    #[error(
        "the contact impedance of electrode {electrode} is {value}: with complex admittivities \
         it must be finite and non-zero, with a real part of zero or above (only the real model \
         supports shunts and ideal current sources)"
    )]
    BadComplexImpedance {
        /// Electrode number, from 1.
        electrode: usize,
        /// Its contact impedance, ohm metre (rim) or ohm square metre (patch).
        value: num_complex::Complex64,
    },
    /// Inductive and capacitive parts may cancel (resonance).
    #[error(
        "the phases of the admittivities and contact admittances range from {:.3} to {:.3} degrees: \
         they must span less than 180 degrees, or capacitors and inductors may cancel (capacitive \
         admittivities have positive imaginary parts, capacitive impedances negative ones)",
        degrees[0], degrees[1]
    )]
    OppositePhases {
        /// Smallest and largest phase, degrees.
        degrees: [f64; 2],
    },
    /// Rounding pushed a pivot of the complex factorisation out of its half plane.
    #[error(
        "the pivot of unknown {unknown} of {unknowns} is outside the phase range of the admittivities: \
         they or the contact impedances span too many decades for this mesh"
    )]
    PivotOutOfPhase {
        /// Position in the elimination order.
        unknown: usize,
        /// Number of unknowns.
        unknowns: usize,
    },
    /// A pivot of the factorisation is not positive.
    #[error(
        "the system matrix lost positive definiteness at unknown {unknown} of {unknowns}: the \
         conductivities or contact impedances span too many decades for this mesh"
    )]
    NotPositiveDefinite {
        /// Position in the elimination order.
        unknown: usize,
        /// Number of unknowns.
        unknowns: usize,
    },
    /// The required accuracy of the voltages was not reached.
    #[error(
        "the error bound of the voltages is {reached:e} of the largest voltage, but {required:e} was \
         required: the conductivities or the triangle shapes span too many decades"
    )]
    AccuracyNotReached {
        /// Error bound relative to the largest voltage.
        reached: f64,
        /// Required accuracy, relative to the largest voltage.
        required: f64,
    },
    /// A mesh search found no mesh that is fine enough.
    #[error(
        "no mesh of at most {most_nodes} nodes meets the required accuracy of {required:e} of the \
         largest voltage: the best estimate is {reached:e} with {nodes} nodes; allow more nodes or \
         accept a larger error"
    )]
    NoMeshSuffices {
        /// Smallest estimated error, relative to the largest voltage.
        reached: f64,
        /// Number of nodes of that mesh.
        nodes: usize,
        /// Required accuracy, relative to the largest voltage.
        required: f64,
        /// Largest number of nodes allowed.
        most_nodes: usize,
    },
    /// Quadratic elements do not reach the required accuracy.
    #[error(
        "the expected rounding error with quadratic elements is {expected:e} of the largest voltage, but \
         {required:e} was required: use linear elements, which have a more accurate solve path"
    )]
    NodalAssemblyOnly {
        /// Expected loss, relative to the largest voltage.
        expected: f64,
        /// Required accuracy, relative to the largest voltage.
        required: f64,
    },
    /// Quadratic elements do not support a contact impedance of zero or infinity.
    #[error(
        "the contact impedance of electrode {electrode} is {value}: quadratic elements need it above \
         zero and finite; use linear elements, or a very small or very large value"
    )]
    LimitOfImpedance {
        /// Electrode number, from 1.
        electrode: usize,
        /// Its contact impedance, ohm metre (rim) or ohm square metre (patch).
        value: f64,
    },
    /// A curved element is inverted somewhere.
    #[error(
        "triangle {triangle} folds over (its smallest area ratio is {stretch}): its midside nodes are \
         too far from the straight edges; use shorter edges where the skin is curved"
    )]
    FoldedElement {
        /// Triangle index.
        triangle: usize,
        /// Smallest local area ratio of the curved element to the straight triangle.
        stretch: f64,
    },
    /// A derivative with respect to the anisotropy of a model that has none.
    #[error(
        "the model has no direction of conductivity: give it an anisotropy, of ratio 1 if need be"
    )]
    NoAnisotropy,
    /// The direction of an anisotropic element is at right angles to it.
    #[error(
        "the direction of triangle {triangle} is at right angles to it: the conductivity along needs a \
         direction in the triangle's plane"
    )]
    NoDirection {
        /// Triangle index.
        triangle: usize,
    },
    /// Every node of an electrode is shared with other electrodes.
    #[error(
        "electrode {electrode} shares all its nodes with other electrodes: accurate solves need a gap \
         beside it, or one more edge on it"
    )]
    NoNodeOfItsOwn {
        /// Electrode number, from 1.
        electrode: usize,
    },
    /// An electrode with contact impedance zero touches another electrode.
    #[error(
        "electrode {electrode} has contact impedance 0 and touches another electrode: this is a \
         short circuit; leave a gap or set a positive impedance"
    )]
    TouchingShunt {
        /// Electrode number, from 1.
        electrode: usize,
    },
    /// The factor does not fit into memory or exceeds the index range.
    #[error("the factor of {unknowns} unknowns does not fit into memory: use a coarser mesh")]
    OutOfMemory {
        /// Number of unknowns.
        unknowns: usize,
    },
    /// A potential overflowed.
    #[error(
        "the potential of electrode {electrode} under stimulation {stimulation} is {value_v} V: \
         the currents, conductivities and contact impedances together exceed the floating-point range"
    )]
    NonFinitePotential {
        /// Stimulation index.
        stimulation: usize,
        /// Electrode number, from 1.
        electrode: usize,
        /// The potential, volt.
        value_v: f64,
    },
    /// A displacement refers to a node that does not exist.
    #[error(
        "a displacement refers to node {node}, but the mesh has {nodes} nodes, numbered from 0"
    )]
    NoSuchNode {
        /// Node index.
        node: usize,
        /// Number of nodes of the mesh.
        nodes: usize,
    },
    /// The operation is not available with quadratic elements.
    #[error("{what} are available for linear elements only")]
    LinearElementsOnly {
        /// The requested quantity.
        what: &'static str,
    },
    /// A contact impedance of zero or infinity, where the voltages have no derivative with respect
    /// to it.
    #[error(
        "the contact impedance of electrode {electrode} is {value}: the voltages have a derivative with \
         respect to it only if it is above zero and finite"
    )]
    ContactLimit {
        /// Electrode number, from 1.
        electrode: usize,
        /// Its contact impedance, ohm metre (rim) or ohm square metre (patch).
        value: f64,
    },
    /// An electrode cannot move along the rim.
    #[error("electrode {electrode} cannot move along the rim: {why}")]
    Immovable {
        /// Electrode number, from 1.
        electrode: usize,
        /// Reason, in words.
        why: &'static str,
    },
    /// A node position is not finite.
    #[error("node {node} is moved to {position_m:?} m: positions must be finite")]
    NonFinitePosition {
        /// Node index.
        node: usize,
        /// Its position, metres.
        position_m: [f64; 3],
    },
    /// A triangle has no area after its nodes have moved.
    #[error("triangle {triangle} has the area {area_m2:e} m^2 after its nodes have moved")]
    ZeroArea {
        /// Triangle index.
        triangle: usize,
        /// Its area, square metres.
        area_m2: f64,
    },
    /// A list refers to an electrode number that does not exist.
    #[error("{what} refers to electrode {number}, but the skin has electrodes 1 to {electrodes}")]
    NoSuchElectrode {
        /// Name of the list.
        what: &'static str,
        /// Electrode number, from 1.
        number: usize,
        /// Number of electrodes of the skin.
        electrodes: usize,
    },
    /// A key of a touch script holds an invalid value.
    #[error("finger {finger}, key {key}: {quantity} is {value}: it must be {must}")]
    BadTouch {
        /// The finger's number.
        finger: u32,
        /// Index of the key, from 0.
        key: usize,
        /// The quantity with its unit.
        quantity: &'static str,
        /// Value that was rejected.
        value: f64,
        /// Accepted range, in words.
        must: &'static str,
    },
    /// The keys of a finger are not in ascending order of time.
    #[error(
        "finger {finger}, key {key}: its time {time_s} s is not after the previous key at {before_s} s"
    )]
    UnsortedKeys {
        /// The finger's number.
        finger: u32,
        /// Index of the key, from 0.
        key: usize,
        /// Its time, seconds.
        time_s: f64,
        /// Time of the previous key, seconds.
        before_s: f64,
    },
    /// A touch is not on the skin.
    #[error("finger {finger}, {place}, {time_s} s: ({x_m}, {y_m}) m is not on the skin")]
    OutsideSkin {
        /// The finger's number.
        finger: u32,
        /// "at key N" or "between keys".
        place: String,
        /// Time, seconds.
        time_s: f64,
        /// Coordinate x, metres.
        x_m: f64,
        /// Coordinate y, metres.
        y_m: f64,
    },
    /// A force is too large for the contact model.
    #[error(
        "finger {finger}, {time_s} s: {force_n} N on a tip of {radius_m} m gives a slope above one, \
         beyond the contact model: use less force, a larger tip, more tension or a stiffer foundation"
    )]
    ForceTooLarge {
        /// The finger's number.
        finger: u32,
        /// Time, seconds.
        time_s: f64,
        /// Force, newton.
        force_n: f64,
        /// Radius of the tip, metres.
        radius_m: f64,
    },
    /// Touches invert a triangle of the mesh.
    #[error(
        "frame {frame}: the touches invert triangle {triangle} (area ratio to rest: {area_ratio}): use \
         less force, or touches further apart"
    )]
    FoldedMesh {
        /// Frame index.
        frame: usize,
        /// Triangle index.
        triangle: usize,
        /// Signed area projected onto z = 0, over the area at rest.
        area_ratio: f64,
    },
    /// The centroid of an outline is in a hole or outside the skin, so there is no play circle.
    #[error("the centroid of the outline, ({x_m}, {y_m}) m, is not on the skin")]
    CentroidOffSkin {
        /// Coordinate x, metres.
        x_m: f64,
        /// Coordinate y, metres.
        y_m: f64,
    },
    /// The fingers are too many or too far apart for the skin.
    #[error(
        "{fingers} fingers cannot stay {apart_m} m apart within {reach_m} m of the skin's centre: \
         use fewer or smaller fingers"
    )]
    NoRoom {
        /// Number of fingers.
        fingers: usize,
        /// Smallest distance between two fingers, metres.
        apart_m: f64,
        /// Radius of the circle that contains all fingers, metres.
        reach_m: f64,
    },
    /// The step between frames exceeds the radius of a finger's territory.
    #[error(
        "step_m is {step_m}: with {fingers} fingers it must be from 0 to {most_m:.1e} m, the radius \
         of each finger's territory"
    )]
    StepTooLong {
        /// Path length from one frame to the next, metres.
        step_m: f64,
        /// Number of fingers.
        fingers: usize,
        /// Largest allowed step, metres.
        most_m: f64,
    },
    /// No built-in touch script has this name.
    #[error("unknown touch script \"{name}\": available scripts are {known}")]
    UnknownScript {
        /// The unknown name.
        name: String,
        /// The available names.
        known: String,
    },
    /// A parameter is out of range.
    #[error("{quantity} is {value}: it must be {must}")]
    OutOfRange {
        /// The quantity with its unit.
        quantity: &'static str,
        /// Value that was rejected.
        value: f64,
        /// Accepted range, in words.
        must: &'static str,
    },
    /// Another error of the sparse factorisation.
    #[error(transparent)]
    Sparse(SparseError),
}

impl FemError {
    pub(crate) fn check_length(
        what: &'static str,
        found: usize,
        wanted: usize,
    ) -> Result<(), Self> {
        if found == wanted { Ok(()) } else { Err(Self::WrongLength { what, found, wanted }) }
    }

    /// Requires a quantity to be finite and to fit.
    pub(crate) fn require(
        quantity: &'static str,
        value: f64,
        fits: bool,
        must: &'static str,
    ) -> Result<(), Self> {
        let good = fits && value.is_finite();
        if good { Ok(()) } else { Err(Self::OutOfRange { quantity, value, must }) }
    }
}

impl From<SparseError> for FemError {
    fn from(error: SparseError) -> Self {
        match error {
            SparseError::OutOfMemory { unknowns } => Self::OutOfMemory { unknowns },
            SparseError::BadPivot { unknown, unknowns } => {
                Self::NotPositiveDefinite { unknown, unknowns }
            }
            other => Self::Sparse(other),
        }
    }
}
