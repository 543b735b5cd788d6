"""What a program in Python relies on beside the numbers: errors, threads, signals, stubs, examples."""

import ast
import inspect
import logging
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import eit_command

import eit

CRATE = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def skin() -> eit.Skin:
    return eit.Skin.load("paper-disc")


def test_errors_say_what_is_wrong(skin: eit.Skin, tmp_path: Path) -> None:
    with pytest.raises(eit.EitError, match="paper-disk: .*paper-disc,"):
        eit.Skin.load("paper-disk")
    with pytest.raises(eit.EitError, match="gone.mcap"):
        skin.replay(tmp_path / "gone.mcap")
    with pytest.raises(eit.EitError, match=r"no \[instrument\]"):
        skin.open()
    with pytest.raises(ValueError, match="5 values, but the protocol has 208"):
        skin.touches(np.zeros((3, 5)), 0)
    with pytest.raises(ValueError, match="5 values.*208"):
        skin.sensor().push(np.zeros(5))
    with pytest.raises(ValueError, match="frames: there are none"):
        skin.touches(np.zeros((0, 208)), 0)
    with pytest.raises(ValueError, match="reference: no reference frame"):
        skin.touches(np.ones((3, 208)))
    with pytest.raises(ValueError, match='method: "sttv"'):
        skin.reconstruct(np.ones((3, 208)), 0, method="sttv")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="script: dance"):
        skin.simulate("dance")
    with pytest.raises(ValueError, match="frame_rate_hz: 0"):
        eit.Recording(np.ones((3, 208)), 0.0)
    for wrong in [np.ones(208), np.ones((1, 208), complex), {"a": 1}, 3.5]:
        with pytest.raises(TypeError, match=r"frames: must be real numbers \[frame, measurement\]"):
            skin.touches(wrong, 0)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"conductivity.*\[element\]"):
        skin.forward(np.ones((2, 2)))
    with pytest.raises(eit.EitError, match="conductivity|element"):
        skin.forward([1.0, 2.0])


def test_notes_are_logged(caplog: pytest.LogCaptureFixture, skin: eit.Skin) -> None:
    frames = np.tile(np.linspace(1.0, 2.0, 208), (8, 1))
    with caplog.at_level(logging.INFO, logger="eit"), pytest.raises(eit.EitError):
        skin.touches(frames, "0..8")
    frames = np.tile(skin.forward(), (8, 1))
    with caplog.at_level(logging.INFO, logger="eit"), pytest.raises(eit.EitError):
        skin.touches(frames, "0..8")
    assert "equal to the last digit" in caplog.text


def test_the_interpreter_runs_while_it_computes(skin: eit.Skin) -> None:
    ticks = 0
    done = threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not done.is_set():
            ticks += 1
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    before = ticks
    # some 0.3 s in one call
    skin.simulate("tapping", frames=21, nodes=2500)
    after = ticks
    done.set()
    thread.join()
    assert after > before + 5


