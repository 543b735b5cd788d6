//! The error type of this crate.

/// An invalid mesh, skin description or mesh file.
///
/// Every variant carries the numbers involved. Node, triangle and edge indices are 0-based;
/// electrodes are identified by their 1-based number.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The surface has no triangles.
    #[error("the mesh has {nodes} nodes and no triangle: a skin needs at least one triangle")]
    NoTriangles {
        /// Number of nodes.
        nodes: usize,
    },
    /// There are more nodes or triangles than 32-bit indices can address.
    #[error("{count} {what} exceed the range of 32-bit indices: use a coarser mesh")]
    TooLarge {
        /// "nodes" or "triangles".
        what: &'static str,
        /// Their number.
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
    /// A triangle refers to a node that does not exist.
    #[error("triangle {triangle} refers to node {node}, but the mesh has {nodes} nodes")]
    UnknownNode {
        /// Triangle index.
        triangle: usize,
        /// Node index that was not found.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// A triangle has no area.
    #[error(
        "triangle {triangle} (nodes {nodes:?}) at {position_m:?} has an area of {area_m2:e} m2, \
         zero to rounding: remove it or move its nodes"
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
    /// A node belongs to no triangle.
    #[error("node {node} at {position_m:?} belongs to no triangle: remove it")]
    UnusedNode {
        /// Node index.
        node: usize,
        /// Its coordinates, metres.
        position_m: [f64; 3],
    },
    /// An edge belongs to three or more triangles.
    #[error(
        "edge {edge:?} at {position_m:?} belongs to {triangles} triangles: in a surface, at most 2 \
         triangles share an edge"
    )]
    NonManifoldEdge {
        /// Its nodes.
        edge: [u32; 2],
        /// Number of triangles that contain it.
        triangles: usize,
        /// Its midpoint, metres.
        position_m: [f64; 3],
    },
    /// The surface has only one side.
    #[error(
        "the surface cannot be oriented at triangle {triangle} at {position_m:?}: it is twisted \
         like a Moebius strip"
    )]
    NotOrientable {
        /// Triangle index.
        triangle: usize,
        /// Its centroid, metres.
        position_m: [f64; 3],
    },
    /// The surface is not connected.
    #[error(
        "the mesh has {parts} parts that share no edge; the part containing triangle {triangle} at \
         {position_m:?} has {part_triangles} of {triangles} triangles: keep one part or join them"
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
        /// Total number of triangles.
        triangles: usize,
    },
    /// An electrode has no edges or triangles.
    #[error("electrode {electrode} covers nothing: give it at least one rim edge or one triangle")]
    EmptyElectrode {
        /// 1-based electrode number.
        electrode: usize,
    },
    /// A rim electrode contains an edge that is not on the rim.
    #[error(
        "electrode {electrode} contains edge {edge:?} at {position_m:?}, which is not on the rim \
         of the skin"
    )]
    NotOnRim {
        /// 1-based electrode number.
        electrode: usize,
        /// The edge's nodes.
        edge: [u32; 2],
        /// Its midpoint, metres; NaN if its nodes do not exist.
        position_m: [f64; 3],
    },
    /// A patch electrode refers to a triangle that does not exist.
    #[error(
        "electrode {electrode} refers to triangle {triangle}, but the mesh has {triangles} \
         triangles"
    )]
    UnknownTriangle {
        /// 1-based electrode number.
        electrode: usize,
        /// Triangle index that was not found.
        triangle: u32,
        /// Number of triangles.
        triangles: usize,
    },
    /// Two electrodes claim the same edge or triangle (or one electrode claims it twice).
    #[error(
        "electrodes {first} and {second} overlap on {place}: each edge or triangle belongs to at \
         most one electrode"
    )]
    OverlappingElements {
        /// 1-based electrode number.
        first: usize,
        /// 1-based electrode number.
        second: usize,
        /// "edge [a, b]" or "triangle t".
        place: String,
    },
    /// A length, width or count in the skin's description is out of range.
    #[error("{quantity} is {value}: it must be {must}")]
    OutOfRange {
        /// The quantity with its unit, for example "radius_m".
        quantity: &'static str,
        /// Value that was rejected.
        value: f64,
        /// The condition it must satisfy.
        must: &'static str,
    },
    /// Two electrodes overlap along the rim.
    #[error(
        "electrodes {first} and {second} overlap by {overlap_m:.3e} m of rim: their centres are \
         {distance_m:.3e} m apart and they are {width_m:.3e} m wide; make them narrower or fewer"
    )]
    OverlappingElectrodes {
        /// 1-based electrode number.
        first: usize,
        /// 1-based electrode number.
        second: usize,
        /// Overlap, metres of rim.
        overlap_m: f64,
        /// Distance of the centres along the rim, metres.
        distance_m: f64,
        /// Mean of the two widths, metres of rim.
        width_m: f64,
    },
    /// An electrode position is not on the rim.
    #[error(
        "electrode {electrode} at {position_m:?} is {distance_m:.3e} m from the rim: a rim \
         electrode must lie within {tolerance_m:.1e} m of it"
    )]
    OffRim {
        /// 1-based electrode number.
        electrode: usize,
        /// Position given, metres.
        position_m: [f64; 2],
        /// Distance to the nearest rim point, metres.
        distance_m: f64,
        /// Largest distance accepted, metres.
        tolerance_m: f64,
    },
    /// An outline crosses itself, or a hole is not inside it.
    #[error("the outline is invalid at [{x_m}, {y_m}]: {problem}")]
    BadOutline {
        /// x coordinate of the problem, metres.
        x_m: f64,
        /// y coordinate of the problem, metres.
        y_m: f64,
        /// What is wrong at that point.
        problem: &'static str,
    },
    /// Refinement reached the node limit.
    #[error(
        "meshing stopped at {nodes} nodes before reaching the requested edge length: raise edge_m \
         or the node limit ({limit})"
    )]
    RefinementIncomplete {
        /// Nodes when it stopped.
        nodes: usize,
        /// Largest number that is accepted.
        limit: usize,
    },
    /// A mesh file cannot be read.
    #[error("{file}: {}{problem}", line_of(*line))]
    Parse {
        /// File name as given.
        file: String,
        /// 1-based line, or 0 if the error concerns the whole file.
        line: usize,
        /// What is wrong and how to fix it.
        problem: String,
    },
    /// The operating system reported an error.
    #[error("{path}: {reason}")]
    Io {
        /// Path as given.
        path: String,
        /// Message of the operating system.
        reason: String,
    },
    /// An array has the wrong length.
    #[error("{what}: {found} values, but the mesh needs {wanted}")]
    WrongLength {
        /// Which array.
        what: &'static str,
        /// Number of values given.
        found: usize,
        /// Number of values needed.
        wanted: usize,
    },
    /// The raster is so coarse, or the skin so thin, that no pixel is at least half covered.
    #[error(
        "none of the {pixels} x {pixels} pixels is half covered by the skin (the largest covered \
         fraction is {largest:.3}): use more pixels"
    )]
    NoMaskedPixel {
        /// Pixels per side.
        pixels: usize,
        /// Largest covered fraction of any pixel.
        largest: f64,
    },
    /// The surface is edge-on when seen from +z.
    #[error(
        "seen from +z, only {projected_m2:e} m2 of the surface's {area_m2:e} m2 is visible: rotate \
         or flatten it before rasterising"
    )]
    UprightSurface {
        /// Projected area, square metres.
        projected_m2: f64,
        /// Area, square metres.
        area_m2: f64,
    },
    /// Part of the surface faces away from +z, so a pixel would mix two layers.
    #[error(
        "triangle {triangle} faces away from +z, unlike the rest of the surface: a raster would \
         mix two layers; cut or flatten the surface before rasterising"
    )]
    FoldedSurface {
        /// Triangle index.
        triangle: usize,
    },
    /// Triangles overlap when seen from +z.
    #[error(
        "triangle {triangle} overlaps others in pixel [{row}, {column}] when seen from +z: a \
         raster would mix two layers; cut or flatten the surface before rasterising"
    )]
    OverlappingSheets {
        /// Triangle index.
        triangle: usize,
        /// Pixel row.
        row: usize,
        /// Pixel column.
        column: usize,
    },
    /// Two electrodes on the rim are so close that they touch.
    #[error(
        "electrodes {first} and {second} leave a gap of {gap_m:.3e} m of rim: touching electrodes \
         act as one conductor; leave at least {least_m:.1e} m"
    )]
    TouchingElectrodes {
        /// 1-based electrode number.
        first: usize,
        /// 1-based electrode number.
        second: usize,
        /// Gap found, metres of rim.
        gap_m: f64,
        /// Smallest gap, metres of rim.
        least_m: f64,
    },
    /// The midpoint of a curved edge is invalid.
    #[error(
        "the midpoint of the edge between nodes {} and {} is {position_m:?} m: it must be finite \
         and at most half the edge length from the straight midpoint", edge[0], edge[1]
    )]
    BadMidpoint {
        /// Nodes of the edge.
        edge: [u32; 2],
        /// Position given, metres.
        position_m: [f64; 3],
    },
    /// A field name is not valid in the file format.
    #[error(
        "the field name {name:?} is not valid in this file: it must not contain quotes or control \
         characters, nor be \"electrode\""
    )]
    BadFieldName {
        /// Name that is not known.
        name: String,
    },
    /// The mesh would far exceed the node limit; detected before any meshing.
    #[error(
        "an edge length of {edge_m:e} m needs about {expected:.1e} nodes, but the limit is \
         {limit}: raise edge_m or node_limit"
    )]
    TooManyNodes {
        /// Requested edge length, metres.
        edge_m: f64,
        /// Expected number of nodes.
        expected: f64,
        /// Largest number that is accepted.
        limit: usize,
    },
    /// An electrode position is too far from the skin.
    #[error(
        "electrode {electrode} at {position_m:?} is {distance_m:.3e} m from the nearest {what} (at \
         most {tolerance_m:.1e} m is allowed): move it, or check the unit of the file (scale_m)"
    )]
    OffSurface {
        /// 1-based electrode number.
        electrode: usize,
        /// Position given, metres.
        position_m: [f64; 3],
        /// Distance to the nearest point, metres.
        distance_m: f64,
        /// Largest distance accepted, metres.
        tolerance_m: f64,
        /// "point of the skin" or "point of its rim".
        what: &'static str,
    },
    /// The rim passes through one node more than once.
    #[error(
        "the rim passes through node {node} at {position_m:?} more than once, so positions along \
         the rim are ambiguous; widen the skin there or split the node in two"
    )]
    PinchedRim {
        /// Node index.
        node: usize,
        /// Its coordinates, metres.
        position_m: [f64; 3],
    },
    /// A rim electrode was given for a skin that has no rim.
    #[error(
        "electrode {electrode} is a rim electrode, but the skin is closed and has no rim: give it a \
         radius_m instead of a width_m"
    )]
    NoRim {
        /// 1-based electrode number.
        electrode: usize,
    },
    /// A patch does not lie entirely on the skin.
    #[error("the patch of electrode {electrode} at {position_m:?} {problem}")]
    BadPatch {
        /// 1-based electrode number.
        electrode: usize,
        /// Position of the problem, metres.
        position_m: [f64; 3],
        /// What is wrong there and how to fix it.
        problem: &'static str,
    },
    /// Two patches overlap or are too close.
    #[error(
        "the patches of electrodes {first} and {second} lie {gap_m:.3e} m apart (negative: they \
         overlap): leave at least {least_m:.1e} m, or make them smaller"
    )]
    OverlappingPatches {
        /// 1-based electrode number.
        first: usize,
        /// 1-based electrode number.
        second: usize,
        /// Distance between their outlines, metres.
        gap_m: f64,
        /// Smallest gap, metres.
        least_m: f64,
    },
    /// An electrode's width or radius is out of range.
    #[error("electrode {electrode}: {quantity} is {value}: it must be {must}")]
    ElectrodeSize {
        /// 1-based electrode number.
        electrode: usize,
        /// "width_m" or "radius_m".
        quantity: &'static str,
        /// Value that was rejected.
        value: f64,
        /// The condition it must satisfy.
        must: &'static str,
    },
}

impl MeshError {
    pub(crate) fn check_length(
        what: &'static str,
        found: usize,
        wanted: usize,
    ) -> Result<(), Self> {
        if found == wanted { Ok(()) } else { Err(Self::WrongLength { what, found, wanted }) }
    }

    pub(crate) fn check_range(
        is_valid: bool,
        quantity: &'static str,
        value: f64,
        must: &'static str,
    ) -> Result<(), Self> {
        if is_valid { Ok(()) } else { Err(Self::OutOfRange { quantity, value, must }) }
    }
}

/// The line of a problem; nothing for one of the whole file.
fn line_of(line: usize) -> String {
    if line == 0 { String::new() } else { format!("line {line}: ") }
}
