"""The keys of the robot file, each declared once: name, type, unit, default, one sentence.

From these declarations come reading, the messages about unknown, missing and mistyped keys, and the reference page
docs/reference/robot-file.md. What has to fit together across keys is checked in ``robotfile``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dynid.drivers.interface import DRIVERS
from dynid.errors import AngleTooLarge, Finding, WrongRobotFile
from dynid.files import tuning
from dynid.files.yamlfile import Value
from dynid.robot import (
    FRICTION_PARAMETERS,
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
REQUIRED = "required"


@dataclass(frozen=True)
class Context:
    """What the meaning of a value depends on besides the value.

    Attributes:
        angle_unit: unit of plain numbers that are angles.
        joints: joints of the arm, () while they are read.
        revolute: whether the joint at hand is revolute.
        findings: what was noticed; reading appends to it.
    """

    angle_unit: str = "rad"
    joints: tuple[Joint, ...] = ()
    revolute: bool = True
    findings: list[Finding] = field(default_factory=list)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)


@dataclass(frozen=True)
class Kind:
    """A type of value.

    Attributes:
        words: its name in the reference.
        read: makes the value from what stands in the file.
        keys: the keys inside, where it is a mapping.
    """

    words: str
    read: Callable[[Value, Context], Any]
    keys: tuple[Key, ...] = ()


@dataclass(frozen=True)
class Key:
    """One key.

    Attributes:
        name: the key.
        kind: type of its value.
        default: what holds without it, as the reference shows it; ``"required"`` where it must be there.
        help: what it is, in one or two sentences.
        unit: unit of the value; "" for none.
        nullable: whether ``null`` means that it is left out.
    """

    name: str
    kind: Kind
    default: str
    help: str
    unit: str = ""
    nullable: bool = False


def read_keys(value: Value, keys: Sequence[Key], context: Context) -> dict[str, Any]:
    """Return the values of a mapping by key, without those that are left out.

    Raises:
        UnknownKey: a key is not among ``keys``.
        WrongRobotFile: a required key is missing.
    """
    found = value.mapping(
        [key.name for key in keys], [key.name for key in keys if key.default == REQUIRED]
    )
    return read_found(found, keys, context)


def read_found(found: dict[str, Value], keys: Sequence[Key], context: Context) -> dict[str, Any]:
    """Return the values of keys that were found in a mapping."""
    given = [
        key for key in keys if key.name in found and not (key.nullable and found[key.name].is_null)
    ]
    return {key.name: key.kind.read(found[key.name], context) for key in given}


# ---------------------------------------------------------------- types of values
def _name(value: Value, context: Context) -> str:
    """Return a name that a page can show and a simulator can hold: PyBullet ends the process on others."""
    name = value.text()
    if not 1 <= len(name) <= LONGEST_NAME:
        what = f"{value.where}: {value.path} has {len(name)} characters; a name has 1 to {LONGEST_NAME}"
        raise WrongRobotFile(what, where=value.where)
    return name


def _dh_angle(value: Value, context: Context) -> float:
    """Read a DH angle; refuse more than a full turn, snap near-misses such as 1.5708 and say so."""
    angle, unit = value.angle(context.angle_unit), context.angle_unit
    if abs(angle) > 2 * math.pi + 1e-9:
        what = f"{value.where}: {value.path} = {value.text()} {unit} is more than a full turn"
        raise AngleTooLarge(what, where=value.where)
    nearest = round(angle / SNAP_STEP) * SNAP_STEP
    miss, degrees = abs(angle - nearest), f"{math.degrees(nearest):g} deg"
    if 1e-9 < miss < tuning.SNAP_RAD:
        text = (
            f"{value.where}: {value.path} = {value.text()} is {miss:.1e} rad from {degrees}; "
            f"{degrees} is used (write `{degrees}` to silence this)"
        )
        context.findings.append(
            Finding("W202", "warning", text, {"given_rad": angle, "used_rad": nearest})
        )
    return nearest if miss < tuning.SNAP_RAD else angle


def _wrong(value: Value, text: str, fix: str = "") -> WrongRobotFile:
    return WrongRobotFile(f"{value.where}: {value.path}{text}", where=value.where, fix=fix)


TEXT = Kind("text", lambda value, _: value.text())
NAME = Kind("text", _name)
FLAG = Kind("true or false", lambda value, _: value.flag())
NUMBER = Kind("number", lambda value, _: value.number())
ANGLE_ = Kind("angle", lambda value, context: value.angle(context.angle_unit))
DH_ANGLE = Kind("angle", _dh_angle)
#: A position of the joint at hand, or what is measured like one.
COORDINATE = Kind(
    "angle or length",
    lambda v, context: v.angle(context.angle_unit) if context.revolute else v.number(),
)
#: The same per second.
RATE = Kind("number", COORDINATE.read)


def choice(*words: str) -> Kind:
    """Return the type of one of a few words."""
    return Kind(" or ".join(f"`{word}`" for word in words), lambda value, _: value.choice(words))


def positive(kind: Kind, fix: str = "") -> Kind:
    """Return a type without zero and below."""

    def read(value: Value, context: Context) -> float:
        found: float = kind.read(value, context)
        if found < LEAST:
            raise _wrong(
                value, f" = {found:g} must be positive" + f", at least {LEAST:g}" * (found > 0), fix
            )
        return found

    return Kind(f"{kind.words} above 0", read)


def not_negative(kind: Kind, unit: str = "") -> Kind:
    """Return a type without numbers below zero."""

    def read(value: Value, context: Context) -> float:
        found: float = kind.read(value, context)
        if found < 0:
            raise _wrong(value, f" = {found:g}{unit} is negative")
        return found

    return Kind(f"{kind.words} from 0", read)


def several(kind: Kind, count: int) -> Kind:
    """Return the type of a list of a fixed length."""
    words = f"list of {count} {kind.words}s"
    return Kind(
        words, lambda value, context: tuple(kind.read(item, context) for item in value.items(count))
    )


def per_joint(kind: Kind, *, shared: bool = False, nullable: bool = False) -> Kind:
    """Return the type of one value per joint, in chain order.

    Args:
        kind: of each value.
        shared: whether one value may stand for all joints.
        nullable: whether ``null`` stands for a value that is not known.
    """

    def read(value: Value, context: Context) -> tuple[Any, ...]:
        items = [value] * context.n if shared and not value.is_list else value.items(context.n)
        return tuple(
            None
            if nullable and item.is_null
            else kind.read(item, replace(context, revolute=joint.revolute))
            for item, joint in zip(items, context.joints, strict=True)
        )

    return Kind(
        f"{kind.words}, or a list per joint" if shared else f"list: {kind.words} per joint", read
    )


def mapping(keys: tuple[Key, ...], make: Callable[..., Any]) -> Kind:
    """Return the type of a mapping; ``make`` takes its values by key."""
    return Kind("mapping", lambda value, context: make(**read_keys(value, keys, context)), keys)


def list_of(kind: Kind) -> Kind:
    """Return the type of a list of any length."""
    words = f"list of {kind.words}s" if kind.words == "mapping" else f"list of {kind.words}"
    return Kind(
        words,
        lambda value, context: tuple(kind.read(item, context) for item in value.items()),
        kind.keys,
    )


def by_link(kind: Kind) -> Kind:
    """Return the type of a mapping from link numbers."""

    def read(value: Value, context: Context) -> tuple[tuple[int, Any], ...]:
        found = value.mapping([str(k) for k in range(1, context.n + 1)])
        return tuple((int(k), kind.read(item, context)) for k, item in found.items())

    return Kind(f"link number: {kind.words}", read)


def _range(value: Value, context: Context) -> tuple[float, float]:
    lower, upper = (COORDINATE.read(item, context) for item in value.items(2))
    if lower >= upper:
        raise _wrong(value, f": lower limit {lower:g} is not below upper {upper:g}")
    return lower, upper


def _masses(value: Value, context: Context) -> tuple[float, float]:
    low, high = (item.number() for item in value.items(2))
    if not 0 <= low < high:
        raise _wrong(value, f": {low:g}, {high:g} is not a range of masses")
    return low, high


def _box(value: Value, context: Context) -> tuple[Any, Any]:
    low, high = (VECTOR.read(item, context) for item in value.items(2))
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise _wrong(value, ": the first corner must be the lower one")
    return low, high


def _sign(value: Value, context: Context) -> float:
    found = value.number()
    if found not in (1.0, -1.0):
        name = value.path.partition("[")[0]
        raise WrongRobotFile(
            f"{value.where}: {name} entries are 1 or -1, not {found:g}", where=value.where
        )
    return found


def _links(value: Value, context: Context) -> tuple[int, ...]:
    if not value.is_list and value.text() == "all":
        return ()
    numbers = tuple(item.integer() for item in value.items())
    for number in numbers:
        if not 1 <= number <= context.n:
            what = f"{value.where}: links: there is no link {number}, the arm has {context.n}"
            raise WrongRobotFile(what, where=value.where)
    return tuple(sorted(set(numbers)))


def _share(value: Value, _: Context) -> float:
    text = value.text().strip()
    try:
        found = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        found = -1.0
    if not 0.0 <= found < 1.0:
        raise _wrong(value, f" = {text} must be a share from 0 to below 100 %", "such as 5%")
    return found


def _torque(value: Value, context: Context) -> TorqueSource:
    if not value.is_mapping:
        return TorqueSource(value.choice(TORQUE_SOURCES))
    return TorqueSource(**read_keys(value, TORQUE, context))


def _noise(value: Value, context: Context) -> tuple[float, ...]:
    found: tuple[float | None, ...] = _NOISE.read(value, context)
    if None in found:
        raise WrongRobotFile(
            f"{value.where}: {value.path}: it is missing for a joint", where=value.where
        )
    return tuple(each for each in found if each is not None)


def _units(value: Value, context: Context) -> dict[str, str]:
    return {"position": "rad", "velocity": "rad/s", "effort": "Nm"} | read_keys(
        value, UNITS, context
    )


def _joint_map(given: dict[str, Any], context: Context) -> JointMap:
    ones = (1.0,) * context.n
    return JointMap(
        given.pop("sign", ones),
        given.pop("offset", (0.0,) * context.n),
        given.pop("torque_sign", ()),
    )


def _simulator(value: Value, context: Context) -> JointMap:
    return _joint_map(read_keys(value, SIMULATOR, context), context)


def _driver(value: Value, context: Context) -> DriverSpec:
    given = read_keys(value, DRIVER, context)
    for key, pattern in given.get("columns", {}).items():
        if key != "time" and "{name}" not in pattern and "{i}" not in pattern and context.n > 1:
            raise WrongRobotFile(
                f"{value.where}: columns.{key} = '{pattern}' needs {{i}} or {{name}}",
                where=value.where,
            )
    return DriverSpec(
        **{"topic": None, "joint_names": (), "map": _joint_map(given, context), **given}
    )


def _cylinders(value: Value, context: Context) -> Cylinders:
    given = read_keys(value, CYLINDERS, context)
    if ("density" in given) == ("mass" in given):
        raise WrongRobotFile(
            f"{value.where}: prior.cylinders needs one of density, mass", where=value.where
        )
    return Cylinders(**given)


def read_prior(value: Value, context: Context) -> Prior:
    """Read what is known before measuring."""
    given = read_keys(value, PRIOR, context)
    if len(given) != 1:
        raise WrongRobotFile(
            f"{value.where}: prior needs one of cylinders, links", where=value.where
        )
    return Prior(**given)


def _coupling(value: Value, context: Context) -> Coupling:
    """Read reductions and a coupling matrix; a matrix whose diagonal is the reductions holds them already."""
    given, n = read_keys(value, COUPLING, context), context.n
    reduction, matrix = (
        np.array(given.get("reduction", np.ones(n))),
        np.array(given.get("matrix", np.eye(n))),
    )
    if "reduction" in given and not np.allclose(np.diag(matrix), reduction):
        matrix = reduction[:, None] * matrix
    if abs(np.linalg.det(matrix / np.abs(matrix).max())) < 1e-12:
        raise WrongRobotFile(
            f"{value.where}: the coupling matrix cannot be inverted", where=value.where
        )
    return Coupling(tuple(tuple(row) for row in matrix.tolist()))


def _matrix(value: Value, context: Context) -> tuple[Any, ...]:
    return tuple(
        tuple(item.number() for item in row.items(context.n)) for row in value.items(context.n)
    )


def _acting(value: Value, context: Context) -> tuple[str, ...]:
    return tuple(item.choice([joint.name for joint in context.joints]) for item in value.items())


def _numbers(value: Value, context: Context) -> dict[str, float]:
    return {name: item.number() for name, item in value.entries().items()}


def _inertia(value: Value, context: Context) -> tuple[float, ...]:
    found = value.mapping(INERTIA)
    return tuple(found[name].number() if name in found else 0.0 for name in INERTIA)


def _body(value: Value, context: Context) -> Body:
    """Read a body; say so where its inertia is one that no distribution of mass has (W207)."""
    found = Body(**read_keys(value, BODY, context))
    size = float(np.abs(found.inertia_com).max())
    moments = np.linalg.eigvalsh(found.tensor / (size or 1.0))
    if moments[0] + moments[1] - moments[2] < -tuning.ROUNDED_INERTIA:
        shown = [float(f"{size * moment:.3g}") for moment in moments]
        moments_text = ", ".join(f"{moment:g}" for moment in shown)
        text = (
            f"{value.where}: no body has this inertia_com: its principal moments are {moments_text} kg m^2, "
            "and the largest is more than the other two together"
        )
        context.findings.append(Finding("W207", "warning", text, {"principal_moments": shown}))
    return found


VECTOR = several(NUMBER, 3)
_NOISE = per_joint(
    positive(NUMBER, "it is a standard deviation in N m"), shared=True, nullable=True
)
_GAIN = per_joint(
    positive(NUMBER, "reverse a current with `sign:` under `driver:`"), shared=True, nullable=True
)

# ---------------------------------------------------------------- the keys
_ANGLE_UNIT, _JOINT_UNIT, _RATE_UNIT = "`angle_unit`", "`angle_unit` or m", "`angle_unit`/s or m/s"

LIMITS = (
    Key(
        "position",
        Kind("list of lower and upper limit", _range),
        "none",
        "Range of the joint; null for a joint that turns without end.",
        _JOINT_UNIT,
        nullable=True,
    ),
    Key("velocity", positive(RATE), "none", "Largest speed.", _RATE_UNIT, nullable=True),
    Key(
        "acceleration",
        positive(RATE),
        "none",
        "Largest acceleration.",
        "`angle_unit`/s^2 or m/s^2",
        nullable=True,
    ),
    Key("torque", positive(NUMBER), "none", "Rated torque or force.", "N m or N", nullable=True),
)

JOINT = (
    Key("name", NAME, "`joint_1`, ...", "Name of the joint, also that of its column in logs."),
    Key(
        "type", choice("revolute", "prismatic"), "`revolute`", "Whether the joint turns or slides."
    ),
    Key("a", NUMBER, "0", "DH length along the common normal of two axes.", "m"),
    Key(
        "twist",
        DH_ANGLE,
        "0",
        "DH angle alpha between two axes; the word alpha means the safety factor of the paper.",
        _ANGLE_UNIT,
    ),
    Key("d", NUMBER, "0", "DH offset along the axis; it is added to q for a prismatic joint.", "m"),
    Key(
        "theta_offset",
        DH_ANGLE,
        "0",
        "Revolute joint: theta = q + theta_offset. Prismatic joint: theta itself.",
        _ANGLE_UNIT,
    ),
    Key("limits", mapping(LIMITS, Limits), "none", "Limits of the joint."),
    Key("motor_inertia", FLAG, "`true`", "Keep the column of the rotor inertia Im of this joint."),
    Key(
        "friction",
        list_of(choice(*FRICTION_PARAMETERS)),
        "`[viscous, coulomb, offset]`",
        "Friction columns of this joint.",
    ),
)

BASE = (
    Key("xyz", VECTOR, "`[0, 0, 0]`", "Position of frame 0 in the world.", "m"),
    Key(
        "rpy",
        several(ANGLE_, 3),
        "`[0, 0, 0]`",
        "Roll, pitch and yaw of frame 0 about the fixed axes of the world.",
        _ANGLE_UNIT,
    ),
)

TORQUE = (
    Key("source", choice(*TORQUE_SOURCES), "`unknown`", "What the effort column of a log is."),
    Key(
        "gain",
        Kind(_GAIN.words, _GAIN.read),
        "none",
        "Torque per motor current; null where it is not known.",
        "N m per A",
        nullable=True,
    ),
    Key(
        "relative",
        FLAG,
        "`false`",
        "Whether only the ratios of the gains are known; torques are then counted as "
        "amperes (see [estimators](../explanation/estimators.md)).",
    ),
    Key(
        "noise",
        Kind(_NOISE.words, _noise),
        "0.3 % of the rating, 0.1 N m for a joint without one",
        "Standard deviation of the torque, used to plan motions and to predict errors before anything is measured.",
        "N m or N",
    ),
    Key(
        "gain_error",
        Kind("share", _share),
        "5 % of motor currents, 0 of other sources",
        "Standard deviation of the torque's scale, such as `5%`; a load's mass and inertia are as uncertain.",
    ),
)

UNITS = (
    Key(
        "position",
        choice(*FACTORS["position"]),
        "`rad`",
        "Unit of the positions; m and mm are those of a sliding joint.",
    ),
    Key("velocity", choice(*FACTORS["velocity"]), "`rad/s`", "Unit of the velocities."),
    Key("effort", choice(*FACTORS["effort"]), "`Nm`", "Unit of the torques, forces or currents."),
)

SIMULATOR = (
    Key(
        "sign",
        per_joint(Kind("1 or -1", _sign)),
        "1",
        "Direction of each joint: q_dh = sign * q + offset.",
    ),
    Key(
        "offset",
        per_joint(COORDINATE),
        "0",
        "Offset of each joint: q_dh = sign * q + offset.",
        _JOINT_UNIT,
    ),
)

COLUMNS = (
    Key("time", TEXT, "`t`, `time`, ...", "Name of the column of time stamps."),
    Key(
        "name",
        TEXT,
        "none",
        "Pattern of columns that hold the names of the joints, such as those of `rostopic echo -p`; "
        "their order is then that of the others.",
    ),
    Key(
        "position",
        TEXT,
        "`q_{name}`",
        "Pattern of the columns of positions: `{name}` stands for a name of "
        "`joint_names`, `{i}` for the number of the joint, counted from 0 or 1.",
    ),
    Key("velocity", TEXT, "`qd_{name}`", "Pattern of the columns of velocities."),
    Key(
        "effort",
        TEXT,
        "`tau_{name}` or `i_{name}`",
        "Pattern of the columns of torques or currents.",
    ),
    Key("reference", TEXT, "`q_ref_{name}`", "Pattern of the columns of commanded positions."),
)

DRIVER = (
    Key("kind", choice(*DRIVERS), REQUIRED, "The driver that made the log."),
    Key("topic", TEXT, "that of the driver", "ROS topic of the joint states.", nullable=True),
    Key(
        "joint_names",
        per_joint(TEXT),
        "names of the joints",
        "Names of the log's columns in chain order.",
    ),
    Key(
        "sign",
        SIMULATOR[0].kind,
        "1",
        "Direction of each joint: q_dh = sign * q_log + offset, tau_dh = sign * tau_log.",
    ),
    Key(
        "torque_sign",
        SIMULATOR[0].kind,
        "1",
        "Direction of the torque against that of the position, -1 such as for "
        "torques that the arm feels instead of those it makes: tau_dh = sign * torque_sign * tau_log.",
    ),
    Key(
        "offset",
        SIMULATOR[1].kind,
        "0",
        "Offset of each joint: q_dh = sign * q_log + offset.",
        _JOINT_UNIT,
    ),
    Key(
        "units",
        Kind("mapping", _units, UNITS),
        "rad, rad/s, Nm",
        "Units of the log's columns; those that a log itself declares go before them.",
    ),
    Key(
        "effort_topic",
        TEXT,
        "none",
        "Topic of the torques where they are published apart from the positions: "
        "`sensor_msgs/JointState` or `std_msgs/Float64MultiArray`.",
        nullable=True,
    ),
    Key(
        "columns",
        mapping(COLUMNS, dict),
        "see [logs](log-format.md)",
        "Names of the columns of CSV and TSV files.",
    ),
)

BODY = (
    Key("mass", not_negative(NUMBER, " kg"), REQUIRED, "Mass.", "kg"),
    Key("com", VECTOR, "`[0, 0, 0]`", "Centre of mass in the DH frame of the link.", "m"),
    Key(
        "inertia_com",
        Kind(f"mapping: {', '.join(INERTIA)}", _inertia),
        "0",
        "Inertia about the centre of mass, axes of the DH frame of the link. Before it is fitted, a link without width "
        "(a point, a thin rod) is spread as a cylinder along its DH offset.",
        "kg m^2",
    ),
)

A_BODY = Kind("mapping", _body, BODY)

CYLINDERS = (
    Key("density", positive(NUMBER), "none", "Density of the cylinders; this or `mass`.", "kg/m^3"),
    Key("radius", positive(NUMBER), "0.06", "Radius of the cylinders.", "m"),
    Key("mass", positive(NUMBER), "none", "Mass of all links together; this or `density`.", "kg"),
)

PRIOR = (
    Key(
        "cylinders",
        Kind("mapping", _cylinders, CYLINDERS),
        "none",
        "Uniform cylinders along the DH offsets (Paper Eq. 9); this or `links`.",
    ),
    Key(
        "links",
        Kind("list with one body per link", per_joint(A_BODY).read, BODY),
        "none",
        "Bodies with numbers; this or `cylinders`.",
    ),
)

COUPLING = (
    Key("reduction", per_joint(NUMBER), "1", "Gear ratio of each joint."),
    Key(
        "matrix",
        Kind("n rows of n numbers", _matrix),
        "identity",
        "Motor positions per joint position: q_motor = matrix * q, tau_joint = matrix^T * tau_motor.",
    ),
)

COULOMB = (
    Key(
        "shape",
        choice("smooth", "threshold"),
        "`smooth`",
        "tanh(qd / velocity), or zero below the velocity (Paper Eq. 7).",
    ),
    Key(
        "velocity",
        per_joint(positive(RATE), shared=True),
        REQUIRED,
        "Velocity at which the sign changes.",
        _RATE_UNIT,
    ),
)

EFFECT = (
    Key("effect", TEXT, REQUIRED, "Identifier of the effect, see [effects](effects.md)."),
    Key("joints", Kind("list of joint names", _acting), REQUIRED, "Joints that it acts on."),
    Key("parameters", Kind("name: number", _numbers), "none", "Values of its parameters."),
    Key("std_error", Kind("name: number", _numbers), "none", "Their standard errors."),
    Key("formula", TEXT, "none", "The torque of `effect: formula`, such as `a cos(2 q4) |qd4|`."),
)

KNOWN = (
    Key(
        "total_mass",
        Kind("list of least and greatest mass", _masses),
        "none",
        "Range of the mass of all identified links.",
        "kg",
    ),
    Key(
        "link_mass",
        by_link(Kind("list of least and greatest mass", _masses)),
        "none",
        "Range of the mass of links.",
        "kg",
    ),
    Key(
        "com_box",
        by_link(Kind("lower and upper corner", _box)),
        "none",
        "Box around the centre of mass of links, in their DH frames.",
        "m",
    ),
)

#: Why the joints are read apart: all other keys depend on their number and on which of them are revolute.
ROBOT = (
    Key(
        "name",
        NAME,
        REQUIRED,
        "Name for people; the folder of the results has the name of the file.",
    ),
    Key(
        "convention",
        choice("standard", "modified"),
        REQUIRED,
        "Which DH convention: distal or proximal frames.",
    ),
    Key(
        "angle_unit",
        choice(*ANGLE),
        "`rad`",
        "Unit of plain numbers that are angles; a single angle may say its own: `90 deg`, `pi/2`.",
    ),
    Key(
        "gravity",
        VECTOR,
        "`[0, 0, -9.81]`",
        "Gravity in frame 0, where the DH chain starts.",
        "m/s^2",
    ),
    Key(
        "mount",
        choice("floor", "wall", "ceiling"),
        "`floor`",
        "Where the arm is fixed: `ceiling` turns the default "
        "gravity over; a gravity that points up brings a warning unless this says `wall` or `ceiling`.",
    ),
    Key(
        "base",
        mapping(BASE, dict),
        "zero",
        "Pose of frame 0 in the world, for pictures and URDF; gravity is in frame 0 already.",
    ),
    Key(
        "joints",
        Kind("list of mappings", lambda value, context: context.joints, JOINT),
        REQUIRED,
        "The joints from base to tip, one row of the DH table each.",
    ),
    Key(
        "links",
        Kind("`all` or list of link numbers", _links),
        "`all`",
        "Links to identify; the others keep the values of the prior.",
    ),
    Key(
        "torque",
        Kind("word or mapping", _torque, TORQUE),
        "`unknown`",
        "What the effort column of a log is; a word stands for `source`.",
    ),
    Key(
        "driver",
        Kind("mapping", _driver, DRIVER),
        "none",
        "How the columns of a log become DH quantities.",
    ),
    Key(
        "simulator",
        Kind("mapping", _simulator, SIMULATOR),
        "none",
        "How the joint angles of a simulator become DH quantities.",
    ),
    Key(
        "prior",
        Kind("mapping", read_prior, PRIOR),
        "none",
        "What is known of the links before measuring.",
    ),
    Key("tool", A_BODY, "none", "A body fixed to the last link.", nullable=True),
    Key(
        "known",
        mapping(KNOWN, Known),
        "none",
        "Bounds that the full set keeps (see [consistency](../explanation/consistency.md)).",
    ),
    Key(
        "coupling",
        Kind("mapping", _coupling, COUPLING),
        "none",
        "Gears and coupled joints of motor-side logs.",
        nullable=True,
    ),
    Key(
        "coulomb",
        mapping(COULOMB, lambda velocity, shape="smooth": Coulomb(shape, velocity)),
        "`smooth`, 0.01 rad/s or 1 mm/s until it is estimated from logs",
        "Shape of the sign of Coulomb friction.",
    ),
    Key(
        "effects",
        list_of(mapping(EFFECT, EffectSpec)),
        "none",
        "Torque effects added to the model.",
    ),
)
