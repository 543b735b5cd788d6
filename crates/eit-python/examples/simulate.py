"""Simulates a finger on the fabric, and measures how far its touches are from the truth."""

import numpy as np

import eit

simulation = eit.Skin.load("paper-disc").simulate("one-finger", seed=1, frames=60)
touches = simulation.skin.touches(simulation.frames)
touches = touches[touches["valid"]]

errors_m = []
for true in simulation.touches:
    found = touches[touches["frame"] == true["frame"]]
    if len(found):
        errors_m.append(np.hypot(found["x_m"] - true["x_m"], found["y_m"] - true["y_m"]).min())
print(f"{len(simulation.touches)} true touches, {len(errors_m)} found")
print(f"median distance {1e3 * np.median(errors_m):.1f} mm")
