//! The one error type of this crate. One long file: the enum is one list.

use crate::sparse::SparseError;

/// What can be wrong with a protocol or a forward problem.
///
/// Electrodes inside quadruples and patterns are 0-based, as in data files; electrodes named in a
/// sentence ("electrode 3") are 1-based, as on a skin. Elements and measurements are 0-based.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FemError {
    /// Too few electrodes for the wanted patterns.
    #[error("{electrodes} electrodes are too few: {pattern} needs at least {needed}")]
    TooFewElectrodes {
        /// Electrodes given.
        electrodes: usize,
        /// The pattern in words.
        pattern: String,
        /// Electrodes needed.
        needed: usize,
    },
    /// Opposite drive with an odd number of electrodes.
    #[error(
        "{electrodes} electrodes have no opposite pairs: use an even number or drive = \"skip-N\""
    )]
    NoOpposite {
        /// Electrodes given.
        electrodes: usize,
    },
    /// A quadruple or pair names an electrode that does not exist.
    #[error(
        "{what} {index} names electrode index {electrode}, but the {electrodes} electrodes have \
         the indices 0 to {last}", last = electrodes.saturating_sub(1)
    )]
    UnknownElectrode {
        /// "quadruple", "drive pair" or "measured pair".
        what: &'static str,
        /// Its place in the list.
        index: usize,
        /// Electrode index it names.
        electrode: u32,
        /// Electrodes there are.
        electrodes: usize,
    },
    /// A pair of one electrode with itself.
    #[error("{what} {index} joins electrode index {electrode} with itself")]
    DegeneratePair {
        /// "quadruple", "drive pair" or "measured pair".
        what: &'static str,
        /// Its place in the list.
        index: usize,
        /// The electrode index.
        electrode: u32,
    },
    /// No measurement left.
    #[error("the protocol has no measurement: keep the driven electrodes or choose other pairs")]
    EmptyProtocol,
    /// The drive current is not usable.
    #[error("current_a is {current_a}: it must be finite and above zero")]
    BadCurrent {
        /// Value given, ampere.
        current_a: f64,
    },
    /// A pattern holds NaN or infinity.
    #[error("{what} pattern {pattern} holds {value} at electrode index {electrode}")]
    NonFinitePattern {
        /// "stimulation" or "measurement".
        what: &'static str,
        /// Pattern index.
        pattern: usize,
        /// Electrode index.
        electrode: usize,
        /// The value.
        value: f64,
    },
    /// A pattern whose entries do not cancel, or that is zero.
    #[error(
        "{what} pattern {pattern} sums to {sum:e} with a largest entry of {largest:e}: what enters \
         the skin must leave it, and a pattern must not be zero"
    )]
    UnbalancedPattern {
        /// "stimulation" or "measurement".
        what: &'static str,
        /// Pattern index.
        pattern: usize,
        /// Sum over the electrodes.
        sum: f64,
        /// Largest magnitude.
        largest: f64,
    },
    /// Protocol and mesh disagree about the electrodes.
    #[error("the protocol is for {protocol} electrodes, but the mesh has {mesh}")]
    ElectrodeCount {
        /// Electrodes of the protocol.
        protocol: usize,
        /// Electrodes of the mesh.
        mesh: usize,
    },
    /// An array has the wrong length.
    #[error("{what}: {found} values given, {wanted} needed")]
    WrongLength {
        /// Which array.
        what: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        wanted: usize,
    },
    /// A conductivity is zero, negative or not finite.
    #[error(
        "the conductivity of element {element} is {value_s} S: it must be finite and above zero \
         ({count} of the elements are not; for a hole leave them out of the mesh)"
    )]
    BadConductivity {
        /// Element index.
        element: usize,
        /// Its value, siemens.
        value_s: f64,
        /// How many elements are like it.
        count: usize,
    },
    /// A contact impedance is negative or not a number.
    #[error(
        "the contact impedance of electrode {electrode} is {value}: it must be zero (a shunt), \
         above zero, or infinite (an ideal current source)"
    )]
    BadContactImpedance {
        /// 1-based number.
        electrode: usize,
        /// Its value, ohm metre (rim) or ohm square metre (patch).
        value: f64,
    },
    /// An admittivity takes no power and stores none, gives power, or is not finite.
    #[cfg(feature = "complex")]
    #[error(
        "the admittivity of element {element} is {value_s} S: its real part must be zero or above, \
         and not both parts zero ({count} of the elements are like that; for a hole leave them out of \
         the mesh)"
    )]
    BadAdmittivity {
        /// Element index.
        element: usize,
        /// Its value, siemens.
        value_s: num_complex::Complex64,
        /// How many elements are like it.
        count: usize,
    },
    /// A complex contact impedance that a complex model cannot have.
    #[cfg(feature = "complex")]
    #[error(
        "the contact impedance of electrode {electrode} is {value}: beside complex admittivities it \
         must be finite and not zero, with a real part of zero or above (shunts and ideal current \
         sources need a skin without capacitance)"
    )]
    BadComplexImpedance {
        /// 1-based number.
        electrode: usize,
        /// Its value, ohm metre (rim) or ohm square metre (patch).
        value: num_complex::Complex64,
    },
    /// Inductive and capacitive parts that may cancel.
    #[cfg(feature = "complex")]
    #[error(
        "phases of admittivities and contact admittances lie between {:.3} and {:.3} degrees: they \
         must stay within less than half a turn, or capacitors and inductors cancel (capacitive \
         admittivities have positive imaginary parts, capacitive impedances negative ones)",
        degrees[0], degrees[1]
    )]
    OppositePhases {
        /// Least and greatest phase.
        degrees: [f64; 2],
    },
    /// The factorisation met a pivot that rounding has made.
    #[cfg(feature = "complex")]
    #[error(
        "the pivot of unknown {unknown} of {unknowns} left the phases of the admittivities: they or \
         the contact impedances span too many decades for this mesh"
    )]
    PivotOutOfPhase {
        /// Position in the elimination order.
        unknown: usize,
        /// Number of unknowns.
        unknowns: usize,
    },
    /// The factorisation met a pivot that is not positive.
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
    /// The voltages could not be had to the accuracy asked for.
    #[error(
        "the voltages are certain to {reached:e} of the largest, and {required:e} was required: the \
         conductivities or the shapes of triangles span too many decades"
    )]
    AccuracyNotReached {
        /// Bound of the error relative to the largest voltage.
        reached: f64,
        /// What was asked for.
        required: f64,
    },
    /// No mesh of a search was fine enough.
    #[error(
        "no mesh of at most {most_nodes} nodes has voltages to {required:e} of the largest: the best \
         that was judged has {reached:e} with {nodes} nodes; allow more nodes, or ask for less"
    )]
    NoMeshSuffices {
        /// Least estimated error over the largest voltage.
        reached: f64,
        /// Nodes of the mesh that has it.
        nodes: usize,
        /// What was asked for.
        required: f64,
        /// Most nodes that were allowed.
        most_nodes: usize,
    },
    /// An accuracy that quadratic elements do not reach.
    #[error(
        "the voltages of quadratic elements may have lost {expected:e} of the largest, and {required:e} \
         was required: only linear elements have the path that keeps more"
    )]
    NodalAssemblyOnly {
        /// Expected loss relative to the largest voltage.
        expected: f64,
        /// What was asked for.
        required: f64,
    },
    /// A limit of the contact impedance with elements that do not know it.
    #[error(
        "the contact impedance of electrode {electrode} is {value}: quadratic elements need it above \
         zero and finite; take linear elements, or a small or large value"
    )]
    LimitOfImpedance {
        /// 1-based number.
        electrode: usize,
        /// Its value, ohm metre (rim) or ohm square metre (patch).
        value: f64,
    },
    /// A curved element that folds over.
    #[error(
        "triangle {triangle} folds over (stretched by {stretch} at one place): its midside nodes \
         are too far off the straight edges; use shorter edges where the skin is curved"
    )]
    FoldedElement {
        /// Triangle index.
        triangle: usize,
        /// Least area of the map over that of the straight triangle.
        stretch: f64,
    },
    /// Every node of an electrode is on other electrodes too.
    #[error(
        "electrode {electrode} has no node of its own: accurate solves need a gap beside it, or an \
         edge more"
    )]
    NoNodeOfItsOwn {
        /// 1-based number.
        electrode: usize,
    },
    /// A contact without impedance at the side of another electrode.
    #[error(
        "electrode {electrode} has contact impedance 0 and touches another electrode: that is a \
         short circuit; leave a gap, or give it an impedance"
    )]
    TouchingShunt {
        /// 1-based number.
        electrode: usize,
    },
    /// The factor does not fit into memory or index range.
    #[error("the factor of {unknowns} unknowns does not fit into memory: use a coarser mesh")]
    OutOfMemory {
        /// Number of unknowns.
        unknowns: usize,
    },
    /// A potential overflowed.
    #[error(
        "the potential of electrode {electrode} under stimulation {stimulation} is {value_v} V: \
         the currents, conductivities and contact impedances together leave the range of numbers"
    )]
    NonFinitePotential {
        /// Stimulation index.
        stimulation: usize,
        /// 1-based number.
        electrode: usize,
        /// The potential, volt.
        value_v: f64,
    },
    /// A displacement names a node that does not exist.
    #[error("a displacement names node {node}, but the mesh has {nodes} nodes (from 0)")]
    NoSuchNode {
        /// Node index.
        node: usize,
        /// Nodes there are.
        nodes: usize,
    },
    /// Asked of a model of quadratic elements.
    #[error("{what} of quadratic elements: there for linear elements only")]
    LinearElementsOnly {
        /// What was asked for.
        what: &'static str,
    },
    /// A contact at a limit, where voltages have no derivative with respect to its impedance.
    #[error(
        "the contact impedance of electrode {electrode} is {value}: voltages have a derivative with \
         respect to it only above zero and below infinity"
    )]
    ContactLimit {
        /// 1-based number.
        electrode: usize,
        /// Its value, ohm metre (rim) or ohm square metre (patch).
        value: f64,
    },
    /// An electrode that cannot move along the rim.
    #[error("electrode {electrode} cannot move along the rim: {why}")]
    Immovable {
        /// 1-based number.
        electrode: usize,
        /// The reason.
        why: &'static str,
    },
    /// A node position is not a number.
    #[error("node {node} is moved to {position_m:?} m: positions must be finite")]
    NonFinitePosition {
        /// Node index.
        node: usize,
        /// Its position, metres.
        position_m: [f64; 3],
    },
    /// A moved triangle is empty.
    #[error("triangle {triangle} has the area {area_m2:e} m^2 after its nodes have moved")]
    ZeroArea {
        /// Triangle index.
        triangle: usize,
        /// Its area, square metres.
        area_m2: f64,
    },
    /// An electrode number of a list does not exist.
    #[error("{what} names electrode {number}, but the skin has electrodes 1 to {electrodes}")]
    NoSuchElectrode {
        /// Which list.
        what: &'static str,
        /// The number, from 1.
        number: usize,
        /// Electrodes there are.
        electrodes: usize,
    },
    /// A key of a touch script that cannot be.
    #[error("finger {finger}, key {key}: {quantity} is {value}: it must be {must}")]
    BadTouch {
        /// The finger's number.
        finger: u32,
        /// Index of the key, from 0.
        key: usize,
        /// The quantity with its unit.
        quantity: &'static str,
        /// Value given.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// Keys of a finger that do not follow each other in time.
    #[error("finger {finger}, key {key}: its time {time_s} s is not after {before_s} s before it")]
    UnsortedKeys {
        /// The finger's number.
        finger: u32,
        /// Index of the key, from 0.
        key: usize,
        /// Its time, seconds.
        time_s: f64,
        /// Time of the key before, seconds.
        before_s: f64,
    },
    /// A touch beside the skin.
    #[error("finger {finger}, {place}, {time_s} s: ({x_m}, {y_m}) m is not on the skin")]
    OutsideSkin {
        /// The finger's number.
        finger: u32,
        /// "at key N" or "on its way".
        place: String,
        /// Seconds.
        time_s: f64,
        /// Position, metres.
        x_m: f64,
        /// Position, metres.
        y_m: f64,
    },
    /// A force beyond the contact model.
    #[error(
        "finger {finger}, {time_s} s: {force_n} N on a tip of {radius_m} m makes a slope above one, \
         beyond the contact model: press less, take a larger tip, more tension or a stiffer foundation"
    )]
    ForceTooLarge {
        /// The finger's number.
        finger: u32,
        /// Seconds.
        time_s: f64,
        /// Newton.
        force_n: f64,
        /// Metres.
        radius_m: f64,
    },
    /// Touches that fold the mesh.
    #[error(
        "frame {frame}: the touches turn triangle {triangle} over ({area_ratio} of its area at \
         rest): press less, or touch further apart"
    )]
    FoldedMesh {
        /// Frame.
        frame: usize,
        /// Triangle index.
        triangle: usize,
        /// Area seen from above over that at rest.
        area_ratio: f64,
    },
    /// A curved skin where a flat one is needed.
    #[error("node {node} is {height_m} m above the plane z = 0: the simulated fabric is flat")]
    NotFlat {
        /// Node index.
        node: usize,
        /// z, metres.
        height_m: f64,
    },
    /// An outline whose centroid is in a hole or outside: no play circle.
    #[error("the centroid of the outline, ({x_m}, {y_m}) m, is not on the skin")]
    CentroidOffSkin {
        /// Position, metres.
        x_m: f64,
        /// Position, metres.
        y_m: f64,
    },
    /// More or larger fingers than a skin has room for.
    #[error(
        "{fingers} fingers cannot stay {apart_m} m apart within {reach_m} m of the skin's centre: \
         take fewer or smaller ones"
    )]
    NoRoom {
        /// Number of fingers.
        fingers: usize,
        /// Smallest distance of two, metres.
        apart_m: f64,
        /// Radius of the circle that holds all, metres.
        reach_m: f64,
    },
    /// A finger that leaves its part of the skin within a frame.
    #[error(
        "step_m is {step_m}: with {fingers} fingers it must be from 0 to {most_m:.1e} m, the radius \
         that each has for itself"
    )]
    StepTooLong {
        /// Way from frame to frame, metres.
        step_m: f64,
        /// Number of fingers.
        fingers: usize,
        /// Largest, metres.
        most_m: f64,
    },
    /// A touch script that there is not.
    #[error("there is no touch script \"{name}\": known are {known}")]
    UnknownScript {
        /// Name given.
        name: String,
        /// Names there are.
        known: String,
    },
    /// A parameter is out of range.
    #[error("{quantity} is {value}: it must be {must}")]
    OutOfRange {
        /// The quantity with its unit.
        quantity: &'static str,
        /// Value given.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// What else can be wrong with a factorisation.
    #[error(transparent)]
    Sparse(SparseError),
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
