//! The one error type of this crate. One long file: the enum is one list.

/// What can be wrong with a mesh, a skin's description or a mesh file.
///
/// Every variant carries the numbers that were found. Indices of nodes, triangles and edges are
/// 0-based; electrodes are named by their 1-based number, as on a skin.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A surface needs at least one triangle.
    #[error("the mesh has {nodes} nodes and no triangle: a skin needs at least one triangle")]
    NoTriangles {
        /// Nodes found.
        nodes: usize,
    },
    /// More nodes or triangles than 32-bit indices can name.
    #[error("{count} {what} are more than 32-bit indices can name: use a coarser mesh")]
    TooLarge {
        /// "nodes" or "triangles".
        what: &'static str,
        /// How many.
        count: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("node {node} has the coordinates {position_m:?}: every coordinate must be finite")]
    NonFiniteNode {
        /// Node index.
        node: usize,
        /// Its coordinates, metres.
        position_m: [f64; 3],
    },
    /// A triangle names a node that does not exist.
    #[error("triangle {triangle} names node {node}, but the mesh has {nodes} nodes")]
    UnknownNode {
        /// Triangle index.
        triangle: usize,
        /// Node it names.
        node: u32,
        /// Nodes there are.
        nodes: usize,
    },
    /// A triangle without area.
    #[error(
        "triangle {triangle} (nodes {nodes:?}) at {position_m:?} has the area {area_m2:e} m2, zero to \
         rounding: remove it or move its nodes"
    )]
    ZeroArea {
        /// Triangle index.
        triangle: usize,
        /// Its nodes.
        nodes: [u32; 3],
        /// Its area, square metres.
        area_m2: f64,
        /// Its centroid, metres.
        position_m: [f64; 3],
    },
    /// A node that belongs to no triangle.
    #[error("node {node} at {position_m:?} belongs to no triangle: remove it")]
    UnusedNode {
        /// Node index.
        node: usize,
        /// Its coordinates, metres.
        position_m: [f64; 3],
    },
    /// An edge with three triangles or more.
    #[error(
        "edge {edge:?} at {position_m:?} belongs to {triangles} triangles: a skin is a surface, at \
         most 2 meet"
    )]
    NonManifoldEdge {
        /// Its nodes.
        edge: [u32; 2],
        /// Triangles found on it.
        triangles: usize,
        /// Its middle, metres.
        position_m: [f64; 3],
    },
    /// The two sides of the surface cannot be told apart.
    #[error(
        "the surface cannot be oriented at triangle {triangle} at {position_m:?}: it is twisted like a \
         Moebius band"
    )]
    NotOrientable {
        /// Triangle index.
        triangle: usize,
        /// Its centroid, metres.
        position_m: [f64; 3],
    },
    /// The surface falls apart.
    #[error(
        "the mesh has {parts} parts that share no edge; the part of triangle {triangle} at \
         {position_m:?} has {part_triangles} of {triangles} triangles: keep one part, or join them"
    )]
    Unconnected {
        /// Number of parts.
        parts: usize,
        /// First triangle of the smallest part.
        triangle: usize,
        /// Its centroid, metres.
        position_m: [f64; 3],
        /// Triangles in the smallest part.
        part_triangles: usize,
        /// Triangles in all.
        triangles: usize,
    },
    /// An electrode without edges or triangles.
    #[error("electrode {electrode} covers nothing: give it at least one rim edge or one triangle")]
    EmptyElectrode {
        /// 1-based number.
        electrode: usize,
    },
    /// A rim electrode on an edge that is not on the rim.
    #[error(
        "electrode {electrode} names edge {edge:?} at {position_m:?}, which is not on the rim of \
         the skin"
    )]
    NotOnRim {
        /// 1-based number.
        electrode: usize,
        /// The edge's nodes.
        edge: [u32; 2],
        /// Its middle, metres; its nodes may not exist: NaN then.
        position_m: [f64; 3],
    },
    /// A patch electrode names a triangle that does not exist.
    #[error("electrode {electrode} names triangle {triangle}, but the mesh has {triangles}")]
    UnknownTriangle {
        /// 1-based number.
        electrode: usize,
        /// Triangle it names.
        triangle: u32,
        /// Triangles there are.
        triangles: usize,
    },
    /// Two electrodes claim the same edge or triangle (or one electrode claims it twice).
    #[error("electrodes {first} and {second} overlap on {place}: each place has one electrode")]
    OverlappingElements {
        /// 1-based number.
        first: usize,
        /// 1-based number.
        second: usize,
        /// "edge [a, b]" or "triangle t".
        place: String,
    },
    /// A length, width or count of the skin's description is out of its range.
    #[error("{quantity} is {value}: it must be {must}")]
    OutOfRange {
        /// The quantity with its unit, for example "radius_m".
        quantity: &'static str,
        /// The value given.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// Electrodes that run into each other along the rim.
    #[error(
        "electrodes {first} and {second} overlap by {overlap_m:.3e} m of rim: their centres are \
         {distance_m:.3e} m apart and they are {width_m:.3e} m wide; make them narrower or fewer"
    )]
    OverlappingElectrodes {
        /// 1-based number.
        first: usize,
        /// 1-based number.
        second: usize,
        /// Overlap, metres of rim.
        overlap_m: f64,
        /// Distance of the centres along the rim, metres.
        distance_m: f64,
        /// Mean of the two widths, metres of rim.
        width_m: f64,
    },
    /// An electrode position that is not on the rim.
    #[error(
        "electrode {electrode} at {position_m:?} is {distance_m:.3e} m from the rim: a rim \
         electrode lies on it (within {tolerance_m:.1e} m)"
    )]
    OffRim {
        /// 1-based number.
        electrode: usize,
        /// Position given, metres.
        position_m: [f64; 2],
        /// Distance to the nearest rim point, metres.
        distance_m: f64,
        /// Tolerance, metres.
        tolerance_m: f64,
    },
    /// An outline that crosses itself, or a hole that is not inside.
    #[error("the outline is not usable at [{x_m}, {y_m}]: {problem}")]
    BadOutline {
        /// Where, metres.
        x_m: f64,
        /// Where, metres.
        y_m: f64,
        /// What is wrong there.
        problem: &'static str,
    },
    /// Refinement ran into its cap.
    #[error(
        "meshing stopped at {nodes} nodes before the wanted edge length was reached: raise \
         edge_m or the node limit ({limit})"
    )]
    RefinementIncomplete {
        /// Nodes at the stop.
        nodes: usize,
        /// The cap.
        limit: usize,
    },
    /// A mesh file that cannot be read.
    #[error("{file}: line {line}: {problem}")]
    Parse {
        /// File name as given.
        file: String,
        /// 1-based line, 0 where the whole file is meant.
        line: usize,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// The operating system refused.
    #[error("{path}: {reason}")]
    Io {
        /// Path as given.
        path: String,
        /// The system's words.
        reason: String,
    },
    /// An array has the wrong length.
    #[error("{what}: {found} values, but the mesh needs {wanted}")]
    WrongLength {
        /// Which array.
        what: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        wanted: usize,
    },
    /// A raster so coarse, or a skin so thin, that no pixel is half covered.
    #[error(
        "of {pixels} x {pixels} pixels none is half covered by the skin (the fullest to \
         {largest:.3}): use more pixels"
    )]
    NoMaskedPixel {
        /// Pixels on a side.
        pixels: usize,
        /// Largest covered fraction of a pixel.
        largest: f64,
    },
    /// A surface on edge seen from +z has no picture.
    #[error(
        "seen from +z the surface has {projected_m2:e} m2 of its {area_m2:e} m2: turn or flatten \
         it before it is rasterised"
    )]
    UprightSurface {
        /// Projected area, square metres.
        projected_m2: f64,
        /// Area, square metres.
        area_m2: f64,
    },
    /// Part of the surface looks away from +z, so pixels would mix two sheets.
    #[error(
        "triangle {triangle} looks away from +z, where the rest looks to it: a raster would mix \
         two sheets; cut or flatten the surface before it is rasterised"
    )]
    FoldedSurface {
        /// Triangle index.
        triangle: usize,
    },
    /// Triangles lie over one another seen from +z.
    #[error(
        "triangle {triangle} lies over others in pixel [{row}, {column}] seen from +z: a raster \
         would mix two sheets; cut or flatten the surface before it is rasterised"
    )]
    OverlappingSheets {
        /// Triangle index.
        triangle: usize,
        /// Pixel row.
        row: usize,
        /// Pixel column.
        column: usize,
    },
    /// Electrodes so close along the rim that they touch.
    #[error(
        "electrodes {first} and {second} leave a gap of {gap_m:.3e} m of rim: touching electrodes \
         are one conductor; leave at least {least_m:.1e} m"
    )]
    TouchingElectrodes {
        /// 1-based number.
        first: usize,
        /// 1-based number.
        second: usize,
        /// Gap found, metres of rim.
        gap_m: f64,
        /// Smallest gap, metres of rim.
        least_m: f64,
    },
    /// The middle of a curve that cannot be.
    #[error(
        "the middle of the edge between nodes {} and {} is put at {position_m:?} m: it must be finite \
         and within half the edge of its straight middle", edge[0], edge[1]
    )]
    BadMidpoint {
        /// Its nodes.
        edge: [u32; 2],
        /// Position given, metres.
        position_m: [f64; 3],
    },
    /// A field's name that the file format cannot hold.
    #[error(
        "the field name {name:?} cannot stand in this file: no quotes, no control characters, \
         not \"electrode\""
    )]
    BadFieldName {
        /// The name given.
        name: String,
    },
    /// A mesh far beyond the node limit, refused before any work.
    #[error(
        "an edge length of {edge_m:e} m needs about {expected:.1e} nodes, but the limit is \
         {limit}: raise edge_m or node_limit"
    )]
    TooManyNodes {
        /// Edge length asked for, metres.
        edge_m: f64,
        /// Nodes expected.
        expected: f64,
        /// The limit.
        limit: usize,
    },
    /// An electrode position that is on no part of the skin.
    #[error(
        "electrode {electrode} at {position_m:?} is {distance_m:.3e} m from the nearest {what} (within \
         {tolerance_m:.1e} m is on it): move it, or look at the unit of the file (scale_m)"
    )]
    OffSurface {
        /// 1-based number.
        electrode: usize,
        /// Position given, metres.
        position_m: [f64; 3],
        /// Distance to the nearest point, metres.
        distance_m: f64,
        /// Tolerance, metres.
        tolerance_m: f64,
        /// "point of the skin" or "point of its rim".
        what: &'static str,
    },
    /// A rim that goes through one node more than once.
    #[error(
        "the rim goes through node {node} at {position_m:?} more than once: there, rim lengths have no \
         order; widen the place or cut the node in two"
    )]
    PinchedRim {
        /// Node index.
        node: usize,
        /// Its coordinates, metres.
        position_m: [f64; 3],
    },
    /// A rim electrode on a skin that has no rim.
    #[error(
        "electrode {electrode} is a rim electrode, but the skin is closed and has no rim: give it a \
         radius_m instead of a width_m"
    )]
    NoRim {
        /// 1-based number.
        electrode: usize,
    },
    /// A patch that is not on the skin whole.
    #[error("the patch of electrode {electrode} at {position_m:?} {problem}")]
    BadPatch {
        /// 1-based number.
        electrode: usize,
        /// Where, metres.
        position_m: [f64; 3],
        /// What is wrong there and how to mend it.
        problem: &'static str,
    },
    /// Two patches on the same place.
    #[error(
        "the patches of electrodes {first} and {second} lie {gap_m:.3e} m apart (below zero: over \
         one another): leave at least {least_m:.1e} m, or make them smaller"
    )]
    OverlappingPatches {
        /// 1-based number.
        first: usize,
        /// 1-based number.
        second: usize,
        /// Distance of their outlines, metres.
        gap_m: f64,
        /// Smallest gap, metres.
        least_m: f64,
    },
    /// An electrode's width or radius is out of its range.
    #[error("electrode {electrode}: {quantity} is {value}: it must be {must}")]
    ElectrodeSize {
        /// 1-based number.
        electrode: usize,
        /// "width_m" or "radius_m".
        quantity: &'static str,
        /// The value given.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
}
