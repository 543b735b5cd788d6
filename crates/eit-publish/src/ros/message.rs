//! Messages. Fields, their order and types are those of the definitions (`ros/eit_skin_msgs` for our own);
//! their meaning is described there.

use serde::{Deserialize, Serialize, Serializer};

/// A message with a type of its own in ROS 2.
pub trait RosMessage: Serialize {
    /// Package, kind and name, such as `std_msgs/msg/Header`.
    const TYPE: &'static str;
}

/// Values of [`TouchMessage::state`].
pub mod touch_state {
    /// The first message about a touch.
    pub const BEGIN: u8 = 0;
    /// The touch continues.
    pub const HOLD: u8 = 1;
    /// The last message about a touch.
    pub const END: u8 = 2;
}

/// Values of [`TouchArray::state`] and [`PatchState::state`].
pub mod skin_state {
    use eit_skin::SkinState;

    const ALL: [SkinState; 5] = [
        SkinState::Sound,
        SkinState::NotExplained,
        SkinState::Frozen,
        SkinState::Reference,
        SkinState::NoData,
    ];

    /// The number of a state.
    pub fn number(state: SkinState) -> u8 {
        ALL.iter().position(|other| *other == state).map_or(0, |place| place as u8)
    }

    /// The state with this number; an unknown one says that nothing is known.
    pub fn of(number: u8) -> SkinState {
        ALL.get(usize::from(number)).copied().unwrap_or(SkinState::NoData)
    }
}

/// `builtin_interfaces/msg/Time`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Time {
    /// Seconds since 1970.
    pub sec: i32,
    /// Nanoseconds after that, below 1e9.
    pub nanosec: u32,
}

impl Time {
    /// Converts seconds since 1970; saturates at the ends of the type, and NaN becomes 0.
    pub fn from_seconds(seconds: f64) -> Self {
        let whole = seconds.floor();
        let nanoseconds = ((seconds - whole) * 1e9).round();
        // what rounds up to a second is one
        let carry = f64::from(u8::from(nanoseconds >= 1e9));
        let nanosec = (nanoseconds - 1e9 * carry).max(0.0);
        Self { sec: (whole + carry) as i32, nanosec: nanosec as u32 }
    }

    /// Seconds since 1970.
    pub fn seconds(self) -> f64 {
        f64::from(self.sec) + 1e-9 * f64::from(self.nanosec)
    }
}

/// `std_msgs/msg/Header`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Header {
    /// Time of the data.
    pub stamp: Time,
    /// Name of the coordinate frame.
    pub frame_id: String,
}

/// `geometry_msgs/msg/Point`, metres.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Point {
    /// First coordinate.
    pub x: f64,
    /// Second coordinate.
    pub y: f64,
    /// Third coordinate.
    pub z: f64,
}

impl From<[f64; 3]> for Point {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<Point> for [f64; 3] {
    fn from(point: Point) -> Self {
        [point.x, point.y, point.z]
    }
}

/// `geometry_msgs/msg/Vector3`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Vector3 {
    /// First component.
    pub x: f64,
    /// Second component.
    pub y: f64,
    /// Third component.
    pub z: f64,
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<Vector3> for [f64; 3] {
    fn from(vector: Vector3) -> Self {
        [vector.x, vector.y, vector.z]
    }
}

/// `geometry_msgs/msg/Quaternion`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// First component of the vector part.
    pub x: f64,
    /// Second component of the vector part.
    pub y: f64,
    /// Third component of the vector part.
    pub z: f64,
    /// Scalar part.
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

/// `geometry_msgs/msg/Pose`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// Origin of the child frame in the parent frame, metres.
    pub position: Point,
    /// Rotation from child to parent coordinates.
    pub orientation: Quaternion,
}

/// `geometry_msgs/msg/PoseStamped`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PoseStamped {
    /// Time and parent frame.
    pub header: Header,
    /// Pose relative to the parent frame.
    pub pose: Pose,
}

impl RosMessage for PoseStamped {
    const TYPE: &'static str = "geometry_msgs/msg/PoseStamped";
}

/// `sensor_msgs/msg/Image`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Image {
    /// Time and frame.
    pub header: Header,
    /// Number of rows.
    pub height: u32,
    /// Number of columns.
    pub width: u32,
    /// Type of a pixel, such as `32FC1`.
    pub encoding: String,
    /// 1 if pixels are big-endian.
    pub is_bigendian: u8,
    /// Bytes of a row.
    pub step: u32,
    /// Rows, the top one first.
    #[serde(serialize_with = "bytes")]
    pub data: Vec<u8>,
}

impl RosMessage for Image {
    const TYPE: &'static str = "sensor_msgs/msg/Image";
}

