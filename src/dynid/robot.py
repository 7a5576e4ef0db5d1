"""The nouns of the robot file: a serial arm as a DH table with limits, friction columns and maps.

All angles are in radians and all lengths in metres here; units and text were dealt with when the file was read.
"""

from __future__ import annotations

import hashlib
import json
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from dynid.answer import Answer, Answered
from dynid.arrays import Floats, Mask
from dynid.errors import Finding, JointCountDiffers, WrongUsage
from dynid.table import Table
from dynid.units import ANGULAR, FACTORS

#: Units of a log whose robot file says none.
USUAL_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "Nm"}

#: The model grows with the square of its joints; arms have up to ten.
MOST_JOINTS = 32

#: The 11 parameters of a link in the order of the paper's Table 5; the link number is appended.
LINK_PARAMETERS = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "Im")
#: Friction columns that a joint may have (Paper Eq. 7) and the prefix of their parameter names.
FRICTION_PARAMETERS = {"viscous": "fv", "coulomb": "fc", "offset": "fo"}


@dataclass(frozen=True)
class Limits:
    """Limits of one joint; ``None`` where the robot file leaves one out.

    Attributes:
        position: lower and upper [rad or m].
        velocity: largest speed [rad/s or m/s].
        acceleration: largest acceleration [rad/s^2 or m/s^2].
        torque: rated torque [N m or N].
    """

    position: tuple[float, float] | None = None
    velocity: float | None = None
    acceleration: float | None = None
    torque: float | None = None


@dataclass(frozen=True)
class Joint:
    """One row of the DH table with what belongs to its joint.

    Attributes:
        name: joint name, as shown everywhere.
        type: ``"revolute"`` or ``"prismatic"``.
        a: DH length [m].
        twist: DH alpha [rad]; ``alpha`` is kept for the paper's safety factor.
        d: DH offset [m]; added to q for a prismatic joint.
        theta_offset: added to q for a revolute joint; theta itself for a prismatic one [rad].
        limits: limits of the joint.
        motor_inertia: whether the column of the rotor inertia Im is kept.
        friction: friction columns beyond the 11 parameters.
    """

    name: str
    type: Literal["revolute", "prismatic"] = "revolute"
    a: float = 0.0
    twist: float = 0.0
    d: float = 0.0
    theta_offset: float = 0.0
    limits: Limits = Limits()
    motor_inertia: bool = True
    friction: tuple[str, ...] = ("viscous", "coulomb", "offset")

    @property
    def revolute(self) -> bool:
        """Whether q turns about the joint axis."""
        return self.type == "revolute"

    @property
    def torque_unit(self) -> str:
        """Unit of the generalised force at this joint."""
        return "N m" if self.revolute else "N"


@dataclass(frozen=True)
class Body:
    """A rigid body in a link frame.

    Attributes:
        mass: [kg].
        com: centre of mass in the link frame, (3,) [m].
        inertia_com: xx, xy, xz, yy, yz, zz about the centre of mass, axes of the link frame [kg m^2].
    """

    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia_com: tuple[float, float, float, float, float, float] = (0.0,) * 6

    @staticmethod
    def of(mass: float, com: Floats, tensor: Floats) -> Body:
        """Return the body with a mass [kg], a centre (3,) [m] and an inertia about it (3, 3) [kg m^2]."""
        x, y, z = com.tolist()
        xx, xy, xz, yy, yz, zz = tensor[np.triu_indices(3)].tolist()
        return Body(mass, (x, y, z), (xx, xy, xz, yy, yz, zz))

    @property
    def tensor(self) -> Floats:
        """Inertia about the centre of mass as a matrix, (3, 3) [kg m^2]."""
        xx, xy, xz, yy, yz, zz = self.inertia_com
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def numbers(self) -> Floats:
        """Mass, centre of mass and inertia about it, (10,) [kg, m, kg m^2]."""
        return np.array([self.mass, *self.com, *self.inertia_com])

    def parameters(self) -> Floats:
        """Return m, mc, I about the frame origin: the first ten of Table 5, (10,)."""
        c = np.array(self.com)
        about_origin = self.tensor + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return np.concatenate([[self.mass], self.mass * c, about_origin[np.triu_indices(3)]])


@dataclass(frozen=True)
class Cylinders:
    """Uniform cylinders along the DH offsets (Paper Eq. 9).

    Attributes:
        radius: cylinder radius [m].
        density: [kg/m^3], or None when ``mass`` is given.
        mass: total mass of the links that the density is scaled to [kg].
    """

    radius: float = 0.06
    density: float | None = None
    mass: float | None = None


