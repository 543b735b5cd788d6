"""Electrical impedance tomography for robot skin: touches and images from electrode voltages."""

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Final, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "EitError",
    "LearnedSkin",
    "Recording",
    "Sensor",
    "Simulation",
    "Simulator",
    "Skin",
    "TouchFrame",
    "touch_dtype",
]

_Path: TypeAlias = str | PathLike[str]
_Floats: TypeAlias = NDArray[np.float64]
_Frames: TypeAlias = ArrayLike | Recording | _Path | Sequence[_Path]
_Reference: TypeAlias = int | _Path | ArrayLike
_Presses: TypeAlias = _Path | Mapping[str, ArrayLike] | NDArray[np.void]
_Method: TypeAlias = Literal["st-tv", "tv", "gauss-newton", "time-prior", "gauss-newton-absolute"]

touch_dtype: Final[np.dtype[np.void]]
"""Fields of a touch, those of ``touches.csv``: frame, time_s, id, state ("begin", "hold", "end"), x_m, y_m, z_m, their
standard deviations std_x_m, std_y_m, std_z_m, the skin's normal nx, ny, nz, velocity vx_m_s, vy_m_s, vz_m_s,
intensity_s_m2 with intensity_std_s_m2, confidence (0 to 1), valid (position and strength may be acted on), whole (no
measurement was left out), age_s, force_n with force_std_n, unlike (no learnt press was like it), split_from and
merged_into (ids), skin ("sound", "not_explained", "frozen"). What is not known is NaN, an id -1."""

class EitError(Exception):
    """Invalid input, or a failure. The message says what, where and how to mend it.

    Wrong arguments raise ValueError or TypeError.
    """

@final
class Skin:
    """A skin: mesh, protocol and model, set up from its scene. Its methods release the GIL while they compute."""

    @staticmethod
    def load(scene: _Path) -> Skin:
        """Reads a scene file, or a built-in scene such as "paper-disc"."""

    @property
    def name(self) -> str:
        """Name of the scene."""

    @property
    def electrodes(self) -> int:
        """Number of electrodes."""

    @property
    def measurements(self) -> int:
        """Number of voltages of a frame."""

    @property
    def elements(self) -> int:
        """Number of elements of the mesh."""

    @property
    def conductivity_s(self) -> float:
        """Conductivity of the untouched skin, siemens per square."""

    @property
    def quadruples(self) -> NDArray[np.uint32] | None:
        """Electrodes [measurement, (a, b, m, n)], from 0: current enters at a, leaves at b; the value is the potential
        at m minus that at n. None for general current patterns."""

    @property
    def centroids_m(self) -> _Floats:
        """Centre of each element, metres, [element, (x, y, z)]."""

    def forward(self, conductivity: ArrayLike | None = None) -> _Floats:
        """Voltages [measurement], volt, for conductivities [element] in siemens, else for the untouched skin."""

    def jacobian(self, conductivity: ArrayLike | None = None) -> _Floats:
        """Derivatives [measurement, element] of the voltages, volt per siemens."""

    def simulate(
        self,
        script: str = "random",
        seed: int = 1,
        *,
        frames: int | None = None,
        nodes: int | None = None,
    ) -> Simulation:
        """Runs a touch script, a built-in one or a file F.toml, on the simulated fabric of the scene.

        Built in are paper-one-finger and paper-two-fingers (one frame per second), one-finger, two-fingers, random, press-and-hold, tapping, stroking and closing-in.
        `frames` ends it early, `nodes` are those of the mesh. The same seed gives the same bytes.
        """

    def simulator(
        self, seed: int = 1, *, fast: bool = False, nodes: int | None = None
    ) -> Simulator:
        """The simulated fabric of the scene, to be stepped with the contacts of a robot's simulator.

        `fast` linearises it: some fifty times as fast, and 4 to 6 % off. `nodes` are those of the mesh.
        """

    def reconstruct(
        self,
        frames: _Frames | None = None,
        reference: _Reference | None = None,
        *,
        method: _Method | None = None,
    ) -> _Floats:
        """Images [frame, row, column] of the change of conductivity, siemens; `eit reconstruct` writes the same.

        `frames` are an array [frame, measurement] in volt, a Recording, or files; without them, the scene's files.
        `reference` is the frame to subtract: a number, "mean", "N..M" (frames N to M - 1), a file, or an array
        [measurement] or [frame, measurement] of the untouched skin; without it, the scene's. Several frames also
        show the noise. `method` is the scene's, or what suits it.
        """

    def touches(
        self, frames: _Frames | None = None, reference: _Reference | None = None
    ) -> NDArray[np.void]:
        """Touches of a recording, one row per touch and frame, of the type `touch_dtype`; see `reconstruct`."""

    def learn(
        self,
        presses: _Presses,
        frames: _Frames | None = None,
        reference: _Reference | None = None,
        *,
        earlier: _Path | None = None,
        fit_frame: bool = False,
    ) -> LearnedSkin:
        """Learns the skin from presses at known places; `eit learn` does the same.

        `presses` is a CSV file, or columns [press] by name: x_m, y_m (metres) and optionally z_m, force_n, depth_m,
        first_frame, last_frame (else each press has one frame), before_first, before_last (frames of the untouched
        skin before it, else the reference). `earlier` is a file learnt before, `fit_frame` says that places are
        a robot's coordinates.
        """

    def with_learned(self, path: _Path) -> Skin:
        """The same skin, whose touches and forces come from what was learnt (`LearnedSkin.write`)."""

    def sensor(self, *, images: bool = False) -> Sensor:
        """A sensor whose frames you push. The first ones must show the untouched skin."""

    def open(self, port: str | None = None, *, images: bool = False) -> Sensor:
        """Opens the instrument of the scene, at `port` if given: a serial port or tcp:HOST:PORT."""

    def replay(self, path: _Path, *, images: bool = False) -> Sensor:
        """Plays a recording as if it were live, as fast as touches are asked for."""

