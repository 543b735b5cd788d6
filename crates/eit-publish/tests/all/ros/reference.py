"""Writes reference.json: what independent programs make of the messages of tests/all/ros.rs.

    python3 -m venv venv && venv/bin/pip install rosbags==0.11.9 eclipse-zenoh==1.10.2 xxhash==4.1.0
    venv/bin/python reference.py > reference.json

rosbags encodes CDR and computes type hashes from the .msg files; the Python binding of zenoh serialises
attachments; xxhash is the reference implementation of XXH3.
"""

import json
from pathlib import Path

import numpy as np
import xxhash
import zenoh
from rosbags.typesys import Stores, get_typestore, get_types_from_msg
from zenoh.ext import Int64, z_serialize

store = get_typestore(Stores.ROS2_JAZZY)
folder = Path(__file__).parent / "../../../ros/eit_skin_msgs/msg"
own = {}
for path in sorted(folder.glob("*.msg")):
    own.update(get_types_from_msg(path.read_text(), f"eit_skin_msgs/msg/{path.stem}"))
store.register(own)
T = store.types


def make(kind, /, **fields):
    return T[kind](**fields)


def header(sec, nanosec, frame):
    return make("std_msgs/msg/Header", stamp=stamp(sec, nanosec), frame_id=frame)


def stamp(sec, nanosec):
    return make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def point(x, y, z, kind="Point"):
    return make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def touch(number, state, force):
    return make(
        "eit_skin_msgs/msg/Touch",
        id=number,
        state=state,
        position=point(0.03, -0.01, 0.0),
        position_covariance=np.array([4e-6, 1e-7, 0, 1e-7, 1e-6, 0, 0, 0, 0], dtype=np.float64),
        normal=point(0.6, 0.0, 0.8, "Vector3"),
        velocity=point(0.1, 0.0, -0.25, "Vector3"),
        intensity=2.5e-11,
        intensity_std=1e-12,
        force=force,
        force_std=0.125,
        confidence=0.97,
        age=0.12,
        valid=True,
        whole=False,
        likeness=1,
        split_from=0,
        merged_into=3,
    )


def touches(frame, faults, found):
    return make(
        "eit_skin_msgs/msg/TouchArray",
        header=header(1700000000, 250000000, frame),
        sequence=100,
        epoch=1,
        time=2.0,
        latency=0.002,
        whole=not faults,
        state=2 if faults else 0,
        faulty_electrodes=faults,
        touches=found,
    )


