//! Messages of ROS 2's packages that its tools show without code of ours: touches as markers, an image as a map, and the poses of
//! patches as transforms. Fields that are not used are empty.

use super::message::{Header, Point, Pose, Quaternion, RosMessage, Time, TouchMessage, Vector3};
use super::touch_state;
use serde::{Deserialize, Serialize};

/// Actions and types of `visualization_msgs/msg/Marker`.
const ADD: i32 = 0;
const DELETE_ALL: i32 = 3;
const SPHERE: i32 = 2;
const TEXT: i32 = 9;
/// Markers vanish when nothing has been published for so long.
const LIFETIME: Time = Time { sec: 0, nanosec: 500_000_000 };
/// Width of a fingertip, and height of a letter, metres.
const TIP_M: f64 = 15e-3;
const LETTER_M: f64 = 10e-3;
/// Red, green, blue and opacity.
const RED: [f32; 3] = [0.9, 0.15, 0.2];

/// `visualization_msgs/msg/Marker`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the fields are those of the definition")]
pub struct Marker {
    pub header: Header,
    pub ns: String,
    pub id: i32,
    pub kind: i32,
    pub action: i32,
    pub pose: Pose,
    pub scale: Vector3,
    pub color: [f32; 4],
    pub lifetime: Time,
    pub frame_locked: bool,
    pub points: Vec<Point>,
    pub colors: Vec<[f32; 4]>,
    pub texture_resource: String,
    pub texture: (Header, String, Vec<u8>),
    pub uv_coordinates: Vec<[f32; 2]>,
    pub text: String,
    pub mesh_resource: String,
    pub mesh_file: (String, Vec<u8>),
    pub mesh_use_embedded_materials: bool,
}

/// `visualization_msgs/msg/MarkerArray`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MarkerArray {
    /// What to draw.
    pub markers: Vec<Marker>,
}

impl RosMessage for MarkerArray {
    const TYPE: &'static str = "visualization_msgs/msg/MarkerArray";
}

impl MarkerArray {
    /// Replaces all markers by spheres at touches, pale where they are not valid, with their numbers and forces, and by the reason why
    /// touches are not known.
    pub fn of_touches<'a>(
        header: &Header,
        touches: impl Iterator<Item = &'a TouchMessage>,
        not_known: Option<String>,
    ) -> Self {
        let one = |kind: i32, [x, y, z]: [f64; 3], size_m: f64, alpha: f32, text: String| Marker {
            header: header.clone(),
            ns: "touches".to_owned(),
            kind,
            action: ADD,
            pose: Pose { position: Point { x, y, z }, orientation: Quaternion::default() },
            scale: [size_m; 3].into(),
            color: [RED[0], RED[1], RED[2], alpha],
            lifetime: LIFETIME,
            text,
            ..Marker::default()
        };
        let mut markers =
            vec![Marker { header: header.clone(), action: DELETE_ALL, ..Marker::default() }];
        for touch in touches.filter(|touch| touch.state != touch_state::END) {
            let at: [f64; 3] = touch.position.into();
            let alpha = if touch.valid { 0.9 } else { 0.35 };
            let label = match touch.force.is_finite() {
                true => format!("{} {:.1} N", touch.id, touch.force),
                false => touch.id.to_string(),
            };
            let above = [at[0], at[1], at[2] + TIP_M];
            markers.push(one(SPHERE, at, TIP_M, alpha, String::new()));
            markers.push(one(TEXT, above, LETTER_M, 1.0, label));
        }
        markers.extend(not_known.map(|why| one(TEXT, [0.0; 3], LETTER_M, 1.0, why)));
        for (id, marker) in (0..).zip(&mut markers) {
            marker.id = id;
        }
        Self { markers }
    }
}

/// `geometry_msgs/msg/TransformStamped`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TransformStamped {
    /// Time and parent frame.
    pub header: Header,
    /// Child frame.
    pub child_frame_id: String,
    /// Origin of the child frame in the parent frame, metres.
    pub translation: Vector3,
    /// Rotation from child to parent coordinates.
    pub rotation: Quaternion,
}

/// `tf2_msgs/msg/TFMessage`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TfMessage {
    /// Poses of frames.
    pub transforms: Vec<TransformStamped>,
}

impl RosMessage for TfMessage {
    const TYPE: &'static str = "tf2_msgs/msg/TFMessage";
}

/// `nav_msgs/msg/OccupancyGrid`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct OccupancyGrid {
    /// Time and frame.
    pub header: Header,
    /// Time of the map.
    pub map_load_time: Time,
    /// Side of a cell, metres.
    pub resolution: f32,
    /// Number of cells along x.
    pub width: u32,
    /// Number of cells along y.
    pub height: u32,
    /// The corner with the least x and y.
    pub origin: Pose,
    /// Rows from the least y on: 0 to 100 of the largest change of conductivity, -1 outside the skin.
    pub data: Vec<i8>,
}

impl RosMessage for OccupancyGrid {
    const TYPE: &'static str = "nav_msgs/msg/OccupancyGrid";
}
