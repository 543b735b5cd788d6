"""Recordings that the `eit` command has made, and what it finds in them."""

import os
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import pytest


def eit_command(*arguments: object) -> str:
    """Runs the command that the variable EIT names, and returns what it prints."""
    done = subprocess.run(
        [os.environ["EIT"], *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


class Case(NamedTuple):
    """A recording and how it is reconstructed."""

    name: str
    scene: Path
    """Scene of the simulation, with reference and noise."""
    frames: Path
    reference: str | None
    method: Any
    made: Path
    """What `eit reconstruct` wrote."""


NET = '\n[denoise]\nweights = "default"\n'
# name, scene, script, further settings, reference, method, format of the frames
CASES = [
    ("paper", "paper-disc", "one-finger", "", None, None, "npy"),
    ("net", "paper-disc", "tapping", NET, None, "gauss-newton", "mcap"),
    ("plate", "plate-with-hole", "random", "", "0..12", "tv", "csv"),
]


@pytest.fixture(scope="session", params=CASES, ids=[case[0] for case in CASES])
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    name, scene, script, more, reference, method, ending = request.param
    folder = tmp_path_factory.mktemp(name)
    simulated, made = folder / "simulated", folder / "made"
    line = ["--script", script, "--frames", 44, "--nodes", 2500, "--seed", 7]
    eit_command("simulate", scene, *line, "--out", simulated)
    scene = simulated / "scene.toml"
    scene.write_text(scene.read_text() + more)
    frames = simulated / "frames.npy"
    if ending != "npy":
        frames = folder / f"frames.{ending}"
        eit_command("convert", simulated / "frames.npy", "--scene", scene, "--out", frames)
    line = ["--frames", frames, "--out", made]
    line += ["--reference", reference] if reference else []
    line += ["--method", method] if method else []
    eit_command("reconstruct", scene, *line)
    return Case(name, scene, frames, reference, method, made)