/// Encodes in one go; the same bytes as a sequence of `u8`.
fn bytes<S: Serializer>(data: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(data)
}

/// `diagnostic_msgs/msg/KeyValue`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct KeyValue {
    /// Name of the value.
    pub key: String,
    /// The value as text.
    pub value: String,
}

/// `diagnostic_msgs/msg/DiagnosticStatus`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    /// 0: sound, 1: warning, 2: error, 3: stale.
    pub level: u8,
    /// Name of the component.
    pub name: String,
    /// State of the component as text.
    pub message: String,
    /// Hardware of the component.
    pub hardware_id: String,
    /// Details.
    pub values: Vec<KeyValue>,
}

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// Time.
    pub header: Header,
    /// Components.
    pub status: Vec<DiagnosticStatus>,
}

impl RosMessage for DiagnosticArray {
    const TYPE: &'static str = "diagnostic_msgs/msg/DiagnosticArray";
}

/// `eit_skin_msgs/msg/ElectrodeFault`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ElectrodeFaultMessage {
    /// Number of the electrode, from 1.
    pub electrode: u16,
    /// 0: contradicts, 1: stuck, 2: drifts, 3: flagged.
    pub kind: u8,
    /// Time of the first faulty frame, seconds.
    pub since: f64,
}

/// `eit_skin_msgs/msg/Touch`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TouchMessage {
    /// Number of the touch, from 1.
    pub id: u64,
    /// One of [`touch_state`].
    pub state: u8,
    /// Position, metres.
    pub position: Point,
    /// Its covariance, row-major 3 x 3, square metres.
    pub position_covariance: [f64; 9],
    /// Unit normal of the skin; NaN if unknown.
    pub normal: Vector3,
    /// Velocity, metres per second.
    pub velocity: Vector3,
    /// Integral of the conductivity change, siemens times square metre.
    pub intensity: f64,
    /// Its standard deviation; NaN if unknown.
    pub intensity_std: f64,
    /// Force, newtons; NaN if unknown.
    pub force: f64,
    /// Its standard deviation; NaN if unknown.
    pub force_std: f64,
    /// Probability that there is a touch.
    pub confidence: f64,
    /// Time since it began, seconds.
    pub age: f64,
    /// Whether position and intensity can be acted on.
    pub valid: bool,
    /// Whether no measurement was left out.
    pub whole: bool,
    /// 0: no presses learnt, 1: like the learnt presses, 2: unlike them.
    pub likeness: u8,
    /// The touch that it split from; 0 if none.
    pub split_from: u64,
    /// The touch that it merged into; 0 if none.
    pub merged_into: u64,
}

/// `eit_skin_msgs/msg/TouchArray`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TouchArray {
    /// Time and frame.
    pub header: Header,
    /// Number of the frame.
    pub sequence: u64,
    /// Number of the connection.
    pub epoch: u32,
    /// Time by the instrument's clock, seconds.
    pub time: f64,
    /// From the last byte of the frame to its touches, seconds; NaN in a replay.
    pub latency: f64,
    /// Whether no measurement was left out.
    pub whole: bool,
    /// What is known of the skin: one of [`skin_state`].
    pub state: u8,
    /// Electrodes that were left out.
    pub faulty_electrodes: Vec<ElectrodeFaultMessage>,
    /// All touches in the frame.
    pub touches: Vec<TouchMessage>,
}

impl RosMessage for TouchArray {
    const TYPE: &'static str = "eit_skin_msgs/msg/TouchArray";
}

/// `eit_skin_msgs/msg/PatchState`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PatchState {
    /// Name of the patch, as in the settings of the body.
    pub name: String,
    /// Whether nothing is heard from it.
    pub silent: bool,
    /// What is known of its skin: one of [`skin_state`].
    pub state: u8,
    /// Age of its last message, seconds; NaN if there was none.
    pub age: f64,
    /// Messages received.
    pub received: u64,
    /// Messages lost on the way.
    pub lost: u64,
}

/// `eit_skin_msgs/msg/BodyTouch`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct BodyTouch {
    /// Name of the patch.
    pub patch: String,
    /// Number of the patch's connection to its instrument.
    pub epoch: u32,
    /// Time of the frame in which the touch was found.
    pub stamp: Time,
    /// The touch in the robot's frame.
    pub touch: TouchMessage,
}

/// `eit_skin_msgs/msg/BodyTouchArray`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct BodyTouchArray {
    /// Time and frame.
    pub header: Header,
    /// Every patch.
    pub patches: Vec<PatchState>,
    /// Touches of patches that are not silent.
    pub touches: Vec<BodyTouch>,
}

impl RosMessage for BodyTouchArray {
    const TYPE: &'static str = "eit_skin_msgs/msg/BodyTouchArray";
}
