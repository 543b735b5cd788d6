"""The first image: a spot that conducts better, and where the image shows it."""

import numpy as np

import eit

skin = eit.Skin.load("paper-disc")
spot_m = np.array([0.04, 0.02, 0.0])
is_pressed = np.linalg.norm(skin.centroids_m - spot_m, axis=1) < 0.01
conductivity_s = np.full(skin.elements, skin.conductivity_s)
conductivity_s[is_pressed] *= 1.5

frame = skin.forward(conductivity_s)
image = skin.reconstruct([frame], reference=skin.forward())[0]

row, column = np.unravel_index(np.nanargmax(image), image.shape)
pixel_m = 0.2 / image.shape[0]
x_m, y_m = (column + 0.5) * pixel_m - 0.1, 0.1 - (row + 0.5) * pixel_m
print(f"pressed at ({spot_m[0]:.3f}, {spot_m[1]:.3f}) m, brightest at ({x_m:.3f}, {y_m:.3f}) m")
