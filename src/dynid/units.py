"""Unit tags and their factors to SI; conversion happens at the file boundary only."""

from __future__ import annotations

from math import pi

ANGLE = {"rad": 1.0, "deg": pi / 180.0}
POSITION = {"rad": 1.0, "deg": pi / 180.0, "m": 1.0, "mm": 1e-3}
VELOCITY = {"rad/s": 1.0, "deg/s": pi / 180.0, "m/s": 1.0, "mm/s": 1e-3, "rpm": 2 * pi / 60.0}
EFFORT = {"Nm": 1.0, "mNm": 1e-3, "N": 1.0, "A": 1.0, "mA": 1e-3}

FACTORS = {"position": POSITION, "velocity": VELOCITY, "effort": EFFORT}
