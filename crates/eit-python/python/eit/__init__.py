"""Electrical impedance tomography for robot skin: touches and images from electrode voltages.

``Skin.load`` builds a skin from its scene; everything else follows from it. Lengths are in metres, voltages in volt,
conductivities in siemens (per square), forces in newton, times in seconds. Frames are arrays ``[frame, measurement]``
in the order of the scene's protocol, images ``[frame, row, column]``, row 0 at the top (largest y), NaN outside the
skin. Notes about data go to the logger ``eit`` (``logging``), level INFO.
"""

from eit._eit import (
    EitError,
    LearnedSkin,
    Recording,
    Sensor,
    Simulation,
    Simulator,
    Skin,
    TouchFrame,
    touch_dtype,
)

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
