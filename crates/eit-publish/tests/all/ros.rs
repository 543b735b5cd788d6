//! Messages, type hashes, keys and attachments against what independent programs make of them
//! (`ros/reference.json`, written by `ros/reference.py`).

use eit_publish::PublishError;
use eit_publish::ros::{
    Attachment, BodyTouch, BodyTouchArray, DiagnosticArray, DiagnosticStatus,
    ElectrodeFaultMessage, Endpoint, Header, Image, KeyValue, Marker, MarkerArray, OccupancyGrid,
    PatchState, Pose, PoseStamped, Quaternion, RosMessage, TfMessage, Time, TouchArray,
    TouchMessage, TransformStamped, check_topic, from_cdr, to_cdr, touch_state, type_hash,
};
use serde::de::DeserializeOwned;
use serde_json::Value;

fn reference() -> Value {
    serde_json::from_str(include_str!("ros/reference.json")).unwrap()
}

fn bytes(hex: &Value) -> Vec<u8> {
    let hex = hex.as_str().expect("hexadecimal digits");
    let pairs = (0..hex.len()).step_by(2);
    pairs.map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn header(sec: i32, nanosec: u32, frame_id: &str) -> Header {
    Header { stamp: Time { sec, nanosec }, frame_id: frame_id.to_owned() }
}

/// The header of most messages of the reference.
fn arm() -> Header {
    header(1_700_000_000, 250_000_000, "arm")
}

fn touch(id: u64, state: u8, force: f64) -> TouchMessage {
    TouchMessage {
        id,
        state,
        position: [0.03, -0.01, 0.0].into(),
        position_covariance: [4e-6, 1e-7, 0.0, 1e-7, 1e-6, 0.0, 0.0, 0.0, 0.0],
        normal: [0.6, 0.0, 0.8].into(),
        velocity: [0.1, 0.0, -0.25].into(),
        intensity: 2.5e-11,
        intensity_std: 1e-12,
        force,
        force_std: 0.125,
        confidence: 0.97,
        age: 0.12,
        valid: true,
        whole: false,
        likeness: 1,
        split_from: 0,
        merged_into: 3,
    }
}

fn untouched() -> TouchArray {
    TouchArray {
        header: Header { frame_id: "left_forearm".to_owned(), ..arm() },
        sequence: 100,
        epoch: 1,
        time: 2.0,
        latency: 0.002,
        whole: true,
        state: 0,
        ..TouchArray::default()
    }
}

fn touched() -> TouchArray {
    TouchArray {
        header: arm(),
        whole: false,
        state: 2,
        faulty_electrodes: vec![ElectrodeFaultMessage { electrode: 5, kind: 1, since: 1.5 }],
        touches: vec![touch(7, touch_state::HOLD, 1.5), touch(8, touch_state::END, 0.25)],
        ..untouched()
    }
}

/// Encodes to the reference, and decodes from it.
fn check<M: RosMessage + DeserializeOwned + PartialEq + std::fmt::Debug>(name: &str, message: &M) {
    let wanted = bytes(&reference()["messages"][name]);
    let mut payload = Vec::new();
    to_cdr(message, &mut payload).unwrap();
    assert_eq!(payload, wanted, "{name}");
    assert_eq!(from_cdr::<M>(&wanted).unwrap(), *message, "{name}");
}

#[test]
fn every_message_has_the_bytes_of_another_encoder() {
    check("touches", &touched());
    check("untouched", &untouched());
    let data = [1.5e-6_f32, -2e-6].iter().flat_map(|value| value.to_le_bytes()).collect();
    let encoding = "32FC1".into();
    let image =
        Image { header: arm(), height: 2, width: 1, encoding, is_bigendian: 0, step: 4, data };
    check("image", &image);
    let [name, message] = ["skin/arm: EIT skin arm", "faulty electrodes: 5"].map(String::from);
    let values = vec![KeyValue { key: "frames_per_second".into(), value: "100.0".into() }];
    let hardware_id = "board 7".into();
    let status = DiagnosticStatus { level: 1, name, message, hardware_id, values };
    let header_of = header(1_700_000_000, 0, "");
    check("diagnostics", &DiagnosticArray { header: header_of, status: vec![status] });
    let orientation = Quaternion { x: 0.0, y: 0.0, z: 1.0, w: 0.0 };
    let pose = Pose { position: [0.1, 0.2, 0.3].into(), orientation };
    check("pose", &PoseStamped { header: header(1, 2, "base_link"), pose });
    let patch =
        PatchState { name: "arm".into(), silent: false, state: 1, age: 0.05, received: 9, lost: 2 };
    let touch = touch(7, touch_state::HOLD, 1.5);
    let joined = BodyTouch { patch: "arm".into(), epoch: 1, stamp: arm().stamp, touch };
    let (patches, touches) = (vec![patch], vec![joined]);
    let header_of = header(1_700_000_001, 0, "base_link");
    check("body", &BodyTouchArray { header: header_of, patches, touches });
    let color = [0.5, 0.25, 0.125, 1.0];
    let marker = Marker {
        header: arm(),
        ns: "touches".into(),
        id: 1,
        kind: 9,
        pose,
        scale: [0.01; 3].into(),
        color,
        lifetime: Time { sec: 0, nanosec: 500_000_000 },
        points: vec![[1.0, 2.0, 3.0].into()],
        colors: vec![color],
        uv_coordinates: vec![[0.5, 0.25]],
        text: "7 1.5 N".into(),
        ..Marker::default()
    };
    check("markers", &MarkerArray { markers: vec![marker] });
    let header = header(1_700_000_000, 250_000_000, "base_link");
    let (child_frame_id, translation) = ("arm".into(), [0.1, 0.2, 0.3].into());
    let transform = TransformStamped { header, child_frame_id, translation, rotation: orientation };
    check("transforms", &TfMessage { transforms: vec![transform] });
    let (header, map_load_time, data) = (arm(), arm().stamp, vec![-1, 100]);
    let (resolution, origin) = (0.25, pose);
    let map =
        OccupancyGrid { header, map_load_time, resolution, width: 2, height: 1, origin, data };
    check("map", &map);
}

/// All markers are replaced; touches that have ended are left out, others have a sphere and a label, pale if not valid.
#[test]
fn touches_are_drawn_as_markers() {
    let uncertain = TouchMessage { valid: false, ..touch(9, touch_state::BEGIN, f64::NAN) };
    let found = [touch(7, touch_state::HOLD, 1.5), touch(8, touch_state::END, 0.25), uncertain];
    let made = MarkerArray::of_touches(&header(1, 2, "arm"), found.iter(), Some("why".to_owned()));
    let drawn: Vec<_> = made.markers.iter().map(|m| (m.id, m.action, m.kind, &*m.text)).collect();
    let (add, sphere, text) = (0, 2, 9);
    let wanted = [
        (0, 3, 0, ""),
        (1, add, sphere, ""),
        (2, add, text, "7 1.5 N"),
        (3, add, sphere, ""),
        (4, add, text, "9"),
        (5, add, text, "why"),
    ];
    assert_eq!(drawn, wanted);
    assert!(made.markers[3].color[3] < made.markers[1].color[3]);
    assert!(made.markers.iter().all(|marker| marker.header.frame_id == "arm"));
}

/// The hashes of messages of ROS 2 and of our own package.
#[test]
fn type_hashes_are_those_of_ros() {
    let hashes = reference()["hashes"].as_object().unwrap().clone();
    assert_eq!(hashes.len(), 14);
    for (name, wanted) in &hashes {
        assert_eq!(type_hash(name).as_deref(), wanted.as_str(), "{name}");
    }
    assert_eq!(type_hash("std_msgs/msg/Nothing"), None);
}

/// Key and token of the example in the design document of `rmw_zenoh`: a talker in domain 2. Its token ends in
/// another quality of service, of which it writes only what differs from its defaults. Then those of the reference.
#[test]
fn keys_and_attachments_are_those_of_rmw_zenoh() {
    let session = "8b20917502ee955ac4476e0266340d5c";
    let string = "std_msgs/msg/String";
    let chatter = Endpoint::new(2, session, "talker", 10, "/chatter", string).unwrap();
    let hash = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
    // published there, apart from the reference
    assert_eq!(type_hash("std_msgs/msg/String").as_deref(), Some(hash));
    assert_eq!(chatter.key, format!("2/chatter/std_msgs::msg::dds_::String_/{hash}"));
    let token = format!(
        "@ros2_lv/2/{session}/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{hash}/"
    );
    assert_eq!(chatter.token.strip_prefix(&token), Some("1:2:1,10:,:,:,,"));
    assert_eq!(
        Endpoint::node_token(2, "aac3178e146ba6f1fc6e6a4085e77f21", "listener"),
        "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    );
    let unknown = Endpoint::new(0, session, "talker", 1, "chatter", "std_msgs/msg/Nothing");
    assert!(matches!(unknown, Err(PublishError::MessageType { .. })));

    let (topic, name) = ("skin/arm/pose", "geometry_msgs/msg/PoseStamped");
    let pose = Endpoint::new(7, session, "eit_skin_arm", 1, topic, name).unwrap();
    let reference = reference();
    assert_eq!(pose.token, reference["token"]);
    assert_eq!(pose.gid.to_vec(), bytes(&reference["gid"]));
    let gid = std::array::from_fn(|index| index as u8);
    let attachment = Attachment { sequence: 12, time_ns: 1_700_000_000_250_000_000, gid };
    let wanted = bytes(&reference["attachment"]);
    assert_eq!(attachment.to_bytes().to_vec(), wanted);
    assert_eq!(Attachment::from_bytes(&wanted), Some(attachment));
    assert!((0..wanted.len()).all(|length| Attachment::from_bytes(&wanted[..length]).is_none()));
}

#[test]
fn topics_are_those_that_ros_allows() {
    for topic in ["touches", "/skin/arm", "skin/left_arm/touches", "_a/b2"] {
        check_topic(topic).unwrap();
    }
    for topic in ["", "/", "a//b", "a/", "2a", "a b", "a/*", "a/**", "@a", "a__b", "b\u{e4}r", "a#"]
    {
        let error = check_topic(topic).unwrap_err();
        assert!(error.is_input() && error.to_string().starts_with(topic), "{error}");
    }
}

#[test]
fn times_are_split_as_ros_does() {
    let time = |sec, nanosec| Time { sec, nanosec };
    assert_eq!(Time::from_seconds(1.7e9 + 0.25), time(1_700_000_000, 250_000_000));
    assert_eq!(Time::from_seconds(1.999_999_999_9), time(2, 0));
    assert_eq!(Time::from_seconds(-0.5), time(-1, 500_000_000));
    assert_eq!(Time::from_seconds(f64::NAN), time(0, 0));
    assert_eq!(Time::from_seconds(1e300).sec, i32::MAX);
    assert!((time(-1, 500_000_000).seconds() + 0.5).abs() < 1e-12);
}

/// Bytes from the network: whatever they are, they are a message or an error.
#[test]
fn damaged_messages_are_errors() {
    let mut whole = Vec::new();
    to_cdr(&touched(), &mut whole).unwrap();
    for length in 0..whole.len() {
        let error = from_cdr::<TouchArray>(&whole[..length]).unwrap_err();
        assert!(!error.is_input(), "{error}");
    }
    // a linear congruential generator (Knuth, The Art of Computer Programming, 3.3.4)
    let mut state = 1_u64;
    let mut random = |below: usize| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut refused = 0;
    for _ in 0..20_000 {
        let mut damaged = whole.clone();
        for _ in 0..=random(4) {
            let at = random(damaged.len());
            damaged[at] = random(256) as u8;
        }
        refused += usize::from(from_cdr::<TouchArray>(&damaged).is_err());
    }
    assert!((1000..19_000).contains(&refused), "{refused}");
    // four thousand million touches in 60 bytes
    let mut long = Vec::new();
    to_cdr(&untouched(), &mut long).unwrap();
    let end = long.len();
    long[end - 4..].fill(0xff);
    assert!(from_cdr::<TouchArray>(&long).is_err());
    // big-endian, and the parameter lists of XCDR 2
    for representation in [[0, 0], [0, 7], [0, 3]] {
        let mut other = whole.clone();
        other[..2].copy_from_slice(&representation);
        assert!(matches!(from_cdr::<TouchArray>(&other), Err(PublishError::CdrHeader { .. })));
    }
}