@final
class Sensor:
    """Touches frame by frame: an iterator for an instrument or a recording, `push` for your own frames.

    Waiting can be interrupted by Ctrl-C. A sensor is used by one thread at a time.
    """

    def push(self, frame: ArrayLike, time_s: float | None = None) -> TouchFrame | None:
        """Takes a frame [measurement], volt, at this time; None while the reference is taken. NaN is a lost value."""

    def __iter__(self) -> Iterator[TouchFrame]: ...
    def __next__(self) -> TouchFrame: ...
    def next_within(self, timeout_s: float) -> TouchFrame | None:
        """The next frame; None if none comes in time, or the source has ended."""

    def set_reference(self, frames: ArrayLike) -> None:
        """Takes frames [frame, measurement] of the untouched skin as the reference."""

    def restart(self) -> None:
        """Takes a new reference: the next frames must show the untouched skin."""

    @property
    def reference_frames(self) -> int:
        """Number of frames of the reference."""

    @property
    def notes(self) -> list[str]:
        """What the source and the reference say about the scene, such as voltages of another order."""

@final
class TouchFrame:
    """The touches of one frame."""

    @property
    def touches(self) -> NDArray[np.void]:
        """Touches, of the type `touch_dtype`. Made when asked for: keep the array, not the attribute."""

    @property
    def state(self) -> Literal["sound", "not_explained", "frozen", "reference", "no_data"]:
        """What is known of the skin. Only if it is "sound", no touch means that nothing touches it."""

    @property
    def number(self) -> int:
        """Number of frames before it that were searched for touches."""

    @property
    def sequence(self) -> int:
        """The instrument's number of the frame; gaps are lost frames."""

    @property
    def epoch(self) -> int:
        """Number of the connection, from 0."""

    @property
    def time_s(self) -> float:
        """Time of the frame, seconds; always increases."""

    @property
    def host_time_s(self) -> float | None:
        """When its last byte arrived, seconds since 1970."""

    @property
    def latency_s(self) -> float | None:
        """Time from its last byte to its touches, seconds."""

    @property
    def whole(self) -> bool:
        """Whether every used measurement counted."""

    @property
    def faulty_electrodes(self) -> list[int]:
        """Electrodes that were left out, from 1."""

    @property
    def faults(self) -> list[str]:
        """The same in words."""

    @property
    def image(self) -> _Floats | None:
        """Change of conductivity [row, column], siemens, if images are made."""

    def __len__(self) -> int: ...