fault = make("eit_skin_msgs/msg/ElectrodeFault", electrode=5, kind=1, since=1.5)
status = make(
    "diagnostic_msgs/msg/DiagnosticStatus",
    level=1,
    name="skin/arm: EIT skin arm",
    message="faulty electrodes: 5",
    hardware_id="board 7",
    values=[make("diagnostic_msgs/msg/KeyValue", key="frames_per_second", value="100.0")],
)
pose = make(
    "geometry_msgs/msg/Pose",
    position=point(0.1, 0.2, 0.3),
    orientation=make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=1.0, w=0.0),
)
patch = make(
    "eit_skin_msgs/msg/PatchState", name="arm", silent=False, state=1, age=0.05, received=9, lost=2
)
joined = make(
    "eit_skin_msgs/msg/BodyTouch",
    patch="arm",
    epoch=1,
    stamp=stamp(1700000000, 250000000),
    touch=touch(7, 1, 1.5),
)
color = {"r": 0.5, "g": 0.25, "b": 0.125, "a": 1.0}
marker = make(
    "visualization_msgs/msg/Marker",
    header=header(1700000000, 250000000, "arm"),
    ns="touches",
    id=1,
    type=9,
    action=0,
    pose=pose,
    scale=point(0.01, 0.01, 0.01, "Vector3"),
    color=make("std_msgs/msg/ColorRGBA", **color),
    lifetime=make("builtin_interfaces/msg/Duration", sec=0, nanosec=500000000),
    frame_locked=False,
    points=[point(1.0, 2.0, 3.0)],
    colors=[make("std_msgs/msg/ColorRGBA", **color)],
    texture_resource="",
    texture=make("sensor_msgs/msg/CompressedImage", header=header(0, 0, ""), format="", data=np.zeros(0, dtype=np.uint8)),
    uv_coordinates=[make("visualization_msgs/msg/UVCoordinate", u=0.5, v=0.25)],
    text="7 1.5 N",
    mesh_resource="",
    mesh_file=make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, dtype=np.uint8)),
    mesh_use_embedded_materials=False,
)
transform = make(
    "geometry_msgs/msg/TransformStamped",
    header=header(1700000000, 250000000, "base_link"),
    child_frame_id="arm",
    transform=make(
        "geometry_msgs/msg/Transform", translation=point(0.1, 0.2, 0.3, "Vector3"), rotation=pose.orientation
    ),
)
info = make(
    "nav_msgs/msg/MapMetaData",
    map_load_time=stamp(1700000000, 250000000),
    resolution=0.25,
    width=2,
    height=1,
    origin=pose,
)
messages = {
    "markers": ("visualization_msgs/msg/MarkerArray", make("visualization_msgs/msg/MarkerArray", markers=[marker])),
    "transforms": ("tf2_msgs/msg/TFMessage", make("tf2_msgs/msg/TFMessage", transforms=[transform])),
    "map": (
        "nav_msgs/msg/OccupancyGrid",
        make(
            "nav_msgs/msg/OccupancyGrid",
            header=header(1700000000, 250000000, "arm"),
            info=info,
            data=np.array([-1, 100], dtype=np.int8),
        ),
    ),
    "touches": ("eit_skin_msgs/msg/TouchArray", touches("arm", [fault], [touch(7, 1, 1.5), touch(8, 2, 0.25)])),
    # names of another length move every field behind them
    "untouched": ("eit_skin_msgs/msg/TouchArray", touches("left_forearm", [], [])),
    "image": (
        "sensor_msgs/msg/Image",
        make(
            "sensor_msgs/msg/Image",
            header=header(1700000000, 250000000, "arm"),
            height=2,
            width=1,
            encoding="32FC1",
            is_bigendian=0,
            step=4,
            data=np.frombuffer(np.array([1.5e-6, -2.0e-6], dtype="<f4").tobytes(), dtype=np.uint8),
        ),
    ),
    "diagnostics": (
        "diagnostic_msgs/msg/DiagnosticArray",
        make("diagnostic_msgs/msg/DiagnosticArray", header=header(1700000000, 0, ""), status=[status]),
    ),
    "pose": (
        "geometry_msgs/msg/PoseStamped",
        make("geometry_msgs/msg/PoseStamped", header=header(1, 2, "base_link"), pose=pose),
    ),
    "body": (
        "eit_skin_msgs/msg/BodyTouchArray",
        make(
            "eit_skin_msgs/msg/BodyTouchArray",
            header=header(1700000001, 0, "base_link"),
            patches=[patch],
            touches=[joined],
        ),
    ),
}
token = (
    "@ros2_lv/7/8b20917502ee955ac4476e0266340d5c/0/1/MP/%/%/eit_skin_arm/%skin%arm%pose/"
    "geometry_msgs::msg::dds_::PoseStamped_/"
    "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8/1:2:1,10:,:,:,,"
)
digest = xxhash.xxh3_128_intdigest(token.encode())
attachment = z_serialize((Int64(12), Int64(1700000000250000000), bytes(range(16))))
named = ["std_msgs/msg/String", "std_msgs/msg/Header", *(kind for kind, _ in messages.values()), *own]
print(
    json.dumps(
        {
            "messages": {
                name: bytes(store.serialize_cdr(message, kind)).hex()
                for name, (kind, message) in messages.items()
            },
            "hashes": {name: store.hash_rihs01(name) for name in sorted(set(named))},
            "attachment": bytes(attachment).hex(),
            "token": token,
            "gid": digest.to_bytes(16, "little").hex(),
        },
        indent=1,
    )
)