def test_a_waiting_iterator_ends_with_ctrl_c(tmp_path: Path) -> None:
    scene, port = tmp_path / "skin.toml", tmp_path / "skin"
    text = eit_command("plan", "paper-disc", "--print-scene")
    scene.write_text(text + '\n[instrument]\ndriver = "eits1"\n')
    command = [os.environ["EIT"], "emulate", str(scene), "--port", str(port)]
    # a program that was started in the background ignores Ctrl-C
    code = f"""
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
import eit
for frame in eit.Skin.load({str(scene)!r}).open({str(port)!r}):
    print(frame.state, flush=True)
"""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as board:
        while not port.exists():
            time.sleep(0.05)
        reader = subprocess.Popen(
            [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        try:
            assert reader.stdout is not None
            assert reader.stdout.readline() == "sound\n"
            # nothing more comes: the iterator waits
            board.send_signal(signal.SIGSTOP)
            time.sleep(0.5)
            reader.send_signal(signal.SIGINT)
            assert "KeyboardInterrupt" in reader.communicate(timeout=60)[1]
        finally:
            reader.kill()
            board.kill()


def test_next_within_returns_in_time(tmp_path: Path, skin: eit.Skin) -> None:
    sensor = skin.sensor()
    # frames are pushed: nothing will come
    assert sensor.next_within(0.2) is None and list(sensor) == []
    with pytest.raises(ValueError, match="timeout_s: -1"):
        sensor.next_within(-1.0)
    with pytest.raises(eit.EitError, match="reference frames"):
        sensor.set_reference(np.zeros((2, 208)))


def test_contiguous_arrays_are_not_copied() -> None:
    simulation = eit.Skin.load("paper-disc").simulate("tapping", frames=21, nodes=1500)
    assert simulation.frames is simulation.frames
    assert simulation.frames.flags.c_contiguous and simulation.frames.flags.writeable


def test_stubs_have_the_docstrings_of_the_module() -> None:
    tree = ast.parse((CRATE / "python/eit/__init__.pyi").read_text())
    for node in [node for node in tree.body if isinstance(node, ast.ClassDef)]:
        made = getattr(eit, node.name)
        for part in node.body:
            if isinstance(part, ast.FunctionDef) and not part.name.startswith("__"):
                doc = ast.get_docstring(part)
                assert doc and inspect.getdoc(getattr(made, part.name)) == doc, part.name
        if node.name != "EitError":
            assert inspect.getdoc(made) == ast.get_docstring(node), node.name


@pytest.mark.parametrize("name", ["first_image", "learn", "simulate"])
def test_examples(name: str, tmp_path: Path) -> None:
    said = run_example(name, tmp_path)
    for text in {"first_image": ["brightest"], "learn": ["40 presses", "N"], "simulate": ["found"]}[name]:
        assert text in said


def test_example_of_live_touches(tmp_path: Path) -> None:
    line = ["--script", "one-finger", "--frames", 40, "--nodes", 2500]
    eit_command("simulate", "paper-disc", *line, "--out", tmp_path / "out")
    scene, played = tmp_path / "out" / "scene.toml", tmp_path / "played.mcap"
    eit_command("convert", tmp_path / "out" / "frames.npy", "--scene", scene, "--out", played)
    assert "touch 1 at" in run_example("live_touches", tmp_path, scene, played)


def test_the_readmes_run(tmp_path: Path) -> None:
    for readme, prints in [(CRATE / "README.md", 5), (CRATE.parents[1] / "README.md", -1)]:
        code = readme.read_text().split("```python\n")[1].split("```")[0]
        assert run(tmp_path, "-c", code).count("touch 1 at") > prints


def test_steps_are_the_frames_of_a_simulation(skin: eit.Skin) -> None:
    made = skin.simulate("two-fingers", seed=3, frames=40, nodes=900)
    simulator = skin.simulator(seed=3, nodes=900)
    assert np.isnan(simulator.time_s) and simulator.exact is None
    for number, wanted in enumerate(made.frames):
        true = made.touches[made.touches["frame"] == number]
        contacts = [[t["x_m"], t["y_m"], t["force_n"], t["tip_radius_m"]] for t in true]
        frame = simulator.step(contacts, 1 / made.frame_rate_hz, fingers=[int(t["finger"]) for t in true])
        assert np.array_equal(frame, wanted)
        assert np.isclose(simulator.time_s, number / made.frame_rate_hz)
    fast = skin.simulator(seed=3, fast=True)
    touched = fast.step([[0.03, 0.0, 1.0, 0.01]], 0.05, flat=True)
    assert touched.shape == fast.reference.shape == (208,) and fast.exact is not None
    assert not np.allclose(fast.exact, fast.reference, rtol=1e-3)


def test_wrong_contacts_are_named(skin: eit.Skin) -> None:
    simulator = skin.simulator(fast=True)
    with pytest.raises(ValueError, match=r"contacts: must be \[contact, \(x_m"):
        simulator.step([[0.0, 0.0, 1.0]], 0.05)
    with pytest.raises(TypeError, match="contacts: must be real numbers"):
        simulator.step("finger", 0.05)
    with pytest.raises(ValueError, match="fingers: 2 for 1 contacts"):
        simulator.step([[0.0, 0.0, 1.0, 0.01]], 0.05, fingers=[1, 2])
    with pytest.raises(eit.EitError, match="finger 1, .*is not on the skin"):
        simulator.step([[0.2, 0.0, 1.0, 0.01]], 0.05)
    with pytest.raises(eit.EitError, match="dt_s"):
        simulator.step([], 0.0)


def test_a_finger_in_mujoco_is_felt(tmp_path: Path) -> None:
    for package in ["mujoco", "matplotlib"]:
        pytest.importorskip(package)
    said = run(tmp_path, str(CRATE / "examples" / "mujoco_press.py"), "picture.png")
    table = re.search(r"found ([0-9.]+)\ndistance: median ([0-9.]+) mm", said)
    assert table and float(table[1]) >= 0.98 and float(table[2]) <= 3.0, said
    assert (tmp_path / "picture.png").stat().st_size > 5000


def test_the_environment_is_one_of_gymnasium(monkeypatch: pytest.MonkeyPatch) -> None:
    gymnasium = pytest.importorskip("gymnasium")
    monkeypatch.syspath_prepend(str(CRATE / "examples"))
    import reach_env
    from gymnasium.utils.env_checker import check_env

    environment = gymnasium.make("EitReach-v0").unwrapped
    check_env(environment, skip_render_check=True)
    # straight to the goal, pressing: felt on the way, and there before the end
    seen, _ = environment.reset(seed=2)
    for _ in range(environment.FRAMES):
        way = 0.1 * (seen[:2] - seen[2:4]) / (0.1 * environment.FRAME_S)
        seen, _, is_there, _, _ = environment.step(np.array([*np.clip(way, -1, 1), 1.0], np.float32))
        if is_there:
            break
    assert is_there and seen[4] == 1.0 and isinstance(environment, reach_env.EitReach)


def run_example(name: str, folder: Path, *arguments: Path) -> str:
    path = CRATE / "examples" / f"{name}.py"
    assert len(path.read_text().splitlines()) <= 25
    return run(folder, str(path), *map(str, arguments))


def run(folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
