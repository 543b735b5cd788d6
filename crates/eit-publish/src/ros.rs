//! ROS 2 messages as `rmw_zenoh` sends them, without a ROS installation: CDR payloads, type hashes, keys and
//! attachments.
//!
//! A ROS 2 node that runs `rmw_zenoh_cpp` receives a message if four things agree: the zenoh key
//! `DOMAIN/TOPIC/TYPE/HASH`, the payload (XCDR version 1, little-endian, behind a header of four bytes), the
//! attachment (sequence number, time, identity of the publisher), and a liveliness token that announces the
//! publisher. The first three carry the data; the token makes the publisher visible to `ros2 topic list`.
//!
//! Sources: the design document and source of `rmw_zenoh` (attachment since its version 0.2.4); REP 2011 and
//! `rosidl_generator_type_description` for type hashes.

mod cdr;
mod convert;
mod definition;
mod keys;
mod message;
mod shown;

pub use cdr::{from_cdr, to_cdr};
pub use definition::type_hash;
pub(crate) use keys::TF_STATIC;
pub use keys::{Attachment, Endpoint, check_topic};
pub use message::{
    BodyTouch, BodyTouchArray, DiagnosticArray, DiagnosticStatus, ElectrodeFaultMessage, Header,
    Image, KeyValue, PatchState, Point, Pose, PoseStamped, Quaternion, RosMessage, Time,
    TouchArray, TouchMessage, Vector3, skin_state, touch_state,
};
pub use shown::{Marker, MarkerArray, OccupancyGrid, TfMessage, TransformStamped};