@dataclass(frozen=True)
class Prior:
    """What is known before measuring: uniform cylinders, or one body per link."""

    cylinders: Cylinders | None = None
    links: tuple[Body, ...] = ()


@dataclass(frozen=True)
class Known:
    """Bounds that hold for the arm besides what is measured.

    Attributes:
        total_mass: smallest and largest mass of all identified links [kg].
        link_mass: the same of single links, with the link's number [kg].
        com_box: lower and upper corner of the box around a link's centre of mass in its DH frame [m], with its number.
    """

    total_mass: tuple[float, float] | None = None
    link_mass: tuple[tuple[int, tuple[float, float]], ...] = ()
    com_box: tuple[
        tuple[int, tuple[tuple[float, float, float], tuple[float, float, float]]], ...
    ] = ()


@dataclass(frozen=True)
class JointMap:
    """How another program's joint values become DH values: q_dh = sign * q + offset, tau_dh = sign * torque_sign * tau.

    Attributes:
        sign: direction of each joint.
        offset: offset of each joint [rad or m].
        torque_sign: direction of each joint's torque against that of its position; () where they agree.
    """

    sign: tuple[float, ...]
    offset: tuple[float, ...]
    torque_sign: tuple[float, ...] = ()

    @property
    def torque_signs(self) -> tuple[float, ...]:
        """Direction of each joint's torque against that of its position."""
        return self.torque_sign or (1.0,) * len(self.sign)


@dataclass(frozen=True)
class DriverSpec:
    """Where a log comes from and how its columns become DH quantities.

    Attributes:
        kind: ``"kinova_gen2"``, ``"lwr4plus"`` or ``"generic"``.
        topic: topic of the joint states, None for the driver's default.
        joint_names: names of the log's columns in chain order, () for the robot's own joint names.
        map: signs and offsets, in SI units.
        units: unit of ``position``, ``velocity`` and ``effort`` in the log.
        columns: patterns of column names in tables, by ``time``, ``name``, ``position``, ``velocity``, ``effort``,
            ``reference``.
    """

    kind: str
    map: JointMap
    topic: str | None = None
    joint_names: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=USUAL_UNITS.copy)
    columns: dict[str, str] = field(default_factory=dict)


#: Gains of data sheets are 5 to 10 % off: what is assumed of motor currents.
CURRENT_GAIN_ERROR = 0.05


@dataclass(frozen=True)
class TorqueSource:
    """What the effort column is.

    Attributes:
        source: ``"joint_sensor"``, ``"motor_torque"``, ``"motor_current"``, ``"gravity_free"`` or ``"unknown"``,
            where the robot file does not say: worked with as torques of the joints.
        gain: N m per A of each joint; None where unknown.
        relative: whether only the ratios of the gains are known; torques are then counted as amperes.
        noise: standard deviation of each joint's torque [N m or N]; None where it is not known.
        gain_error: standard deviation of the torque's scale, as a share; None for the default of the source.
    """

    source: str = "unknown"
    gain: tuple[float | None, ...] | None = None
    relative: bool = False
    noise: tuple[float, ...] | None = None
    gain_error: float | None = None

    @property
    def scale_error(self) -> float:
        """Return the standard deviation of the torque's scale as a share, 5 % of motor currents where none is given."""
        if self.gain_error is not None:
            return self.gain_error
        return CURRENT_GAIN_ERROR if self.source == "motor_current" else 0.0

    @property
    def complete(self) -> bool:
        """Whether the gain of every joint is known."""
        return self.gain is not None and all(value is not None for value in self.gain)


@dataclass(frozen=True)
class Coulomb:
    """Shape of the Coulomb friction's sign.

    Attributes:
        shape: ``"smooth"``, tanh(qd / velocity), or ``"threshold"``, the paper's Eq. 7: zero below the velocity.
        velocity: velocity of each joint [rad/s or m/s].
        interval: 95 % interval of each velocity where they were estimated from logs; none where a file says them.
        distance: motion of each joint over which friction follows its sign (Dahl) where it was estimated [rad or m].
    """

    shape: str
    velocity: tuple[float, ...]
    interval: tuple[tuple[float, float], ...] = ()
    distance: tuple[float, ...] = ()

    def facts(self) -> dict[str, Any]:
        """Return what is known of it, as files have it."""
        return {key: value for key, value in asdict(self).items() if value}


