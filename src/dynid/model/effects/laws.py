"""The laws behind the catalogue: columns of the effects whose torque is more than a line, and their shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.arrays import Floats
from dynid.model import tuning
from dynid.model.effects.motion import ArmMotion, Joints, Shape, Shapes
from dynid.robot import LINK_PARAMETERS

#: Smallest step of a difference: of an angle [rad], and of a compliance [rad/N m], a hundredth of the softest gear.
ANGLE_STEP, COMPLIANCE_STEP = 1e-5, 1e-6


# ---------------------------------------------------------------- friction
def presliding(q: Floats, delta: float) -> Floats:
    """Return the bristle's state over a motion, exact in the position, (N,).

    Between reversals z = sigma + (z0 - sigma) exp(-|q - q0| / delta); it starts slack at 0.
    """
    step = np.diff(q, prepend=q[:1])
    direction = np.sign(step)
    turns = np.flatnonzero(np.diff(direction) != 0) + 1
    z = np.zeros_like(q)
    last, origin = 0.0, q[0]
    for run in np.split(np.arange(len(q)), turns):
        sigma = direction[run[0]]
        z[run] = (
            sigma + (last - sigma) * np.exp(-np.abs(q[run] - origin) / delta) if sigma else last
        )
        last, origin = z[run[-1]], q[run[-1]]
    return z


# ---------------------------------------------------------------- position
def wave_shapes(motion: ArmMotion, joint: int, highest: float = tuning.FASTEST_WAVE) -> Shapes:
    """Return the frequencies of waves over one joint's position that its range separates.

    Args:
        motion: the motion.
        joint: 0-based joint.
        highest: fastest wave [1/rad].
    """
    travel = float(np.ptp(motion.q[:, joint]))
    if travel < tuning.STILL_JOINT_RAD:
        return []
    first, step = tuning.SLOWEST_WAVE_PHASE_RAD / travel, tuning.WAVE_SPACING_RAD / travel
    return [{"k": k} for k in np.arange(first, highest, step).tolist()]


def spring_forms(shape: Shape) -> tuple[str, ...]:
    """Return powers of the position, and a constant."""
    powers = (f"q^{i}" for i in range(1, round(shape["order"]) + 1))
    return (*powers, *["1"] * bool(shape["constant"]))


def spring_units(shape: Shape) -> dict[str, str]:
    """Return names and units of a spring's amplitudes."""
    powers = range(1, round(shape["order"]) + 1)
    units = {f"k{i}": f"N m/rad^{i}" if i > 1 else "N m/rad" for i in powers}
    return units | ({"c": "N m"} if shape["constant"] else {})


def spring_shapes(motion: ArmMotion, joint: int) -> Shapes:
    """Return the orders that are tried; the constant only where the joint has no offset of its own."""
    constant = 0.0 if "offset" in motion.robot.joints[joint].friction else 1.0
    return [{"order": order, "constant": constant} for order in (1.0, 3.0)]


def end_shapes(motion: ArmMotion, joint: int) -> Shapes:
    """Return sides and places of an end stop that are tried."""
    points = np.quantile(motion.q[:, joint], np.linspace(0.15, 0.85, 9))
    return [{"side": side, "q1": float(q1)} for side in (-1.0, 1.0) for q1 in points]


def step_times(motion: ArmMotion, joint: int) -> Shapes:
    """Return the times of a step that are tried."""
    times = np.quantile(motion.t, np.linspace(0.03, 0.97, 40))
    return [{"since": float(t)} for t in times]


