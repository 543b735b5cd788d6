"""The module computes what the `eit` command does, bit for bit."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Case, eit_command

import eit

FORMATS = {
    "time_s": ".6f", "x_m": ".6f", "y_m": ".6f", "z_m": ".6f", "age_s": ".6f",
    "std_x_m": ".3e", "std_y_m": ".3e", "std_z_m": ".3e", "intensity_std_s_m2": ".3e",
    "intensity_s_m2": ".6e",
}  # fmt: skip


def check_touches(found: np.ndarray, table: Path) -> None:
    """Compares touches with touches.csv, which rounds."""
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(found.dtype.names or ()) == list(rows[0])
    # without those that only tell the state of the skin, or that the recording is over
    rows = [row for row in rows if row["id"] and row["skin"] != "no_data"]
    assert len(found) == len(rows) > 10
    for touch, row in zip(found, rows):
        for name, text in row.items():
            value = touch[name]
            if isinstance(value, np.floating):
                rounded = float(format(value, FORMATS.get(name, ".4f")))
                assert rounded == float(text) if text else np.isnan(value), (name, value, text)
            elif isinstance(value, np.bool_):
                assert str(bool(value)).lower() == (text or "false"), name
            else:
                assert str(value) == (text or "-1"), name


def test_images_and_touches_of_a_recording(case: Case) -> None:
    skin = eit.Skin.load(case.scene)
    images = skin.reconstruct(case.frames, case.reference, method=case.method)
    np.testing.assert_array_equal(images, np.load(case.made / "images.npy"))
    check_touches(skin.touches(case.frames, case.reference), case.made / "touches.csv")


def test_arrays_and_recordings_are_as_files(case: Case, tmp_path: Path) -> None:
    skin = eit.Skin.load(case.scene)
    of_file = skin.touches(case.frames, case.reference)
    recording = eit.Recording.read(case.frames)
    every: list[Any] = [recording, recording.frames, np.asfortranarray(recording.frames)]
    for frames in every:
        assert skin.touches(frames, case.reference).tobytes() == of_file.tobytes()
    copy = tmp_path / "copy.mcap"
    eit.Recording(recording.frames, frame_rate_hz=20.0).write(copy)
    np.testing.assert_array_equal(eit.Recording.read(copy).frames, recording.frames)
    quiet = recording.frames[: 12 if case.reference else 20]
    images = skin.reconstruct(recording, quiet, method="gauss-newton")
    named = f"0..{len(quiet)}"
    np.testing.assert_array_equal(images, skin.reconstruct(recording, named, method="gauss-newton"))


def test_live_touches_and_images_are_those_of_a_replay(case: Case, tmp_path: Path) -> None:
    played = tmp_path / "played.mcap"
    eit_command("convert", case.frames, "--scene", case.scene, "--out", played)
    eit_command("replay", case.scene, "--from", played, "--out", tmp_path / "out")
    skin = eit.Skin.load(case.scene)
    shown = list(skin.replay(played, images=True))
    touches = np.concatenate([frame.touches for frame in shown])
    check_touches(touches, tmp_path / "out" / "touches.csv")
    images = np.stack([frame.image for frame in shown if frame.image is not None])
    np.testing.assert_array_equal(images, np.load(tmp_path / "out" / "images.npy"))
    # at full precision
    lines = eit_command("replay", case.scene, "--from", played, "--json-lines").splitlines()
    known = [line for line in map(json.loads, lines) if line.get("state") != "no_data"]
    listed = [touch["position_m"] for line in known for touch in line.get("touches", [])]
    found = [[touch["x_m"], touch["y_m"], touch["z_m"]] for touch in touches]
    assert found == listed
    # pushed one by one
    sensor = skin.sensor()
    recording = eit.Recording.read(played)
    quiet = 20
    sensor.set_reference(recording.frames[:quiet])
    for frame, expected in zip(recording.frames[quiet:], shown):
        pushed = sensor.push(frame)
        assert pushed is not None
        np.testing.assert_array_equal(pushed.touches["x_m"], expected.touches["x_m"])


@pytest.mark.parametrize("scene", ["paper-disc", "hemisphere", "general-32"])
def test_voltages_and_jacobian(scene: str, tmp_path: Path) -> None:
    skin = eit.Skin.load(scene)
    eit_command("forward", scene, "--out", tmp_path / "v.npy")
    voltages = skin.forward()
    np.testing.assert_array_equal(voltages, np.load(tmp_path / "v.npy"))
    assert voltages.shape == (skin.measurements,)
    conductivity = skin.conductivity_s * (1 + 0.5 * (skin.centroids_m[:, 0] > 0))
    np.save(tmp_path / "s.npy", conductivity)
    line = ["--conductivity", tmp_path / "s.npy", "--out", tmp_path / "v.npy"]
    eit_command("forward", scene, *line)
    np.testing.assert_array_equal(skin.forward(conductivity), np.load(tmp_path / "v.npy"))
    if scene == "paper-disc":
        eit_command("jacobian", scene, "--out", tmp_path / "j.npy")
        np.testing.assert_array_equal(skin.jacobian(), np.load(tmp_path / "j.npy"))


def test_simulation(tmp_path: Path) -> None:
    line = ["--script", "random", "--seed", 3, "--frames", 26, "--nodes", 2500]
    eit_command("simulate", "paper-disc", *line, "--out", tmp_path / "out")
    made = eit.Skin.load("paper-disc").simulate("random", 3, frames=26, nodes=2500)
    np.testing.assert_array_equal(made.frames, np.load(tmp_path / "out" / "frames.npy"))
    truth = np.load(tmp_path / "out" / "truth_conductivity.npy")
    np.testing.assert_array_equal(made.images, truth)
    with (tmp_path / "out" / "touches.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(made.touches.dtype.names or ()) == list(rows[0])
    for touch, row in zip(made.touches, rows, strict=True):
        assert all(touch[name] == float(text) for name, text in row.items())
    # the skin has what the written scene says of the recording
    written = eit.Skin.load(tmp_path / "out" / "scene.toml")
    assert made.skin.touches(made.frames).tobytes() == written.touches().tobytes()


def test_learning(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    skin = eit.Skin.load("paper-disc")
    places_m = random.uniform(-0.06, 0.06, (24, 2))
    forces_n = random.uniform(0.5, 2.0, 24)
    frames = [skin.forward() for _ in range(20)]
    for place_m, force_n in zip(places_m, forces_n):
        far_m = np.linalg.norm(skin.centroids_m[:, :2] - place_m, axis=1)
        bell = 1 + force_n * np.exp(-((far_m / 0.012) ** 2))
        frames.append(skin.forward(skin.conductivity_s * bell))
    values = np.array(frames)
    values += random.normal(0, 1e-7, values.shape)
    np.save(tmp_path / "frames.npy", values)
    number = np.arange(20, 44)
    presses = {
        "x_m": places_m[:, 0], "y_m": places_m[:, 1], "force_n": forces_n,
        "first_frame": number, "last_frame": number,
    }  # fmt: skip
    table = np.empty(24, [(name, column.dtype) for name, column in presses.items()])
    for name, column in presses.items():
        table[name] = column
    with (tmp_path / "presses.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerows([list(presses), *table.tolist()])
    line = ["--presses", tmp_path / "presses.csv", "--frames", tmp_path / "frames.npy"]
    line += ["--reference", "0..20", "--out", tmp_path / "cli.learned"]
    eit_command("learn", "paper-disc", *line)
    every: list[Any] = [presses, table, tmp_path / "presses.csv"]
    for given in every:
        learned = skin.learn(given, values, "0..20")
        learned.write(tmp_path / "module.learned")
        assert (tmp_path / "module.learned").read_bytes() == (tmp_path / "cli.learned").read_bytes()
    assert learned.presses == 24 and learned.median_error_m < 0.02
    found = skin.with_learned(tmp_path / "module.learned").touches(values, "0..20")
    assert np.isfinite(found["force_n"]).any()
    with pytest.raises(ValueError, match="z_mm is no column"):
        skin.learn({"x_m": [0.0], "z_mm": [0.0]}, values)