@dataclass(frozen=True)
class Coupling:
    """Motor-side logs with coupled joints: q_motor = matrix @ q, tau_joint = matrix.T @ tau_motor.

    Attributes:
        matrix: reductions and coupling in one, (n, n) rows.
    """

    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class EffectSpec:
    """A torque effect that was added to the model.

    Attributes:
        effect: identifier of the catalogue.
        joints: names of the joints it acts on.
        parameters: values by name.
        std_error: standard errors by name.
        formula: the torque of ``effect: formula``.
    """

    effect: str
    joints: tuple[str, ...]
    parameters: dict[str, float] = field(default_factory=dict)
    std_error: dict[str, float] = field(default_factory=dict)
    formula: str | None = None

    def facts(self) -> dict[str, Any]:
        """Return its entry of a robot file."""
        return {key: value for key, value in asdict(self).items() if value is not None}


@dataclass(frozen=True, repr=False)
class Robot(Answered):
    """One serial arm.

    Attributes:
        name: name for people.
        convention: ``"standard"`` (distal) or ``"modified"`` (proximal, Craig/Khalil).
        joints: base to tip.
        gravity: in frame 0, (3,) [m/s^2].
        base_xyz: position of frame 0 in the world [m].
        base_rpy: roll, pitch, yaw of frame 0 in the world [rad].
        links: numbers of the links to identify, 1-based; the others keep the prior's values.
        path: file it was read from, None when made in code or from a URDF.
        source: what a person types for it: name or path; None when made in code.
        known: bounds on masses and centres of mass.
        findings: what was noticed while reading.
    """

    name: str
    convention: Literal["standard", "modified"]
    joints: tuple[Joint, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    base_xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    base_rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    links: tuple[int, ...] = ()
    torque: TorqueSource = TorqueSource()
    driver: DriverSpec | None = None
    simulator: JointMap | None = None
    prior: Prior | None = None
    tool: Body | None = None
    coupling: Coupling | None = None
    coulomb: Coulomb | None = None
    estimated_coulomb: Coulomb | None = field(default=None, compare=False)
    effects: tuple[EffectSpec, ...] = ()
    known: Known = Known()
    path: Path | None = field(default=None, compare=False)
    source: str | None = field(default=None, compare=False)
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joint names, base to tip."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def turning(self) -> Mask:
        """Which joints turn, (n,)."""
        return np.array([joint.revolute for joint in self.joints])

    @property
    def world_gravity(self) -> Floats:
        """Gravity in the world frame, (3,) [m/s^2]."""
        return rotation_rpy(self.base_rpy) @ np.array(self.gravity)

    def travel(self, turning: tuple[float, float], sliding: tuple[float, float]) -> Floats:
        """Return the least and the greatest positions, (2, n); given ones at joints without limits [rad or m]."""
        free = np.where(self.turning[:, None], turning, sliding).tolist()
        ranges = [
            joint.limits.position or own for joint, own in zip(self.joints, free, strict=True)
        ]
        return np.array(ranges, dtype=float).T

    def limits(self, quantity: str, missing: ArrayLike = np.inf) -> Floats:
        """Return the limits of velocity, acceleration or torque, (n,); ``missing`` at joints without one."""
        given = np.array([getattr(joint.limits, quantity) or np.nan for joint in self.joints])
        return np.where(np.isnan(given), missing, given)

    def unit_factors(self, units: Mapping[str, str]) -> dict[str, Floats]:
        """Return the factors from units by quantity to SI units, (n,) each.

        Why: one unit is given for all joints; `deg` says nothing about a sliding joint, which is then in metres.
        """
        return {
            quantity: np.where(
                (self.turning == (units[quantity] in ANGULAR)) | (quantity == "effort"),
                factors[units[quantity]],
                1.0,
            )
            for quantity, factors in FACTORS.items()
        }

    @property
    def shown_gains(self) -> tuple[float, ...]:
        """What a torque of each joint is divided by to be shown: its gain where torques are amperes, else 1, (n,)."""
        gains = self.torque.gain if self.torque.relative else None
        return tuple(gain or 1.0 for gain in gains or (1.0,) * self.n)

    def require_joints(self, names: Sequence[str], where: Path | str) -> None:
        """Raise when a file is of another arm.

        Args:
            names: its joints.
            where: the file.

        Raises:
            JointCountDiffers: the arm has other joints.
        """
        if tuple(names) != self.joint_names:
            given, expected = ", ".join(names), ", ".join(self.joint_names)
            raise JointCountDiffers(
                f"{where} has the joints {given}, the robot {expected}", where=where
            )

    def joint_name(self, joint: int | str) -> str:
        """Return the name of a joint given by its number from 1 or by its name.

        Raises:
            WrongUsage: there is no such joint.
        """
        names = self.joint_names
        if joint in names:
            return str(joint)
        if not isinstance(joint, int) or not 1 <= joint <= self.n:
            raise WrongUsage(
                f"there is no joint '{joint}'", fix=f"a number from 1 to {self.n}, or a name"
            )
        return names[joint - 1]

    @property
    def columns(self) -> DriverSpec:
        """How the columns of a log become DH quantities: the file's driver, else columns that are DH quantities."""
        return self.driver or DriverSpec("generic", JointMap((1.0,) * self.n, (0.0,) * self.n))

    @property
    def log_names(self) -> tuple[str, ...]:
        """Names of a log's columns in chain order."""
        return self.columns.joint_names or self.joint_names

    @property
    def slug(self) -> str:
        """Name of the folder that its results go to."""
        if self.path is not None:
            return self.path.stem
        if self.source is not None:
            return Path(self.source.partition("#")[0]).stem
        return "".join(c if c.isalnum() else "_" for c in self.name.lower()).strip("_")

    @property
    def word(self) -> str:
        """What a person types for it on a command line, quoted for a shell."""
        return shlex.quote(self.source or (self.slug if self.path is None else str(self.path)))

    @property
    def editable(self) -> str:
        """The file, in words, into which a person writes a further line of the robot file."""
        return str(self.path or "the robot file")

    @property
    def identified_links(self) -> tuple[int, ...]:
        """Numbers of the links to identify, 1-based."""
        return self.links or tuple(range(1, self.n + 1))

    @property
    def coulomb_shape(self) -> Coulomb:
        """Shape of the Coulomb sign: the file's, what logs say, or smooth within 0.01 rad/s (1 mm/s if sliding)."""
        return self.coulomb or self.estimated_coulomb or self.usual_coulomb

    @property
    def usual_coulomb(self) -> Coulomb:
        """Shape of the Coulomb sign of an arm of which no more is known."""
        return Coulomb("smooth", tuple(0.01 if joint.revolute else 1e-3 for joint in self.joints))

    def answer(self) -> Answer:
        """Return the DH table with the limits, one row per joint; angles in degrees."""
        rows = []
        for joint in self.joints:
            shown, limits = math.degrees if joint.revolute else float, joint.limits
            lower, upper = limits.position or (math.nan, math.nan)
            row = {
                "joint": joint.name,
                "type": joint.type,
                "a [m]": joint.a,
                "twist [deg]": math.degrees(joint.twist),
                "d [m]": joint.d,
                "theta offset [deg]": math.degrees(joint.theta_offset),
                "from [deg or m]": shown(lower),
                "to [deg or m]": shown(upper),
                "speed [deg/s or m/s]": shown(limits.velocity or math.nan),
                "torque [N m or N]": limits.torque,
            }
            rows.append(row)
        gravity = ", ".join(f"{g:g}" for g in self.gravity)
        what = f"{self.name}: {self.convention} DH, gravity ({gravity}) m/s^2 in frame 0"
        return Answer({"robot": self.name}, what, (Table(rows),))

    @cached_property
    def model_key(self) -> str:
        """Hash of everything the symbolic model depends on: geometry, gravity, columns; 16 hex digits."""
        coulomb = self.coulomb or self.usual_coulomb
        facts: dict[str, Any] = {
            "convention": self.convention,
            "gravity": self.gravity,
            "links": self.identified_links,
            "coupling": asdict(self.coupling) if self.coupling else None,
            "coulomb": {"shape": coulomb.shape, "velocity": coulomb.velocity},
            "effects": [effect.facts() for effect in self.effects],
            "joints": [
                (j.type, j.a, j.twist, j.d, j.theta_offset, j.motor_inertia, j.friction)
                for j in self.joints
            ],
        }
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]


def rotation_rpy(rpy: tuple[float, float, float]) -> Floats:
    """Return the rotation of fixed-axis roll, pitch, yaw as in a URDF, (3, 3)."""
    R = np.eye(3)
    for axis, angle in enumerate(rpy):
        turn, j, k = np.eye(3), (axis + 1) % 3, (axis + 2) % 3
        turn[j, j] = turn[k, k] = math.cos(angle)
        turn[k, j] = math.sin(angle)
        turn[j, k] = -turn[k, j]
        R = turn @ R
    return R


def roll_pitch_yaw(R: Floats) -> tuple[float, float, float]:
    """Return fixed-axis roll, pitch, yaw of a rotation matrix [rad], exact to rounding at a pitch of 90 degrees too."""
    yaw = math.atan2(R[1, 0], R[0, 0])
    # Why: with the yaw taken off first, whatever it came out as near 90 degrees, the other two are well determined.
    rest = rotation_rpy((0.0, 0.0, -yaw)) @ R
    return math.atan2(-rest[1, 2], rest[1, 1]), math.atan2(-rest[2, 0], rest[0, 0]), yaw
