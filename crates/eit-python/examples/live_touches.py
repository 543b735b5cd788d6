"""Live touches: `live_touches.py skin.toml` opens its instrument, `live_touches.py skin.toml press.mcap` replays."""

import sys

import eit

scene, *recording = sys.argv[1:]
skin = eit.Skin.load(scene)
sensor = skin.replay(recording[0]) if recording else skin.open()
print("touch nothing until the reference is taken; Ctrl-C ends", file=sys.stderr)
try:
    for frame in sensor:
        if frame.state != "sound":
            print(f"{frame.time_s:8.3f} s  nothing is known: {frame.state}")
        for touch in frame.touches[frame.touches["valid"]]:
            x_mm, y_mm = 1e3 * touch["x_m"], 1e3 * touch["y_m"]
            print(f"{frame.time_s:8.3f} s  touch {touch['id']} at {x_mm:6.1f}, {y_mm:6.1f} mm")
except KeyboardInterrupt:
    pass