# ---------------------------------------------------------------- the arm
def encoder_offset(motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
    """Return the change of torque by an encoder's zero, per radian."""
    step = shape["at"] if abs(shape["at"]) > ANGLE_STEP else ANGLE_STEP
    moved = motion.q.copy()
    moved[:, joints[0]] -= step
    there = motion.reference.rigid(moved, motion.qd, motion.qdd)
    return ((there - motion.rigid) / step).T[None]


def elasticity(motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
    """Return the change of torque by a gear that bends under it, per unit of compliance."""
    exact = shape["at"] > COMPLIANCE_STEP
    step = shape["at"] if exact else COMPLIANCE_STEP
    there = motion.rigid
    for _ in range(1 + tuning.BEND_ITERATIONS * exact):
        bend = motion.smooth(there[:, joints[0]])
        speed = np.gradient(bend, motion.t)
        state = [x.copy() for x in (motion.q, motion.qd, motion.qdd)]
        for x, shift in zip(state, (bend, speed, np.gradient(speed, motion.t)), strict=True):
            x[:, joints[0]] -= step * shift
        there = motion.reference.rigid(*state)
    return ((there - motion.rigid) / step).T[None]


def backlashes(motion: ArmMotion, joints: Joints, shapes: Sequence[Shape]) -> list[Floats]:
    """Return the torque that a link lacks and lands with, for several gaps."""
    j, pushed = joints[0], motion.qdd.copy()
    pushed[:, j] += 1.0
    inertia = motion.reference.rigid(motion.q, motion.qd, pushed) - motion.rigid
    own = inertia[:, j]
    push = np.where(own > 0, motion.rigid[:, j] / np.where(own > 0, own, 1.0), 0.0)
    gaps = [2 * shape["b"] for shape in shapes]
    return [(inertia.T * one)[None] for one in crossings(motion.t, push, gaps)]


def crossings(t: Floats, push: Floats, gaps: Sequence[float]) -> list[Floats]:
    """Return the acceleration that a link has relative to its motor while it crosses a gap, (N,) each [rad/s^2].

    A link that is held by one flank is left alone when its load changes the sign, falls behind by as much as the load
    would accelerate it, and is caught by the other flank without a bounce.

    Args:
        t: times, (N,) [s].
        push: the load over the inertia that it accelerates, (N,) [rad/s^2].
        gaps: widths, G of them [rad].
    """
    turns = np.flatnonzero(np.diff(np.sign(push)) != 0) + 1
    step = np.diff(t, append=2 * t[-1] - t[-2])
    flight = tuning.LONGEST_FLIGHT_SAMPLES
    rows = turns[:, None] + np.arange(flight)
    inside = np.minimum(rows, len(push) - 1)
    lasts = np.where(rows < len(push), step[inside], 0.0)
    speed = np.cumsum(push[inside] * lasts, axis=1)
    way = np.maximum.accumulate(np.abs(np.cumsum(speed * lasts, axis=1)), axis=1)
    jolts = []
    for gap in gaps:
        lands = np.sum(way < gap, axis=1)
        fast = np.take_along_axis(speed, np.minimum(lands, flight - 1)[:, None], axis=1)[:, 0]
        jolt, end = np.zeros_like(push), 0
        for k, land, landing in zip(turns.tolist(), lands.tolist(), fast.tolist(), strict=True):
            if k >= end and land < min(flight, len(push) - k):
                end = k + land
                jolt[k:end] = -push[k:end]
                jolt[end] = landing / step[end] - push[end]
        jolts.append(jolt)
    return jolts


def base_tilt(motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
    """Return the torques of gravity turned towards two level axes, and the weight that the first joint then feels."""
    columns = np.zeros((4, motion.n, len(motion)))
    down = np.array(motion.robot.gravity) / np.linalg.norm(motion.robot.gravity)
    # Why these: on a wall one of the first two axes points down, and a turn towards it is none.
    for k, axis in enumerate(np.sort(np.argsort(np.abs(down), kind="stable")[:2])):
        level = np.eye(3)[axis] - down[axis] * down
        columns[k] = motion.reference.gravity_tilt(motion.q, level).T
    columns[2, 0], columns[3, 0] = np.cos(motion.q[:, 0]), np.sin(motion.q[:, 0])
    return columns


def payload(motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
    """Return the columns of a body on the last link."""
    columns = motion.reference.tip_columns(motion.q, motion.qd, motion.qdd)
    return columns[: round(shape["form"])].transpose(0, 2, 1)


def payload_units(shape: Shape) -> dict[str, str]:
    """Return names and units of the first parameters of a body."""
    units = ("kg", *("kg m",) * 3, *("kg m^2",) * 6)
    return dict(zip(LINK_PARAMETERS[: round(shape["form"])], units, strict=False))
