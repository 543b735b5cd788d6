"""Learns a skin from presses at known places, then finds touches with what it learnt."""

import numpy as np

import eit

skin = eit.Skin.load("paper-disc")
random = np.random.default_rng(1)
places_m = random.uniform(-0.06, 0.06, (40, 2))
forces_n = random.uniform(0.5, 2.0, 40)


def press(place_m: np.ndarray, force_n: float) -> np.ndarray:
    distance_m = np.linalg.norm(skin.centroids_m[:, :2] - place_m, axis=1)
    return skin.forward(skin.conductivity_s * (1 + force_n * np.exp(-((distance_m / 0.012) ** 2))))


frames = np.array([press(*known) for known in zip(places_m, forces_n)])
rest = np.tile(skin.forward(), (20, 1))
frames, rest = (volts + random.normal(0, 1e-7, volts.shape) for volts in (frames, rest))
presses = {"x_m": places_m[:, 0], "y_m": places_m[:, 1], "force_n": forces_n}
learned = skin.learn(presses, frames, rest)
learned.write("paper-disc.learned")
print(f"{learned.presses} presses, median error {1e3 * learned.median_error_m:.1f} mm")
print(f"force {skin.with_learned('paper-disc.learned').touches(frames, rest)['force_n'].mean():.2f} N")
