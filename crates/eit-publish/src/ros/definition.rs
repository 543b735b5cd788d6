//! Type hashes (RIHS01): SHA-256 of the description of a type as JSON. The descriptions are read from the
//! definitions that ROS 2 itself is given, so that both cannot differ.

use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Definitions by type. Those of other packages are the fields of the released ones, without comments.
const DEFINITIONS: &[(&str, &str)] = &[
    ("builtin_interfaces/msg/Time", "int32 sec\nuint32 nanosec"),
    ("std_msgs/msg/String", "string data"),
    ("std_msgs/msg/Header", "builtin_interfaces/Time stamp\nstring frame_id"),
    ("geometry_msgs/msg/Point", "float64 x\nfloat64 y\nfloat64 z"),
    ("geometry_msgs/msg/Vector3", "float64 x\nfloat64 y\nfloat64 z"),
    ("geometry_msgs/msg/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"),
    ("geometry_msgs/msg/Pose", "Point position\nQuaternion orientation"),
    ("geometry_msgs/msg/PoseStamped", "std_msgs/Header header\nPose pose"),
    (
        "sensor_msgs/msg/Image",
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n\
         uint32 step\nuint8[] data",
    ),
    ("sensor_msgs/msg/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data"),
    ("builtin_interfaces/msg/Duration", "int32 sec\nuint32 nanosec"),
    ("std_msgs/msg/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a"),
    ("geometry_msgs/msg/Transform", "Vector3 translation\nQuaternion rotation"),
    (
        "geometry_msgs/msg/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\nTransform transform",
    ),
    ("tf2_msgs/msg/TFMessage", "geometry_msgs/TransformStamped[] transforms"),
    ("visualization_msgs/msg/UVCoordinate", "float32 u\nfloat32 v"),
    ("visualization_msgs/msg/MeshFile", "string filename\nuint8[] data"),
    (
        "visualization_msgs/msg/Marker",
        "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n\
         geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
         builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n\
         std_msgs/ColorRGBA[] colors\nstring texture_resource\n\
         sensor_msgs/CompressedImage texture\nUVCoordinate[] uv_coordinates\nstring text\n\
         string mesh_resource\nMeshFile mesh_file\nbool mesh_use_embedded_materials",
    ),
    ("visualization_msgs/msg/MarkerArray", "Marker[] markers"),
    (
        "nav_msgs/msg/MapMetaData",
        "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\n\
         geometry_msgs/Pose origin",
    ),
    ("nav_msgs/msg/OccupancyGrid", "std_msgs/Header header\nMapMetaData info\nint8[] data"),
    ("diagnostic_msgs/msg/KeyValue", "string key\nstring value"),
    (
        "diagnostic_msgs/msg/DiagnosticStatus",
        "byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values",
    ),
    ("diagnostic_msgs/msg/DiagnosticArray", "std_msgs/Header header\nDiagnosticStatus[] status"),
    (
        "eit_skin_msgs/msg/ElectrodeFault",
        include_str!("../../ros/eit_skin_msgs/msg/ElectrodeFault.msg"),
    ),
    ("eit_skin_msgs/msg/Touch", include_str!("../../ros/eit_skin_msgs/msg/Touch.msg")),
    ("eit_skin_msgs/msg/TouchArray", include_str!("../../ros/eit_skin_msgs/msg/TouchArray.msg")),
    ("eit_skin_msgs/msg/PatchState", include_str!("../../ros/eit_skin_msgs/msg/PatchState.msg")),
    ("eit_skin_msgs/msg/BodyTouch", include_str!("../../ros/eit_skin_msgs/msg/BodyTouch.msg")),
    (
        "eit_skin_msgs/msg/BodyTouchArray",
        include_str!("../../ros/eit_skin_msgs/msg/BodyTouchArray.msg"),
    ),
];

