"""A gymnasium environment: move a finger over a skin, and press where you are told, by touch alone.

pip install gymnasium; `gymnasium.make("EitReach-v0")` after `import reach_env`.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

import eit

Array = NDArray[np.float32]


class EitReach(gymnasium.Env[Array, Array]):
    """A finger starts somewhere on the skin and must come to rest on a goal.

    Observation: the goal x, y, then the strongest touch x, y and whether there is one, places over the skin's radius.
    Action: velocity x, y over 0.1 m/s, and pressing force over 1 N. Reward: minus the distance over the radius, and 1 at
    the goal, which ends the episode.
    """

    metadata: dict[str, Any] = {"render_modes": []}
    RADIUS_M, FRAME_S, NEAR_M, FRAMES = 0.1, 0.05, 0.005, 100

    def __init__(self, scene: str = "paper-disc") -> None:
        self.observation_space = spaces.Box(-1.0, 1.0, (5,), np.float32)
        self.action_space = spaces.Box(
            np.array([-1, -1, 0], np.float32), np.array([1, 1, 1], np.float32)
        )
        self._skin = eit.Skin.load(scene)
        self._place = self._goal = np.zeros(2)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self._place, self._goal = self._draw(), self._draw()
        self._simulator = self._skin.simulator(seed=int(self.np_random.integers(2**31)), fast=True)
        self._sensor = self._skin.sensor()
        for _ in range(self._sensor.reference_frames):
            self._feel([])
        self._left = self.FRAMES
        return self._observe(self._feel([])), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        velocity, force_n = 0.1 * np.asarray(action[:2], float), float(action[2])
        place = self._place + self.FRAME_S * velocity
        size = float(np.hypot(*place)) / (0.85 * self.RADIUS_M)
        self._place = place / max(size, 1.0)
        touch = self._feel([[*self._place, force_n, 0.01]])
        distance = float(np.hypot(*(self._place - self._goal)))
        is_there = distance < self.NEAR_M and force_n > 0.3
        self._left -= 1
        reward = -distance / self.RADIUS_M + float(is_there)
        return self._observe(touch), reward, is_there, self._left == 0, {"distance_m": distance}

    def _draw(self) -> NDArray[np.float64]:
        angle, radius_m = 2 * np.pi * self.np_random.random(), 0.07 * self.np_random.random() ** 0.5
        return np.array([radius_m * np.cos(angle), radius_m * np.sin(angle)])

    def _feel(self, contacts: list[list[float]]) -> np.void | None:
        """The strongest touch of the next frame."""
        frame = self._simulator.step(contacts, self.FRAME_S)
        shown = self._sensor.push(frame, self._simulator.time_s)
        if shown is None or len(shown) == 0:
            return None
        touches = [touch for touch in shown.touches if touch["state"] != "end"]
        return max(touches, key=lambda touch: abs(touch["intensity_s_m2"]), default=None)

    def _observe(self, touch: np.void | None) -> Array:
        felt = [0.0, 0.0] if touch is None else [touch["x_m"], touch["y_m"]]
        places = np.array([*self._goal, *felt]) / self.RADIUS_M
        seen = np.array([*places, float(touch is not None)], np.float32)
        return seen.clip(-1, 1)


gymnasium.register("EitReach-v0", entry_point=f"{__name__}:EitReach")
