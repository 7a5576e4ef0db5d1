"""Unit tags and their factors to SI; conversion happens at the file boundary only."""

from __future__ import annotations

from math import pi

ANGLE = {"rad": 1.0, "deg": pi / 180.0}
POSITION = ANGLE | {"m": 1.0, "mm": 1e-3}
VELOCITY = {"rad/s": 1.0, "deg/s": pi / 180.0, "m/s": 1.0, "mm/s": 1e-3, "rpm": 2 * pi / 60.0}
EFFORT = {"Nm": 1.0, "mNm": 1e-3, "N": 1.0, "A": 1.0, "mA": 1e-3}

#: Units of a turning joint and what they are called at a sliding one.
SLIDING = {
    "N m s/rad": "N s/m",
    "N m (s/rad)^p": "N (s/m)^p",
    "N m/rad": "N/m",
    "rad/N m": "m/N",
    "N m/s": "N/s",
    "N m": "N",
    "kg m^2": "kg",
    "rad/s": "m/s",
    "rad/s^2": "m/s^2",
    "1/rad": "1/m",
    "rad": "m",
    "mrad": "mm",
}


def joint_unit(unit: str, *, revolute: bool) -> str:
    """Return a unit that is written for turning joints as it is called at this kind of joint."""
    return unit if revolute else SLIDING.get(unit, unit)


#: Units of parameters where torques are counted in amperes, because no gain of a drive is known.
AMPERES = {
    "kg": "A s^2/m^2",
    "kg m": "A s^2/m",
    "kg m^2": "A s^2/rad^2",
    "N m": "A",
    "N": "A",
    "N m s/rad": "A s/rad",
    "N s/m": "A s/m",
}


def ampere_unit(unit: str) -> str:
    """Return the unit of a parameter where torques are amperes: the size of a mass is not known then."""
    return AMPERES.get(unit, unit.replace("N m", "A"))


#: Units of turning joints.
ANGULAR = ("rad", "deg", "rad/s", "deg/s", "rpm")
FACTORS = {"position": POSITION, "velocity": VELOCITY, "effort": EFFORT}
