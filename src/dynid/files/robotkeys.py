"""The keys of the robot file: tables of what reads the value of each key.

What keys mean, their units and defaults stand in docs/reference/robot-file.md. What has to fit together across keys
is checked in ``robotfile``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from dynid.drivers.interface import DRIVERS
from dynid.errors import AngleTooLarge
from dynid.files import tuning
from dynid.files.columnwords import PATTERNS
from dynid.files.yamlfile import Reader, Value
from dynid.options import LEAST, number_or_nan
from dynid.robot import (
    FRICTION_PARAMETERS,
    USUAL_UNITS,
    Body,
    Coulomb,
    Coupling,
    Cylinders,
    DriverSpec,
    EffectSpec,
    Joint,
    JointMap,
    Known,
    Limits,
    Prior,
    TorqueSource,
)
from dynid.units import ANGLE, FACTORS

Keys = dict[str, Reader]
#: DH angles that nearly are a multiple of this are taken to mean it [rad].
SNAP_STEP = math.pi / 12
#: Names go into file names, of which systems keep 255 characters.
LONGEST_NAME = 100
TORQUE_SOURCES = ("joint_sensor", "motor_torque", "motor_current", "gravity_free", "unknown")
INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
TEXT, NUMBER = Value.text, Value.number


def snapped(angle: float, miss: float = tuning.SNAP_RAD) -> float:
    """Return an angle [rad], a multiple of 15 degrees where it is one but for a miss, such as 1.5708."""
    nearest = round(angle / SNAP_STEP) * SNAP_STEP
    return nearest if abs(angle - nearest) < miss else angle


# ---------------------------------------------------------------- readers that are made of others
def choice(*words: str) -> Reader:
    """Return what reads one of a few words."""
    return lambda value: value.choice(words)


def or_null(read: Reader) -> Reader:
    """Return what reads ``null`` as None."""
    return lambda value: None if value.is_null else read(value)


def several(read: Reader, count: int | None = None) -> Reader:
    """Return what reads a list, of any length or a fixed one."""
    return lambda value: tuple(map(read, value.items(count)))


def checked(read: Reader, good: Callable[[Any], Any], wrong: str, fix: str = "") -> Reader:
    """Return what refuses values that are not good; ``wrong`` says what they are."""

    def refusing(value: Value) -> Any:  # noqa: ANN401
        found = read(value)
        if not good(found):
            raise value.wrong(wrong.format(found), fix)
        return found

    return refusing


def positive(read: Reader, fix: str = "") -> Reader:
    """Return what refuses zero and below."""
    return checked(
        read, lambda found: found >= LEAST, f" = {{:g}} must be positive, at least {LEAST:g}", fix
    )


def rising(read: Reader, wrong: str) -> Reader:
    """Return what reads two values, of which the first is lower; ``wrong`` says what others are."""
    return checked(several(read, 2), lambda ends: np.all(np.less(*ends)), wrong)


def per_joint(read: Reader, *, shared: bool = False) -> Reader:
    """Return what reads one value per joint, in chain order; where ``shared``, one may stand for all."""

    def every(value: Value) -> tuple[Any, ...]:
        joints = value.context.joints
        single = shared and not value.is_list
        items = [value] * len(joints) if single else value.items(len(joints))
        return tuple(
            read(item.within(revolute=joint.revolute))
            for item, joint in zip(items, joints, strict=True)
        )

    return every


def mapping(
    keys: Mapping[str, Reader],
    make: Callable[..., Any],
    required: Sequence[str] = (),
    either: Sequence[str] = (),
) -> Reader:
    """Return what reads a mapping; ``make`` takes its values by key, of which one of ``either`` is there."""

    def made(value: Value) -> object:
        given = value.read(keys, required)
        if either and sum(key in given for key in either) != 1:
            raise value.wrong(f" needs one of {', '.join(either)}")
        return make(**given)

    return made


def by_link(read: Reader) -> Reader:
    """Return what reads a mapping from link numbers."""

    def every(value: Value) -> tuple[tuple[int, Any], ...]:
        numbers = range(1, len(value.context.joints) + 1)
        items = value.mapping([str(number) for number in numbers])
        return tuple((int(number), read(item)) for number, item in items.items())

    return every


# ---------------------------------------------------------------- readers of single keys
def _dh_angle(value: Value) -> float:
    """Read a DH angle; refuse more than a full turn, snap near-misses such as 1.5708 and say so."""
    angle = value.angle()
    given = f" = {value.text()}"
    if abs(angle) > 2 * math.pi + 1e-9:
        raise value.wrong(
            f"{given} {value.context.angle_unit} is more than a full turn", kind=AngleTooLarge
        )
    used = snapped(angle)
    degrees = f"{math.degrees(used):g} deg"
    if abs(angle - used) > 1e-9:
        text = (
            f"{value.where}: {value.path}{given} is {abs(angle - used):.1e} rad from {degrees}; "
            f"{degrees} is used (write `{degrees}` to silence this)"
        )
        value.note("W202", text, given_rad=angle, used_rad=used)
    return used


def coordinate(value: Value) -> float:
    """Return a position of the joint at hand, or what is measured like one, also per second."""
    return value.angle() if value.context.revolute else value.number()


def read_joints(value: Value) -> tuple[Joint, ...]:
    """Return the joints of a robot file."""
    items = value.items()
    if not items:
        raise value.wrong(" is empty")
    joints = {}
    for number, item in enumerate(items, start=1):
        kind = item.entries().get("type")
        revolute = kind is None or kind.text() != "prismatic"
        given = item.within(revolute=revolute).read(JOINT)
        joint = Joint(**{"name": f"joint_{number}", **given})
        if joint.name in joints:
            raise value.wrong(f": two joints are called '{joint.name}'")
        joints[joint.name] = joint
    return tuple(joints.values())


def _links(value: Value) -> tuple[int, ...]:
    if not value.is_list and value.text() == "all":
        return ()
    numbers, n = {item.integer() for item in value.items()}, len(value.context.joints)
    for number in numbers:
        if not 1 <= number <= n:
            raise value.wrong(f": there is no link {number}, the arm has {n}")
    return tuple(sorted(numbers))


def _share(value: Value) -> float:
    text = value.text().strip()
    share = number_or_nan(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    if not 0.0 <= share < 1.0:
        raise value.wrong(f" = {text} must be a share from 0 to below 100 %", "such as 5%")
    return share


def _torque(value: Value) -> TorqueSource:
    """Read what the torques are: a word, or a mapping."""
    if not value.is_mapping:
        return TorqueSource(value.choice(TORQUE_SOURCES))
    return TorqueSource(**value.read(TORQUE))


def _joint_map(value: Value, given: dict[str, Any]) -> JointMap:
    """Take signs and offsets out of what is given, with their defaults."""
    n = len(value.context.joints)
    sign, offset = given.pop("sign", (1.0,) * n), given.pop("offset", (0.0,) * n)
    return JointMap(sign, offset, given.pop("torque_sign", ()))


def _driver(value: Value) -> DriverSpec:
    given = value.read(DRIVER, ["kind"])
    for key, pattern in given.get("columns", {}).items():
        one = "{name}" in pattern or "{i}" in pattern or len(value.context.joints) == 1
        if key != "time" and not one:
            raise value.wrong(f".columns.{key} = '{pattern}' needs {{i}} or {{name}}")
    joint_map = _joint_map(value, given)
    return DriverSpec(map=joint_map, **given)


def _coupling(value: Value) -> Coupling:
    """Read reductions and a coupling matrix; a matrix whose diagonal is the reductions holds them already."""
    given, n = value.read(COUPLING), len(value.context.joints)
    matrix = np.array(given.get("matrix", np.eye(n)))
    reduction = np.array(given.get("reduction", np.diag(matrix)))
    if not np.allclose(np.diag(matrix), reduction):
        matrix = reduction[:, None] * matrix
    if abs(np.linalg.det(matrix / np.abs(matrix).max())) < 1e-12:
        raise value.wrong(": the matrix cannot be inverted")
    return Coupling(tuple(map(tuple, matrix.tolist())))


def unit_of(keys: Mapping[str, Value]) -> str:
    """Return the unit of plain numbers that are angles."""
    return keys["angle_unit"].choice(tuple(ANGLE)) if "angle_unit" in keys else "rad"


def _joint_name(value: Value) -> str:
    return value.choice([joint.name for joint in value.context.joints])


def _numbers(value: Value) -> dict[str, float]:
    return {name: item.number() for name, item in value.entries().items()}


def _inertia(value: Value) -> tuple[float, ...]:
    entries = value.read(dict.fromkeys(INERTIA, NUMBER))
    return tuple(entries.get(name, 0.0) for name in INERTIA)


def _body(value: Value) -> Body:
    """Read a body; say so where its inertia is one that no distribution of mass has (W207)."""
    body = Body(**value.read(BODY, ["mass"]))
    size = float(np.abs(body.inertia_com).max())
    moments = np.linalg.eigvalsh(body.tensor / (size or 1.0))
    if moments[0] + moments[1] - moments[2] < -tuning.ROUNDED_INERTIA:
        shown = [float(f"{size * moment:.3g}") for moment in moments]
        text = (
            f"{value.where}: no body has this inertia_com: its principal moments are "
            f"{', '.join(map('{:g}'.format, shown))} kg m^2, "
            "and the largest is more than the other two together"
        )
        value.note("W207", text, principal_moments=shown)
    return body


# ---------------------------------------------------------------- the keys
VECTOR = several(NUMBER, 3)
SIGNS = per_joint(checked(NUMBER, lambda sign: sign in (1.0, -1.0), " = {:g} must be 1 or -1"))
MASS = checked(NUMBER, lambda mass: mass >= 0, " = {:g} kg is negative")
MASSES = rising(MASS, ": {0[0]:g}, {0[1]:g} is not a range of masses")
#: A name that a page can show, a file can have and a simulator can hold.
NAME = checked(
    TEXT,
    lambda name: name.isprintable() and 1 <= len(name) <= LONGEST_NAME,
    f" = {{!r:.22}} must be 1 to {LONGEST_NAME} printable characters",
)
RATE = or_null(positive(coordinate))

LIMITS: Keys = {
    "position": or_null(rising(coordinate, ": lower limit {0[0]:g} is not below upper {0[1]:g}")),
    "velocity": RATE,
    "acceleration": RATE,
    "torque": or_null(positive(NUMBER)),
}
JOINT: Keys = {
    "name": NAME,
    "type": choice("revolute", "prismatic"),
    "a": NUMBER,
    "twist": _dh_angle,
    "d": NUMBER,
    "theta_offset": _dh_angle,
    "limits": mapping(LIMITS, Limits),
    "motor_inertia": Value.flag,
    "friction": several(choice(*FRICTION_PARAMETERS)),
}
BASE: Keys = {"xyz": VECTOR, "rpy": several(Value.angle, 3)}
GAIN = or_null(positive(NUMBER, "reverse a current with `sign:` under `driver:`"))
TORQUE: Keys = {
    "source": choice(*TORQUE_SOURCES),
    "gain": or_null(per_joint(GAIN, shared=True)),
    "relative": Value.flag,
    "noise": per_joint(positive(NUMBER, "it is a standard deviation in N m"), shared=True),
    "gain_error": _share,
}
UNITS: Keys = {quantity: choice(*units) for quantity, units in FACTORS.items()}
SIMULATOR: Keys = {"sign": SIGNS, "offset": per_joint(coordinate)}
COLUMNS: Keys = dict.fromkeys(PATTERNS, TEXT)
DRIVER: Keys = {
    "kind": choice(*DRIVERS),
    "topic": or_null(TEXT),
    "joint_names": per_joint(TEXT),
    "sign": SIGNS,
    "torque_sign": SIGNS,
    "offset": per_joint(coordinate),
    "units": mapping(UNITS, lambda **given: USUAL_UNITS | given),
    "columns": mapping(COLUMNS, dict),
}
BODY: Keys = {"mass": MASS, "com": VECTOR, "inertia_com": _inertia}
CYLINDERS: Keys = dict.fromkeys(("density", "radius", "mass"), positive(NUMBER))
PRIOR: Keys = {
    "cylinders": mapping(CYLINDERS, Cylinders, either=("density", "mass")),
    "links": per_joint(_body),
}
COUPLING: Keys = {"reduction": per_joint(NUMBER), "matrix": per_joint(per_joint(NUMBER))}
COULOMB: Keys = {
    "shape": choice("smooth", "threshold"),
    "velocity": per_joint(positive(coordinate), shared=True),
}
EFFECT: Keys = {
    "effect": TEXT,
    "joints": several(_joint_name),
    "parameters": _numbers,
    "std_error": _numbers,
    "formula": TEXT,
}
KNOWN: Keys = {
    "total_mass": MASSES,
    "link_mass": by_link(MASSES),
    "com_box": by_link(rising(VECTOR, ": the first corner must be the lower one")),
}
#: What is known before measuring.
A_PRIOR = mapping(PRIOR, Prior, either=("cylinders", "links"))
#: Why the joints are read separately: all other keys depend on their number and on which of them are revolute.
ROBOT: Keys = {
    "name": NAME,
    "convention": choice("standard", "modified"),
    "angle_unit": choice(*ANGLE),
    "gravity": VECTOR,
    "mount": choice("floor", "wall", "ceiling"),
    "base": mapping(BASE, dict),
    "joints": lambda value: value.context.joints,
    "links": _links,
    "torque": _torque,
    "driver": _driver,
    "simulator": lambda value: _joint_map(value, value.read(SIMULATOR)),
    "prior": A_PRIOR,
    "tool": or_null(_body),
    "known": mapping(KNOWN, Known),
    "coupling": or_null(_coupling),
    "coulomb": mapping(
        COULOMB, lambda velocity, shape="smooth": Coulomb(shape, velocity), ["velocity"]
    ),
    "effects": several(mapping(EFFECT, EffectSpec, ["effect", "joints"])),
}
