"""The keys of the robot file, each declared once: name, type, unit, default, one sentence.

From these declarations come reading, the messages about unknown, missing and mistyped keys, and the reference page
docs/reference/robot-file.md. What has to fit together across keys is checked in ``robotfile``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dynid.drivers.interface import DRIVERS
from dynid.errors import AngleTooLarge, Finding, WrongRobotFile
from dynid.files import tuning
from dynid.files.yamlfile import ANGLE_, FLAG, NUMBER, REQUIRED, TEXT, Key, Kind, Value
from dynid.robot import (
    FRICTION_PARAMETERS,
    MOST_JOINTS,
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

#: DH angles that nearly are a multiple of this are taken to mean it [rad].
SNAP_STEP = math.pi / 12

#: Least size of what has to be there, in whatever unit: it is divided by, and its powers are.
LEAST = 1e-12

#: Names go into file names, of which systems keep 255 characters.
LONGEST_NAME = 100

TORQUE_SOURCES = ("joint_sensor", "motor_torque", "motor_current", "gravity_free", "unknown")
INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
#: Other usual names of keys of the DH table.
USUAL_KEYS = {"alpha": "twist", "theta": "theta_offset", "offset": "theta_offset"}


def snapped(angle: float) -> float:
    """Return an angle [rad], a multiple of 15 degrees where it nearly is one, such as 1.5708."""
    nearest = round(angle / SNAP_STEP) * SNAP_STEP
    return nearest if abs(angle - nearest) < tuning.SNAP_RAD else angle


# ---------------------------------------------------------------- types of values
def _name(value: Value) -> str:
    """Return a name that a page can show and a simulator can hold: PyBullet ends the process on others."""
    name = value.text()
    if not 1 <= len(name) <= LONGEST_NAME:
        raise value.wrong(f" has {len(name)} characters; a name has 1 to {LONGEST_NAME}")
    return name


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
        facts = {"given_rad": angle, "used_rad": used}
        value.context.findings.append(Finding("W202", "warning", text, facts))
    return used


def _coordinate(value: Value) -> float:
    return value.angle() if value.context.revolute else value.number()


NAME = Kind("text", _name)
DH_ANGLE = Kind("angle", _dh_angle)
#: A position of the joint at hand, or what is measured like one; and the same per second.
COORDINATE, RATE = Kind("angle or length", _coordinate), Kind("number", _coordinate)


def choice(*words: str) -> Kind:
    """Return the type of one of a few words."""
    return Kind(" or ".join(f"`{word}`" for word in words), lambda value: value.choice(words))


def positive(kind: Kind, fix: str = "") -> Kind:
    """Return a type without zero and below."""

    def read(value: Value) -> float:
        found: float = kind.read(value)
        if found < LEAST:
            least = f", at least {LEAST:g}" if found > 0 else ""
            raise value.wrong(f" = {found:g} must be positive{least}", fix)
        return found

    return Kind(f"{kind.words} above 0", read)


def several(kind: Kind, count: int | None = None) -> Kind:
    """Return the type of a list, of any length or a fixed one."""
    plain = count is None and kind.words != "mapping"
    number = "" if count is None else f"{count} "
    return Kind(
        f"list of {number}{kind.words}{'' if plain else 's'}",
        lambda value: tuple(kind.read(item) for item in value.items(count)),
        kind.keys,
    )


def rising(kind: Kind, words: str, wrong: str) -> Kind:
    """Return the type of a list of two values, of which the first is lower; ``wrong`` says what others are."""

    def read(value: Value) -> tuple[Any, Any]:
        low, high = (kind.read(item) for item in value.items(2))
        if not np.all(np.less(low, high)):
            raise value.wrong(wrong.format(low, high))
        return low, high

    return Kind(words, read)


def per_joint(kind: Kind, *, shared: bool = False, nullable: bool = False) -> Kind:
    """Return the type of one value per joint, in chain order.

    Args:
        kind: of each value.
        shared: whether one value may stand for all joints.
        nullable: whether ``null`` stands for a value that is not known.
    """

    def read(value: Value) -> tuple[Any, ...]:
        joints = value.context.joints
        single = shared and not value.is_list
        items = [value] * len(joints) if single else value.items(len(joints))
        return tuple(
            None
            if nullable and item.is_null
            else kind.read(replace(item, context=replace(item.context, revolute=joint.revolute)))
            for item, joint in zip(items, joints, strict=True)
        )

    return Kind(
        f"{kind.words}, or a list per joint" if shared else f"list: {kind.words} per joint", read
    )


def mapping(keys: tuple[Key, ...], make: Callable[..., Any], *either: str) -> Kind:
    """Return the type of a mapping; ``make`` takes its values by key, of which one of ``either`` is there."""

    def read(value: Value) -> object:
        given = value.read(keys)
        if either and sum(key in given for key in either) != 1:
            raise value.wrong(f" needs one of {', '.join(either)}")
        return make(**given)

    return Kind("mapping", read, keys)


def by_link(kind: Kind) -> Kind:
    """Return the type of a mapping from link numbers."""

    def read(value: Value) -> tuple[tuple[int, Any], ...]:
        numbers = range(1, len(value.context.joints) + 1)
        found = value.mapping([str(number) for number in numbers])
        return tuple((int(number), kind.read(item)) for number, item in found.items())

    return Kind(f"link number: {kind.words}", read)


# ---------------------------------------------------------------- types of single keys
def read_joints(value: Value) -> tuple[Joint, ...]:
    """Return the joints of a robot file."""
    items = value.items()
    if len(items) > MOST_JOINTS:
        raise value.wrong(f": {len(items)} joints; a robot has at most {MOST_JOINTS}")
    if not items:
        raise value.wrong(" is empty")
    joints: list[Joint] = []
    for number, item in enumerate(items, start=1):
        kind = item.entries().get("type")
        context = replace(item.context, revolute=kind is None or kind.text() != "prismatic")
        keys = replace(item, context=context).read(JOINT, USUAL_KEYS)
        joints.append(Joint(**{"name": f"joint_{number}", **keys}))
        if joints[-1].name in [joint.name for joint in joints[:-1]]:
            raise value.wrong(f": two joints are called '{joints[-1].name}'")
    return tuple(joints)


def _mass(value: Value) -> float:
    found = value.number()
    if found < 0:
        raise value.wrong(f" = {found:g} kg is negative")
    return found


def _sign(value: Value) -> float:
    found = value.number()
    if found not in (1.0, -1.0):
        whole = replace(value, path=value.path.partition("[")[0])
        raise whole.wrong(f" entries are 1 or -1, not {found:g}")
    return found


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
    try:
        found = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        found = -1.0
    if not 0.0 <= found < 1.0:
        raise value.wrong(f" = {text} must be a share from 0 to below 100 %", "such as 5%")
    return found


def _torque(value: Value) -> TorqueSource:
    if not value.is_mapping:
        return TorqueSource(value.choice(TORQUE_SOURCES))
    return TorqueSource(**value.read(TORQUE))


def _noise(value: Value) -> tuple[float, ...]:
    found: tuple[float, ...] = _NOISE.read(value)
    if None in found:
        raise value.wrong(": it is missing for a joint")
    return found


def _joint_map(value: Value, keys: tuple[Key, ...]) -> tuple[JointMap, dict[str, Any]]:
    """Return signs and offsets of all joints, and the other keys."""
    n, given = len(value.context.joints), value.read(keys)
    sign, offset = given.pop("sign", (1.0,) * n), given.pop("offset", (0.0,) * n)
    return JointMap(sign, offset, given.pop("torque_sign", ())), given


def _driver(value: Value) -> DriverSpec:
    joint_map, given = _joint_map(value, DRIVER)
    for key, pattern in given.get("columns", {}).items():
        one = "{name}" in pattern or "{i}" in pattern or len(value.context.joints) == 1
        if key != "time" and not one:
            raise WrongRobotFile(
                f"{value.where}: columns.{key} = '{pattern}' needs {{i}} or {{name}}",
                where=value.where,
            )
    return DriverSpec(**{"topic": None, "joint_names": (), "map": joint_map, **given})


def _coupling(value: Value) -> Coupling:
    """Read reductions and a coupling matrix; a matrix whose diagonal is the reductions holds them already."""
    given, n = value.read(COUPLING), len(value.context.joints)
    matrix = np.array(given.get("matrix", np.eye(n)))
    reduction = np.array(given.get("reduction", np.diag(matrix)))
    if not np.allclose(np.diag(matrix), reduction):
        matrix = reduction[:, None] * matrix
    if abs(np.linalg.det(matrix / np.abs(matrix).max())) < 1e-12:
        raise WrongRobotFile(
            f"{value.where}: the coupling matrix cannot be inverted", where=value.where
        )
    return Coupling(tuple(map(tuple, matrix.tolist())))


def _acting(value: Value) -> tuple[str, ...]:
    return tuple(
        item.choice([joint.name for joint in value.context.joints]) for item in value.items()
    )


def _numbers(value: Value) -> dict[str, float]:
    return {name: item.number() for name, item in value.entries().items()}


def _inertia(value: Value) -> tuple[float, ...]:
    found = value.mapping(INERTIA)
    return tuple(found[name].number() if name in found else 0.0 for name in INERTIA)


def _body(value: Value) -> Body:
    """Read a body; say so where its inertia is one that no distribution of mass has (W207)."""
    found = Body(**value.read(BODY))
    size = float(np.abs(found.inertia_com).max())
    moments = np.linalg.eigvalsh(found.tensor / (size or 1.0))
    if moments[0] + moments[1] - moments[2] < -tuning.ROUNDED_INERTIA:
        shown = [float(f"{size * moment:.3g}") for moment in moments]
        text = (
            f"{value.where}: no body has this inertia_com: its principal moments are "
            f"{', '.join(map('{:g}'.format, shown))} kg m^2, "
            "and the largest is more than the other two together"
        )
        value.context.findings.append(
            Finding("W207", "warning", text, {"principal_moments": shown})
        )
    return found


VECTOR = several(NUMBER, 3)
_NOISE = per_joint(
    positive(NUMBER, "it is a standard deviation in N m"), shared=True, nullable=True
)
_MASSES = rising(
    Kind("mass", _mass), "list of least and greatest mass", ": {:g}, {:g} is not a range of masses"
)
_SIGN = per_joint(Kind("1 or -1", _sign))

# ---------------------------------------------------------------- the keys
_ANGLE_UNIT, _JOINT_UNIT, _RATE_UNIT = "`angle_unit`", "`angle_unit` or m", "`angle_unit`/s or m/s"

LIMITS = (
    Key(
        "position",
        rising(
            COORDINATE,
            "list of lower and upper limit",
            ": lower limit {:g} is not below upper {:g}",
        ),
        "Range of the joint; null for a joint that turns without end.",
        unit=_JOINT_UNIT,
        nullable=True,
    ),
    Key("velocity", positive(RATE), "Largest speed.", unit=_RATE_UNIT, nullable=True),
    Key(
        "acceleration",
        positive(RATE),
        "Largest acceleration.",
        unit="`angle_unit`/s^2 or m/s^2",
        nullable=True,
    ),
    Key("torque", positive(NUMBER), "Rated torque or force.", unit="N m or N", nullable=True),
)

JOINT = (
    Key("name", NAME, "Name of the joint, also that of its column in logs.", "`joint_1`, ..."),
    Key(
        "type", choice("revolute", "prismatic"), "Whether the joint turns or slides.", "`revolute`"
    ),
    Key("a", NUMBER, "DH length along the common normal of two axes.", "0", "m"),
    Key(
        "twist",
        DH_ANGLE,
        "DH angle alpha between two axes; the word alpha means the safety factor of the paper.",
        "0",
        _ANGLE_UNIT,
    ),
    Key("d", NUMBER, "DH offset along the axis; it is added to q for a prismatic joint.", "0", "m"),
    Key(
        "theta_offset",
        DH_ANGLE,
        "Revolute joint: theta = q + theta_offset. Prismatic joint: theta itself.",
        "0",
        _ANGLE_UNIT,
    ),
    Key("limits", mapping(LIMITS, Limits), "Limits of the joint."),
    Key("motor_inertia", FLAG, "Keep the column of the rotor inertia Im of this joint.", "`true`"),
    Key(
        "friction",
        several(choice(*FRICTION_PARAMETERS)),
        "Friction columns of this joint.",
        "`[viscous, coulomb, offset]`",
    ),
)

BASE = (
    Key("xyz", VECTOR, "Position of frame 0 in the world.", "`[0, 0, 0]`", "m"),
    Key(
        "rpy",
        several(ANGLE_, 3),
        "Roll, pitch and yaw of frame 0 about the fixed axes of the world.",
        "`[0, 0, 0]`",
        _ANGLE_UNIT,
    ),
)

TORQUE = (
    Key("source", choice(*TORQUE_SOURCES), "What the effort column of a log is.", "`unknown`"),
    Key(
        "gain",
        per_joint(
            positive(NUMBER, "reverse a current with `sign:` under `driver:`"),
            shared=True,
            nullable=True,
        ),
        "Torque per motor current; null where it is not known.",
        unit="N m per A",
        nullable=True,
    ),
    Key(
        "relative",
        FLAG,
        "Whether only the ratios of the gains are known; torques are then counted as "
        "amperes (see [estimators](../explanation/estimators.md)).",
        "`false`",
    ),
    Key(
        "noise",
        Kind(_NOISE.words, _noise),
        "Standard deviation of the torque, used to plan motions and to predict errors before anything is measured.",
        "0.3 % of the rating, 0.1 N m for a joint without one",
        "N m or N",
    ),
    Key(
        "gain_error",
        Kind("share", _share),
        "Standard deviation of the torque's scale, such as `5%`; a load's mass and inertia are as uncertain.",
        "5 % of motor currents, 0 of other sources",
    ),
)

UNITS = (
    Key(
        "position",
        choice(*FACTORS["position"]),
        "Unit of the positions; m and mm are those of a sliding joint.",
        "`rad`",
    ),
    Key("velocity", choice(*FACTORS["velocity"]), "Unit of the velocities.", "`rad/s`"),
    Key("effort", choice(*FACTORS["effort"]), "Unit of the torques, forces or currents.", "`Nm`"),
)

SIMULATOR = (
    Key(
        "sign",
        _SIGN,
        "Direction of each joint: q_dh = sign * q + offset.",
        "1",
    ),
    Key(
        "offset",
        per_joint(COORDINATE),
        "Offset of each joint: q_dh = sign * q + offset.",
        "0",
        _JOINT_UNIT,
    ),
)

COLUMNS = (
    Key("time", TEXT, "Name of the column of time stamps.", "`t`, `time`, ..."),
    Key(
        "name",
        TEXT,
        "Pattern of columns that hold the names of the joints, such as those of `rostopic echo -p`; "
        "their order is then that of the others.",
    ),
    Key(
        "position",
        TEXT,
        "Pattern of the columns of positions: `{name}` stands for a name of "
        "`joint_names`, `{i}` for the number of the joint, counted from 0 or 1.",
        "`q_{name}`",
    ),
    Key("velocity", TEXT, "Pattern of the columns of velocities.", "`qd_{name}`"),
    Key(
        "effort",
        TEXT,
        "Pattern of the columns of torques or currents.",
        "`tau_{name}` or `i_{name}`",
    ),
    Key("reference", TEXT, "Pattern of the columns of commanded positions.", "`q_ref_{name}`"),
)

DRIVER = (
    Key("kind", choice(*DRIVERS), "The driver that made the log.", REQUIRED),
    Key("topic", TEXT, "ROS topic of the joint states.", "that of the driver", nullable=True),
    Key(
        "joint_names",
        per_joint(TEXT),
        "Names of the log's columns in chain order.",
        "names of the joints",
    ),
    Key(
        "sign",
        _SIGN,
        "Direction of each joint: q_dh = sign * q_log + offset, tau_dh = sign * tau_log.",
        "1",
    ),
    Key(
        "torque_sign",
        _SIGN,
        "Direction of the torque against that of the position, -1 such as for "
        "torques that the arm feels instead of those it makes: tau_dh = sign * torque_sign * tau_log.",
        "1",
    ),
    Key(
        "offset",
        per_joint(COORDINATE),
        "Offset of each joint: q_dh = sign * q_log + offset.",
        "0",
        _JOINT_UNIT,
    ),
    Key(
        "units",
        mapping(
            UNITS, lambda **given: {"position": "rad", "velocity": "rad/s", "effort": "Nm"} | given
        ),
        "Units of the log's columns; those that a log itself declares go before them.",
        "rad, rad/s, Nm",
    ),
    Key(
        "effort_topic",
        TEXT,
        "Topic of the torques where they are published apart from the positions: "
        "`sensor_msgs/JointState` or `std_msgs/Float64MultiArray`.",
        nullable=True,
    ),
    Key(
        "columns",
        mapping(COLUMNS, dict),
        "Names of the columns of CSV and TSV files.",
        "see [logs](log-format.md)",
    ),
)

BODY = (
    Key("mass", Kind("number from 0", _mass), "Mass.", REQUIRED, "kg"),
    Key("com", VECTOR, "Centre of mass in the DH frame of the link.", "`[0, 0, 0]`", "m"),
    Key(
        "inertia_com",
        Kind(f"mapping: {', '.join(INERTIA)}", _inertia),
        "Inertia about the centre of mass, axes of the DH frame of the link. Before it is fitted, a link without width "
        "(a point, a thin rod) is spread as a cylinder along its DH offset.",
        "0",
        "kg m^2",
    ),
)

A_BODY = Kind("mapping", _body, BODY)

CYLINDERS = (
    Key("density", positive(NUMBER), "Density of the cylinders; this or `mass`.", unit="kg/m^3"),
    Key("radius", positive(NUMBER), "Radius of the cylinders.", "0.06", "m"),
    Key("mass", positive(NUMBER), "Mass of all links together; this or `density`.", unit="kg"),
)

PRIOR = (
    Key(
        "cylinders",
        mapping(CYLINDERS, Cylinders, "density", "mass"),
        "Uniform cylinders along the DH offsets (Paper Eq. 9); this or `links`.",
    ),
    Key(
        "links",
        Kind("list with one body per link", per_joint(A_BODY).read, BODY),
        "Bodies with numbers; this or `cylinders`.",
    ),
)

#: What is known before measuring.
A_PRIOR = mapping(PRIOR, Prior, "cylinders", "links")

COUPLING = (
    Key("reduction", per_joint(NUMBER), "Gear ratio of each joint.", "1"),
    Key(
        "matrix",
        Kind("n rows of n numbers", per_joint(per_joint(NUMBER)).read),
        "Motor positions per joint position: q_motor = matrix * q, tau_joint = matrix^T * tau_motor.",
        "identity",
    ),
)

COULOMB = (
    Key(
        "shape",
        choice("smooth", "threshold"),
        "tanh(qd / velocity), or zero below the velocity (Paper Eq. 7).",
        "`smooth`",
    ),
    Key(
        "velocity",
        per_joint(positive(RATE), shared=True),
        "Velocity at which the sign changes.",
        REQUIRED,
        _RATE_UNIT,
    ),
)

EFFECT = (
    Key("effect", TEXT, "Identifier of the effect, see [effects](effects.md).", REQUIRED),
    Key("joints", Kind("list of joint names", _acting), "Joints that it acts on.", REQUIRED),
    Key("parameters", Kind("name: number", _numbers), "Values of its parameters."),
    Key("std_error", Kind("name: number", _numbers), "Their standard errors."),
    Key("formula", TEXT, "The torque of `effect: formula`, such as `a cos(2 q4) |qd4|`."),
)

KNOWN = (
    Key(
        "total_mass",
        _MASSES,
        "Range of the mass of all identified links.",
        unit="kg",
    ),
    Key(
        "link_mass",
        by_link(_MASSES),
        "Range of the mass of links.",
        unit="kg",
    ),
    Key(
        "com_box",
        by_link(
            rising(VECTOR, "lower and upper corner", ": the first corner must be the lower one")
        ),
        "Box around the centre of mass of links, in their DH frames.",
        unit="m",
    ),
)

#: Why the joints are read apart: all other keys depend on their number and on which of them are revolute.
ROBOT = (
    Key(
        "name",
        NAME,
        "Name for people; the folder of the results has the name of the file.",
        REQUIRED,
    ),
    Key(
        "convention",
        choice("standard", "modified"),
        "Which DH convention: distal or proximal frames.",
        REQUIRED,
    ),
    Key(
        "angle_unit",
        choice(*ANGLE),
        "Unit of plain numbers that are angles; a single angle may say its own: `90 deg`, `pi/2`.",
        "`rad`",
    ),
    Key(
        "gravity",
        VECTOR,
        "Gravity in frame 0, where the DH chain starts.",
        "`[0, 0, -9.81]`",
        "m/s^2",
    ),
    Key(
        "mount",
        choice("floor", "wall", "ceiling"),
        "Where the arm is fixed: `ceiling` turns the default "
        "gravity over; a gravity that points up brings a warning unless this says `wall` or `ceiling`.",
        "`floor`",
    ),
    Key(
        "base",
        mapping(BASE, dict),
        "Pose of frame 0 in the world, for pictures and URDF; gravity is in frame 0 already.",
        "zero",
    ),
    Key(
        "joints",
        Kind("list of mappings", lambda value: value.context.joints, JOINT),
        "The joints from base to tip, one row of the DH table each.",
        REQUIRED,
    ),
    Key(
        "links",
        Kind("`all` or list of link numbers", _links),
        "Links to identify; the others keep the values of the prior.",
        "`all`",
    ),
    Key(
        "torque",
        Kind("word or mapping", _torque, TORQUE),
        "What the effort column of a log is; a word stands for `source`.",
        "`unknown`",
    ),
    Key(
        "driver",
        Kind("mapping", _driver, DRIVER),
        "How the columns of a log become DH quantities.",
    ),
    Key(
        "simulator",
        Kind("mapping", lambda value: _joint_map(value, SIMULATOR)[0], SIMULATOR),
        "How the joint angles of a simulator become DH quantities.",
    ),
    Key(
        "prior",
        A_PRIOR,
        "What is known of the links before measuring.",
    ),
    Key("tool", A_BODY, "A body fixed to the last link.", nullable=True),
    Key(
        "known",
        mapping(KNOWN, Known),
        "Bounds that the full set keeps (see [consistency](../explanation/consistency.md)).",
    ),
    Key(
        "coupling",
        Kind("mapping", _coupling, COUPLING),
        "Gears and coupled joints of motor-side logs.",
        nullable=True,
    ),
    Key(
        "coulomb",
        mapping(COULOMB, lambda velocity, shape="smooth": Coulomb(shape, velocity)),
        "Shape of the sign of Coulomb friction.",
        "`smooth`, 0.01 rad/s or 1 mm/s until it is estimated from logs",
    ),
    Key(
        "effects",
        several(mapping(EFFECT, EffectSpec)),
        "Torque effects added to the model.",
    ),
)
