"""Compares type hashes of eit_skin_msgs with those of ROS 2's own generator (packages of Jazzy from PyPI)."""

import json
import pathlib
import sys
import tempfile

from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_type_description import generate_type_hash

root = pathlib.Path(__file__).resolve().parent.parent / "crates/eit-publish"
package = root / "ros/eit_skin_msgs"
wanted = json.loads((root / "tests/all/ros/reference.json").read_text())["hashes"]
share = pathlib.Path(sys.prefix) / "share"
names = sorted(path.stem for path in (package / "msg").glob("*.msg"))
with tempfile.TemporaryDirectory() as folder:
    out = pathlib.Path(folder)
    for name in names:
        convert_msg_to_idl(package, package.name, pathlib.Path(f"msg/{name}.msg"), out / "msg")
    arguments = {
        "package_name": package.name,
        "output_dir": str(out),
        "idl_tuples": [f"{out}:msg/{name}.idl" for name in names],
        "include_paths": [f"{other}:{share / other}" for other in ("std_msgs", "geometry_msgs", "builtin_interfaces")],
    }
    (out / "arguments.json").write_text(json.dumps(arguments))
    generate_type_hash(str(out / "arguments.json"))
    made = {}
    for name in names:
        for entry in json.loads((out / f"msg/{name}.json").read_text())["type_hashes"]:
            made[entry["type_name"]] = entry["hash_string"]
for name in names:
    name = f"{package.name}/msg/{name}"
    if made[name] != wanted[name]:
        sys.exit(f"{name}: {made[name]} by rosidl, {wanted[name]} here")
print(f"{len(names)} type hashes are those of ROS 2's generator")
