"""A finger in MuJoCo presses and slides on a skin: its contacts are simulated as frames, and touches found in them.

pip install mujoco matplotlib; usage: mujoco_press.py [PICTURE.png]
"""

import sys

import matplotlib
import mujoco
import numpy as np

import eit

FRAME_S = 0.05
RADIUS_M = 0.01
HOLD = 20  # frames of each press

MODEL = f"""
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="skin" type="cylinder" size="0.1 0.005" pos="0 0 -0.005" friction="0.4"/>
    <body pos="0 0 0.015">
      <joint name="x" type="slide" axis="1 0 0" damping="1"/>
      <joint name="y" type="slide" axis="0 1 0" damping="1"/>
      <joint name="z" type="slide" axis="0 0 1" damping="20"/>
      <geom name="tip" type="sphere" size="{RADIUS_M}" mass="0.05"/>
    </body>
  </worldbody>
  <actuator>
    <position joint="x" kp="300" kv="8"/>
    <position joint="y" kp="300" kv="8"/>
    <motor joint="z"/>
  </actuator>
</mujoco>
"""


def path(quiet: int) -> list[tuple[float, float, float]]:
    """Place, metres, and upward force, newton, of each frame: none for the reference, nine presses, a slide along an arc."""
    frames = [(0.0, 0.0, 0.5)] * quiet
    for k in range(9):
        angle, radius_m = 2.4 * k, 0.02 + 0.005 * k
        place = radius_m * np.cos(angle), radius_m * np.sin(angle)
        frames += [(*place, 0.5)] * 6 + [(*place, -0.6 - 0.1 * k)] * HOLD
    start = 0.05, 0.0
    frames += [(*start, 0.5)] * 6 + [(*start, -1.0)] * HOLD
    frames += [(0.05 * np.cos(a), 0.05 * np.sin(a), -1.0) for a in np.linspace(0, 4, 80)]
    return frames + [(0.0, 0.0, 0.5)] * 10


def contact(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, float, float]:
    """Centre and normal force of what touches the skin."""
    force, total, centre = np.zeros(6), 0.0, np.zeros(3)
    for k in range(data.ncon):
        mujoco.mj_contactForce(model, data, k, force)
        total += force[0]
        centre += force[0] * data.contact[k].pos
    centre /= total or 1.0
    return float(centre[0]), float(centre[1]), float(total)


def main() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    skin = eit.Skin.load("paper-disc")
    simulator, sensor = skin.simulator(seed=1), skin.sensor()
    rows = []
    for x_m, y_m, force_n in path(sensor.reference_frames + 5):
        data.ctrl[:] = x_m, y_m, force_n
        for _ in range(round(FRAME_S / model.opt.timestep)):
            mujoco.mj_step(model, data)
        x_m, y_m, force_n = contact(model, data)
        contacts = [[x_m, y_m, force_n, RADIUS_M]] if force_n > 0 else []
        shown = sensor.push(simulator.step(contacts, FRAME_S), simulator.time_s)
        held = [] if shown is None else [t for t in shown.touches if t["state"] != "end"]
        errors_m = [np.hypot(t["x_m"] - x_m, t["y_m"] - y_m) for t in held]
        best = int(np.argmin(errors_m)) if held else -1
        found = (held[best]["x_m"], held[best]["y_m"], errors_m[best]) if held else (np.nan,) * 3
        rows.append((x_m, y_m, force_n, *found, len(held)))
    x, y, force, found_x, found_y, error, count = np.array(rows).T
    pressed = force > 0.3
    free = force == 0.0
    found = np.isfinite(error) & pressed
    print(f"frames above 0.3 N: {pressed.sum()}, found {found.sum() / pressed.sum():.3f}")
    print(f"distance: median {1e3 * np.median(error[found]):.1f} mm, 95 % within {1e3 * np.quantile(error[found], 0.95):.1f} mm")
    print(f"frames without contact: {free.sum()}, with a touch {(count[free] > 0).sum()}")
    print(f"frames with more than one touch: {(count > 1).sum()}")
    if len(sys.argv) > 1:
        draw(sys.argv[1], x[pressed], y[pressed], found_x[found], found_y[found])


def draw(file: str, *places: "np.typing.NDArray[np.float64]") -> None:
    """Contacts of the simulator, and the touches found."""
    matplotlib.use("Agg")
    from matplotlib import patches, pyplot

    x, y, found_x, found_y = (1e3 * p for p in places)
    figure, axes = pyplot.subplots(figsize=(5, 5), layout="tight")
    axes.add_patch(patches.Circle((0, 0), 100, fill=False))
    axes.plot(x, y, "o", markersize=9, markerfacecolor="none", label="MuJoCo's contact")
    axes.plot(found_x, found_y, ".", label="touch")
    axes.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")
    axes.legend(loc="lower left")
    figure.savefig(file, dpi=120)


if __name__ == "__main__":
    main()