@final
class Recording:
    """Frames of a recording, as its file has them; or of an array [frame, measurement], volt, in protocol order."""

    def __new__(cls, frames: ArrayLike, frame_rate_hz: float | None = None) -> Recording: ...

    @staticmethod
    def read(path: _Path) -> Recording:
        """Reads a recording: MCAP, CSV, NPY, NPZ, MATLAB, or the format of an instrument."""

    def write(self, path: _Path) -> None:
        """Writes a new MCAP recording, which `eit replay` and `Skin.replay` play."""

    @property
    def frames(self) -> _Floats:
        """A copy of the values [frame, value], in the order of the file."""

    @property
    def time_s(self) -> _Floats | None:
        """Time of each frame, seconds."""

    @property
    def quadruples(self) -> NDArray[np.uint32] | None:
        """Electrodes [value, (a, b, m, n)], from 0, if the file names them."""

    @property
    def unit(self) -> Literal["volt", "ohm", "arbitrary"]:
        """Unit of the values."""

    @property
    def notes(self) -> list[str]:
        """What the reader noticed."""

    def __len__(self) -> int: ...

@final
class Simulation:
    """A simulated recording with its truth."""

    @property
    def frames(self) -> _Floats:
        """Voltages [frame, measurement], volt."""

    @property
    def images(self) -> _Floats:
        """True change of conductivity [frame, row, column], siemens."""

    @property
    def touches(self) -> NDArray[np.void]:
        """True touches, one row per finger and frame: frame, time_s, finger, x_m, y_m, force_n, tip_radius_m,
        contact_radius_m, area_m2, depth_m."""

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second."""

    @property
    def quiet_frames(self) -> int:
        """Number of frames at the start in which nothing touches the skin."""

    @property
    def skin(self) -> Skin:
        """The skin, with the reference, frame rate and noise of these frames."""

@final
class Simulator:
    """A simulated skin, stepped frame by frame with the contacts of a robot's simulator."""

    def step(
        self,
        contacts: ArrayLike,
        dt_s: float,
        *,
        fingers: Sequence[int] | None = None,
        flat: bool = False,
    ) -> _Floats:
        """Moves the contacts and measures the next frame [measurement], volt, `dt_s` after the one before.

        `contacts` are [contact, (x_m, y_m, force_n, radius_m)], spheres, or with `flat` soft pads of that radius.
        `fingers` are their numbers, by which a moved finger is known; without them, the rows' from 1.
        """

    @property
    def time_s(self) -> float:
        """Time of the last frame since the first, seconds; NaN before the first."""

    @property
    def exact(self) -> _Floats | None:
        """Exact voltages [measurement] of the last frame, before the instrument, volt; None before the first."""

    @property
    def reference(self) -> _Floats:
        """Exact voltages [measurement] of the untouched skin, volt."""

@final
class LearnedSkin:
    """A skin that was learnt from presses."""

    def write(self, path: _Path) -> None:
        """Writes the file that `Skin.with_learned` and the scene's [touch] learned take."""

    @property
    def presses(self) -> int:
        """Number of presses."""

    @property
    def places_by(self) -> str:
        """How touches are found: by the presses, or by the model alone."""

    @property
    def median_error_m(self) -> float:
        """Median position error of presses that are held out, metres."""

    @property
    def mean_error_m(self) -> float:
        """Their mean position error, metres."""

    @property
    def force_range_n(self) -> tuple[float, float] | None:
        """Least and largest force that was learnt, newton; None if none was."""

    @property
    def unlike_presses(self) -> list[int]:
        """Presses that all others contradict, from 0: was the skin touched elsewhere?"""