/// Numbers of `type_description_interfaces/msg/FieldType`.
const PRIMITIVES: &[(&str, u8)] = &[
    ("int8", 2),
    ("uint8", 3),
    ("int16", 4),
    ("uint16", 5),
    ("int32", 6),
    ("uint32", 7),
    ("int64", 8),
    ("uint64", 9),
    ("float32", 10),
    ("float64", 11),
    ("bool", 15),
    ("byte", 16),
    ("string", 17),
];
/// A type with a definition of its own.
const NESTED: u8 = 1;
/// Added for an array of fixed length, and for a sequence without a bound.
const ARRAY: u8 = 48;
const SEQUENCE: u8 = 144;

/// A field of a ROS 2 message: type, name and array length.
struct Field<'a> {
    name: &'a str,
    kind: u8,
    capacity: u64,
    /// Type of a field that has a definition of its own, else empty.
    nested: String,
}

/// Type hash such as `RIHS01_df66...`; `None` for a type without a definition here.
pub fn type_hash(name: &str) -> Option<String> {
    let mut wanted = vec![name.to_owned()];
    let mut known = BTreeMap::new();
    while let Some(next) = wanted.pop() {
        if known.contains_key(&next) {
            continue;
        }
        let (package, _) = next.split_once('/')?;
        let (_, text) = DEFINITIONS.iter().find(|(known, _)| *known == next)?;
        let fields: Vec<Field<'_>> =
            text.lines().filter_map(|line| field(line, package)).collect::<Option<_>>()?;
        let nested = fields.iter().map(|field| &field.nested).filter(|nested| !nested.is_empty());
        wanted.extend(nested.cloned());
        known.insert(next, fields);
    }
    let described = describe(name, &known.remove(name)?);
    // in alphabetical order
    let referenced: Vec<String> =
        known.iter().map(|(name, fields)| describe(name, fields)).collect();
    let json = format!(
        "{{\"type_description\": {described}, \"referenced_type_descriptions\": [{}]}}",
        referenced.join(", ")
    );
    let mut hash = String::from("RIHS01_");
    for byte in Sha256::digest(json.as_bytes()) {
        // writing to a String does not fail
        let _ = write!(hash, "{byte:02x}");
    }
    Some(hash)
}

/// A line of a definition: `None` for a comment or a constant, `Some(None)` for one that is not understood.
fn field<'a>(line: &'a str, package: &str) -> Option<Option<Field<'a>>> {
    let line = line.split('#').next().unwrap_or_default();
    let mut words = line.split_whitespace();
    let kind = words.next()?;
    let Some(name) = words.next() else { return Some(None) };
    // a constant has no place in a message
    if line.contains('=') {
        return None;
    }
    let (base, length) = match kind.strip_suffix(']').and_then(|kind| kind.split_once('[')) {
        Some((base, length)) => (base, Some(length)),
        None => (kind, None),
    };
    let (added, capacity) = match length {
        None => (0, 0),
        Some("") => (SEQUENCE, 0),
        Some(length) => match length.parse() {
            Ok(capacity) => (ARRAY, capacity),
            Err(_) => return Some(None),
        },
    };
    let primitive = PRIMITIVES.iter().find(|(name, _)| *name == base);
    let (kind, nested) = match (primitive, base.split_once('/')) {
        (Some((_, kind)), _) => (*kind, String::new()),
        (None, Some((package, name))) => (NESTED, format!("{package}/msg/{name}")),
        (None, None) => (NESTED, format!("{package}/msg/{base}")),
    };
    Some(Some(Field { name, kind: kind + added, capacity, nested }))
}

/// The description of one type; names need no escapes.
fn describe(name: &str, fields: &[Field<'_>]) -> String {
    let fields: Vec<String> = fields
        .iter()
        .map(|field| {
            format!(
                "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {}, \
                 \"string_capacity\": 0, \"nested_type_name\": \"{}\"}}}}",
                field.name, field.kind, field.capacity, field.nested
            )
        })
        .collect();
    format!("{{\"type_name\": \"{name}\", \"fields\": [{}]}}", fields.join(", "))
}
