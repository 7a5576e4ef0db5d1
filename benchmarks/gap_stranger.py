"""Cases for ``dynid gap`` from physics alone: arms, motions, recorders and hidden things that share nothing with it.

    python benchmarks/gap_stranger.py --seeds 101-103 --cases 0-59 [--only single] [--out lines.jsonl] [--table FILE.md]

Pinocchio computes all torques. An arm of 3 to 7 random bodies follows a motion under a controller; its torque is rigid
bodies, rotors, viscous and Coulomb friction, and what is hidden. A recorder adds coloured and quantised noise. Each
case is a folder as a user would have it (robot file, logs) with ``truth.json``. *Visible size*: what least squares with
the true rigid body, rotor and friction columns leave of the hidden thing in data without noise, over the noise below
10 Hz, on the joint that shows it most. Sets: clean, single, double, outside (nothing of the catalogue), changed (the
model comes from logs before the change). Seeds 1 to 19 are for development, 100 and above for proof. Finished cases are
kept as JSON lines by commit, seed and case.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy import signal
from scipy.interpolate import CubicSpline, make_interp_spline

#: One cycle of 15 cases; four cycles are a seed.
CYCLE = (
    "single",
    "clean",
    "stribeck",
    "changed",
    "double",
    "single",
    "outside",
    "clean",
    "single",
    "changed",
    "stribeck",
    "single",
    "clean",
    "double",
    "outside",
)
STEP, BAND, THIN = (
    0.001,
    10.0,
    40,
)  # s of the fine grid; Hz below which sizes count; fine samples per row of least squares
#: Law of the catalogue, and the name of its amplitude where that is the size that is drawn.
CATALOGUED = {
    "torque_offset": "c",
    "viscous": "fv",
    "coulomb": "fc",
    "motor_inertia": "Im",
    "asymmetric_viscous": "a",
    "nonlinear_viscous": "a",
    "load_friction": "a",
    "torque_gain": "",
    "torque_constant": "c",
    "warmup_friction": "",
    "torque_drift": "a",
    "position_friction": "",
    "gear_friction": "",
    "torque_ripple": "",
    "spring": "",
    "end_stop": "a",
    "joint_coupling": "",
    "torque_crosstalk": "a",
    "joint_elasticity": "compliance",
    "backlash": "",
    "encoder_offset": "offset",
    "presliding_hysteresis": "a",
    "base_tilt": "",
    "torque_delay": "delay",
    "tool_force": "",
}
#: The same of what is not drawn from the catalogue.
OTHERS = {"stribeck": "a", "payload": "m", "coulomb_change": "c", "viscous_change": "v"}
#: What the catalogue lacks, with its size to begin with where that is one number.
OUTSIDE = (
    "ringing",
    "dead_band",
    "snag",
    "push",
    "coarse",
    "saturation",
    "gravity_part",
    "wander",
    "odd_product",
)
BEGIN = {
    "load_friction": 0.03,
    "gravity_part": 0.03,
    "backlash": 0.002,
    "torque_delay": 0.002,
    "tool_force": 2.0,
    "payload": 0.5,
    "push": 5.0,
    "coarse": 0.5,
    "saturation": 0.1,
}
CHANGES = (
    "payload",
    "coulomb_change",
    "viscous_change",
    "torque_offset",
    "torque_gain",
    "base_tilt",
    "tool_force",
    "encoder_offset",
    "stribeck",
    "spring",
    "load_friction",
    "torque_ripple",
    "torque_crosstalk",
    "nothing",
    "nothing",
)
WHOLE = ("base_tilt", "torque_delay", "tool_force", "payload", "gravity_part", "push")
LEFT_OUT = {"torque_offset": "offset", "viscous": "viscous", "coulomb": "coulomb"}
PHASED = ("position_friction", "gear_friction", "torque_ripple")
ONE_CLOCK = ("warmup_friction", "torque_drift")
#: Largest plausible amplitude of laws whose amplitude has a scale of its own.
LARGEST = {
    "torque_gain": 0.4,
    "torque_constant": 0.4,
    "encoder_offset": 0.2,
    "base_tilt": 0.15,
    "torque_delay": 0.03,
    "backlash": 0.02,
    "joint_elasticity": 0.05,
    "load_friction": 0.4,
    "torque_crosstalk": 0.4,
    "gravity_part": 0.5,
    "saturation": 0.6,
}


@dataclass
class Arm:
    """A serial arm with random bodies, in Pinocchio; friction and rotors stand beside."""

    rows: np.ndarray  # (n, 4) a, alpha, d, theta offset
    convention: str
    gravity: np.ndarray
    model: pin.Model
    tip: int
    rotors: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    offset: np.ndarray
    width: np.ndarray  # rad/s of a reversal
    speed: np.ndarray
    travel: np.ndarray
    torque: np.ndarray
    data: object = field(default=None)

    @property
    def n(self):
        return len(self.rows)


@dataclass
class States:
    """Motion of the links on the fine grid; ``t`` is the clock of the session."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


@dataclass
class Hidden:
    """One hidden thing: law, joint, amplitude, shape."""

    name: str
    joint: int
    size: float
    shape: dict
    visible: float = 0.0


def spread(rng, low_, high, *size):
    """Draw evenly in the logarithm."""
    return np.exp(rng.uniform(np.log(low_), np.log(high), *size))


def direction(rng):
    """Draw a unit vector."""
    vector = rng.normal(size=3)
    return (vector / np.linalg.norm(vector)).tolist()


def slopes(x, step=STEP):
    """Return the first and the second differences of signals over time."""
    first = np.gradient(x, step, axis=0)
    return first, np.gradient(first, step, axis=0)


# --- the arm --------------------------------------------------------------------------------------


def draw_arm(rng):
    """Return a random arm with bodies plausible for its size."""
    n, reach = int(rng.integers(3, 8)), rng.uniform(0.6, 1.6)
    standard = rng.random() < 0.5
    twists, parallel = [], 0
    for _ in range(n):
        flat = parallel < 1 and rng.random() < 0.3
        parallel = parallel + 1 if flat else 0
        twists.append(0.0 if flat else rng.choice([-1, 1]) * np.pi / 2)
    if rng.random() < 0.2:
        twists[int(rng.integers(n))] = rng.choice([-1, 1]) * np.deg2rad(
            rng.choice([30, 40, 55, 60])
        )
    share = rng.uniform(0.5, 1.5, n) * np.linspace(1.3, 0.5, n)
    length = reach * share / share.sum()
    along_x = rng.random(n) < 0.5
    a = np.where(along_x, length, rng.choice([0, 0.03, 0.06], n) * (rng.random(n) < 0.4))
    d = np.where(along_x, rng.choice([0, 0.1, -0.08], n) * (rng.random(n) < 0.5), length)
    rows = np.round(
        np.column_stack([a, twists, d, rng.choice([0, 0, 0, np.pi / 2, -np.pi / 2], n)]), 12
    )
    rows[:, [0, 2]] = np.round(rows[:, [0, 2]], 3)
    mount = rng.choice(["floor", "floor", "floor", "floor", "wall", "ceiling"])
    gravity = {"floor": [0, 0, -9.81], "ceiling": [0, 0, 9.81], "wall": [9.81, 0, 0]}[mount]
    mass = rng.uniform(6, 45) * reach**1.5
    weights = share * np.linspace(1.6, 0.4, n) * rng.uniform(0.7, 1.3, n)
    model, parent, put = pin.Model(), 0, pin.SE3.Identity()
    model.gravity.linear = np.array(gravity, float)
    for i in range(n):
        ai, twist, di, _ = rows[i]
        if not standard:  # a and twist belong to the axis before
            put = pin.SE3(pin.utils.rotate("x", twist), np.array([ai, 0, 0])) * pin.SE3(
                np.eye(3), np.array([0, 0, di])
            )
        parent = model.addJoint(parent, pin.JointModelRZ(), put, f"j{i + 1}")
        if standard:
            put = pin.SE3(pin.utils.rotate("x", twist), np.array([ai, 0, di]))
            reachto = np.array([ai, 0, di])
        else:
            after = rows[i + 1] if i + 1 < n else np.array([0, 0, length[i] / 2, 0])
            reachto = np.array([after[0], 0, after[2]])
        centre = rng.uniform(0.2, 0.7) * reachto + rng.normal(0, 0.02 * reach, 3)
        m = mass * weights[i] / weights.sum()
        sides = np.array([max(np.linalg.norm(reachto), 0.08), *rng.uniform(0.05, 0.12, 2) * reach])
        box = m / 12 * (np.sum(sides**2) - sides**2)
        axes = pin.rpy.rpyToMatrix(*rng.uniform(-np.pi, np.pi, 3))
        model.appendBodyToJoint(
            parent, pin.Inertia(m, centre, axes @ np.diag(box) @ axes.T), pin.SE3.Identity()
        )
    end = put if standard else pin.SE3.Identity()
    tip = model.addFrame(pin.Frame("tip", parent, 0, end, pin.FrameType.OP_FRAME))
    arm = Arm(
        rows,
        "standard" if standard else "modified",
        np.array(gravity, float),
        model,
        tip,
        *np.zeros((5, n)),
        rng.uniform(0.8, 2.8, n),
        rng.uniform(0.7, 2.2, n),
        np.zeros(n),
        model.createData(),
    )
    arm.mount = str(mount)
    poses = rng.uniform(-1, 1, (200, n)) * arm.travel
    moved = arm.speed * rng.uniform(-1, 1, (200, n))
    rigid = np.array(
        [pin.rnea(model, arm.data, q, v, 3 * v) for q, v in zip(poses, moved, strict=True)]
    )
    inertia = np.mean([np.diag(pin.crba(model, arm.data, q)) for q in poses], axis=0)
    arm.rotors = inertia * rng.uniform(0.05, 0.5, n)
    load = np.sqrt(np.mean(rigid**2, axis=0)) + 0.02 * np.sqrt(np.mean(rigid**2))
    arm.coulomb = load * rng.uniform(0.01, 0.06, n)
    arm.viscous = load * rng.uniform(0.02, 0.1, n) / arm.speed
    arm.offset = rng.normal(0, 0.01, n) * load
    arm.width = spread(rng, 0.0015, 0.008, n)
    arm.torque = 3 * load + np.max(np.abs(rigid), axis=0)
    return arm


def rigid_torque(arm, q, v, a, model=None):
    """Return the torques of the bodies alone, (N, n) [N m]."""
    model = model or arm.model
    turned, data = q + arm.rows[:, 3], model.createData()
    return np.array([pin.rnea(model, data, *row) for row in zip(turned, v, a, strict=True)])


def friction(arm, v):
    """Return viscous and Coulomb friction with their offset, (N, n) [N m]."""
    return arm.viscous * v + arm.coulomb * np.tanh(v / arm.width) + arm.offset


# --- the motion -----------------------------------------------------------------------------------


def draw_reference(rng, arm, kind, seconds):
    """Return the commanded motion on the fine grid, (N, n) [rad], inside travel and speed of the arm."""
    t, n = np.arange(0, seconds, STEP), arm.n
    q = np.zeros((len(t), n))
    for j in range(n):
        if kind == "harmonics":
            base, most = rng.uniform(0.05, 0.15), int(rng.integers(3, 7))
            for h in range(1, most + 1):
                q[:, j] += (
                    rng.normal()
                    / h**0.7
                    * np.sin(2 * np.pi * base * h * t + rng.uniform(0, 2 * np.pi))
                )
        elif kind == "chirp":
            low, high = rng.uniform(0.03, 0.1), rng.uniform(0.4, 1.0)
            phase = 2 * np.pi * (low * t + (high - low) * t**2 / 2 / seconds)
            q[:, j] = np.sin(phase + rng.uniform(0, 6)) / (1 + 2 * t / seconds)
            q[:, j] += 0.5 * np.sin(2 * np.pi * rng.uniform(0.05, 0.2) * t)
        elif kind == "sweeps":
            period = rng.uniform(5, 14)
            q[:, j] = signal.sawtooth(2 * np.pi * (t / period + rng.random()), 0.5) + 0.3 * np.sin(
                2 * np.pi * rng.uniform(0.2, 0.6) * t
            )
        else:  # moves from pose to pose with pauses
            knots, at, value = [0.0], [rng.uniform(-1, 1)], 0.0
            while knots[-1] < seconds:
                value = rng.uniform(-1, 1)
                knots += [knots[-1] + rng.uniform(0.7, 2.5)]
                at += [value]
                knots += [knots[-1] + rng.uniform(0.05, 0.5)]
                at += [value]
            k = np.clip(np.searchsorted(knots, t, "right") - 1, 0, len(knots) - 2)
            s = (t - np.array(knots)[k]) / np.diff(knots)[k]
            q[:, j] = np.array(at)[k] + np.diff(at)[k] * s**3 * (10 - 15 * s + 6 * s**2)
    soft = signal.butter(2, 3.0, fs=1 / STEP, output="sos")
    q = signal.sosfiltfilt(soft, q - q.mean(0), axis=0)
    q *= rng.uniform(0.5, 1.0, n) * arm.travel / np.abs(q).max(0)
    speed, accel = (np.abs(each).max(0) for each in slopes(q))
    fast, hard = speed / (arm.speed * rng.uniform(0.4, 1.0, n)), accel / 12.0
    q /= np.maximum(1, np.maximum(fast, hard))
    return q + rng.uniform(-0.3, 0.3, n) * arm.travel


def smooth_states(q, step, t0=0.0):
    """Return positions of a coarse grid as States on the fine one: a quintic spline, so that all derivatives agree."""
    t = np.arange(len(q)) * step
    spline = make_interp_spline(t, q, k=5)
    fine = np.arange(round((t[-1] + 1e-9) / STEP) + 1) * STEP
    fine = fine[fine <= t[-1]]
    return States(t0 + fine, spline(fine), spline(fine, 1), spline(fine, 2))


def drive(arm, reference, rng, pull):
    """Let the arm follow a motion under its controller: integrate it forward, linearly implicit, and return positions.

    Args:
        pull: torques of hidden things along the reference, (N, n) [N m].
    """
    every = 2
    step, ref = every * STEP, reference[::every]
    speed, accel = slopes(ref, step)
    ahead = rng.uniform(0.8, 1.0) * rigid_torque(arm, ref, speed, accel)
    mass = (
        np.mean([np.diag(pin.crba(arm.model, arm.data, q)) for q in ref[::500] + arm.rows[:, 3]], 0)
        + arm.rotors
    )
    omega = 2 * np.pi * arm.stiff
    kp, kd = mass * omega**2, 2 * 0.8 * mass * omega
    shake = (
        signal.lfilter([1], [1, -0.98], rng.normal(0, 1, ref.shape), axis=0) * 0.0006 * arm.torque
    )
    pull = pull[::every] if pull is not None else np.zeros_like(ref)
    q, v = ref[0].copy(), speed[0].copy()
    out, turn = np.empty_like(ref), arm.rows[:, 3]
    for i in range(len(ref)):
        out[i] = q
        weight = pin.nonLinearEffects(arm.model, arm.data, q + turn, v)
        inertia = pin.crba(arm.model, arm.data, q + turn)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T + np.diag(arm.rotors)
        sign = np.tanh(v / arm.width)
        rub = arm.viscous * v + arm.coulomb * sign + arm.offset
        steep = arm.viscous + arm.coulomb / arm.width * (1 - sign**2)
        torque = (
            ahead[i]
            + kp * (ref[i] - q)
            + kd * (speed[i] - v)
            + shake[i]
            - weight
            - rub
            - pull[min(i, len(pull) - 1)]
        )
        left = inertia + np.diag(step * (steep + kd) + step**2 * kp)
        v = v + np.linalg.solve(left, step * (torque - step * kp * v))
        q = q + step * v
    if not np.all(np.isfinite(out)) or np.abs(out - ref).max() > 1.0:
        raise RuntimeError("the controller lost the arm")
    return signal.sosfiltfilt(signal.butter(3, 30.0, fs=1 / step, output="sos"), out, axis=0)


# --- hidden things --------------------------------------------------------------------------------


def draw_hidden(name, joint, rng, arm, ref):
    """Return a law with its shape drawn, and an amplitude to begin with."""
    q, span, n = ref.q[:, joint], np.ptp(ref.q[:, joint]), arm.n
    typical, speed, sign = arm.coulomb[joint], arm.speed[joint], rng.choice([-1, 1])
    sizes = {
        **BEGIN,
        **dict.fromkeys(("stribeck", "warmup_friction", "presliding_hysteresis"), typical),
        "torque_drift": typical * sign / 100,
        "joint_elasticity": 0.003 / arm.torque[joint],
        "viscous": arm.viscous[joint],
        "coulomb": typical,
        "motor_inertia": arm.rotors[joint],
        "ringing": arm.rotors[joint],
        "dead_band": 0.02 * arm.torque[joint],
    }
    size = sizes.get(name, typical * sign)
    if name in ("torque_gain", "torque_constant", "base_tilt", "encoder_offset"):
        size = 0.02 * rng.choice([-1, 1])

    def wave():
        low_, high = (0.7, 2.5) if name == "position_friction" else (8, 50)
        return {"k": spread(rng, low_, high), "phase": rng.uniform(0, 2 * np.pi)}

    def stop():
        side = rng.choice([-1, 1])
        share = rng.uniform(0.65, 0.85) if side > 0 else rng.uniform(0.15, 0.35)
        return {"side": int(side), "q1": np.quantile(q, share)}

    def coupling():
        up = joint == 0 or (joint + 1 < n and rng.random() < 0.5)
        other = joint + 1 if up else joint - 1
        return {"other": int(other), "ratio": rng.uniform(0, 1.5) * arm.speed[other]}

    def swing(low_, high, least, most):
        return {"hertz": rng.uniform(low_, high), "damping": rng.uniform(least, most)}

    shapes = {
        "stribeck": lambda: {"vs": spread(rng, 0.02, 0.12), "d": rng.uniform(0.6, 2.5)},
        "nonlinear_viscous": lambda: {
            "p": rng.choice([rng.uniform(0.3, 0.6), rng.uniform(1.6, 3.0)])
        },
        **dict.fromkeys(PHASED, wave),
        "spring": lambda: {
            "cubic": bool(rng.random() < 0.35),
            "rest": rng.uniform(-0.5, 0.5) * span,
        },
        "end_stop": stop,
        "warmup_friction": lambda: {"tw": rng.uniform(20, 150), "ratio": rng.uniform(0, 1) / speed},
        "torque_drift": lambda: {"tc": rng.choice([1e6, rng.uniform(40, 200)])},
        "joint_coupling": coupling,
        "torque_crosstalk": lambda: {"other": int(rng.choice(np.delete(np.arange(n), joint)))},
        "base_tilt": lambda: {"angle": rng.uniform(0, 2 * np.pi)},
        "backlash": lambda: swing(25, 40, 0.2, 0.5),
        "presliding_hysteresis": lambda: {
            "delta": spread(rng, 0.004, 0.06),
            "elements": int(rng.choice([1, 1, 4])),
        },
        "tool_force": lambda: {"direction": direction(rng)},
        "payload": lambda: {"centre": rng.uniform(-0.08, 0.08, 3).tolist()},
        "ringing": lambda: swing(4, 9, 0.01, 0.05),
        "snag": lambda: {
            "q0": np.quantile(q, rng.uniform(0.2, 0.8)),
            "w": rng.uniform(0.02, 0.08) * span,
            "side": int(rng.choice([-1, 1])),
        },
        "push": lambda: {
            "direction": direction(rng),
            "seconds": rng.uniform(0.2, 1.0),
            "place": rng.random(),
        },
        "wander": lambda: {"seed": int(rng.integers(1 << 30)), "seconds": rng.uniform(1, 6)},
        "odd_product": lambda: {"kind": int(rng.integers(3)), "other": int((joint + 1) % n)},
    }
    shape = shapes.get(name, dict)()
    if name == "torque_crosstalk":
        size = rng.choice([-1, 1]) * 0.02
    elif name.endswith("_change"):
        size = typical * rng.choice([1, 1, -0.2]) / (speed if name == "viscous_change" else 1)
    elif name == "odd_product":
        size = typical / speed * rng.choice([-1, 1])
    shape = {k: v if isinstance(v, (list, bool, int)) else float(v) for k, v in shape.items()}
    return Hidden(name, joint, float(size), shape)


def tip_force(arm, q, force):
    """Return the torques that hold a force at the tip, fixed in the world, (N, n) [N m]."""
    data, out = arm.model.createData(), np.zeros_like(q)
    for i in range(0, len(q), 10):
        pin.computeJointJacobians(arm.model, data, q[i] + arm.rows[:, 3])
        pin.updateFramePlacements(arm.model, data)
        jac = pin.getFrameJacobian(arm.model, data, arm.tip, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        out[i] = -jac[:3].T @ force
    return CubicSpline(np.arange(0, len(q), 10), out[::10], axis=0)(np.arange(len(q)))


def bristles(v, hidden, sign):
    """Return friction before sliding over its Coulomb level: one Dahl bristle, or four that slip one after the other."""
    delta, z = hidden.shape["delta"], 0.0
    out, moves = np.empty(len(v)), v * STEP
    if hidden.shape["elements"] == 1:
        for i, (move, s) in enumerate(zip(moves.tolist(), sign.tolist(), strict=True)):
            rate = abs(move) / delta
            z = z + (s - z) * rate / (1 + rate) if rate else z
            out[i] = z
        return out
    total = np.zeros(len(v))
    for reach in delta * np.array([0.4, 1.0, 2.0, 3.5]):
        z = 0.0
        for i, move in enumerate(moves.tolist()):
            z = min(1.0, max(-1.0, z + move / reach))
            out[i] = z
        total += out / 4
    return total


def play(load, inertia, hidden):
    """Return how far the link lies behind the motor, with its derivatives: a gap with elastic flanks, integrated finely."""
    half, omega = abs(hidden.size), 2 * np.pi * hidden.shape["hertz"]
    x, w, parts = half * np.sign(load[0]), 0.0, 4
    out = np.empty((len(load), 3))
    h = STEP / parts
    for i, (pull, mass) in enumerate(zip(load.tolist(), inertia.tolist(), strict=True)):
        stiff, damp = mass * omega**2, 2 * hidden.shape["damping"] * mass * omega
        for _ in range(parts):
            over = x - half if x > half else x + half if x < -half else 0.0
            contact = stiff * over + damp * w if over else 0.0
            w += h * (pull - contact) / mass
            x += h * w
        out[i] = x, w, (pull - contact) / mass
    return out


def add_hidden(arm, s, tau, rigid, q_seen, hidden):
    """Return the torques and the positions that encoders see with one hidden thing, both (N, n)."""
    j, a, p, t = hidden.joint, hidden.size, hidden.shape, s.t
    q, v, other = s.q[:, j], s.v[:, j], p.get("other", hidden.joint)
    sign, there, over = np.tanh(v / arm.width[j]), s.q[:, other], s.v[:, other]
    own, name = tau[:, j], hidden.name.removesuffix("_change")
    laws = {
        "stribeck": lambda: a * np.exp(-((np.abs(v) / p["vs"]) ** p["d"])) * sign,
        "torque_offset": lambda: a,
        "viscous": lambda: a * v,
        "coulomb": lambda: a * sign,
        "motor_inertia": lambda: a * s.a[:, j],
        "asymmetric_viscous": lambda: a * np.abs(v),
        "nonlinear_viscous": lambda: a * sign * np.abs(v) ** p["p"],
        "load_friction": lambda: a * np.abs(rigid[:, j]) * sign,
        "torque_gain": lambda: a * own,
        "torque_constant": lambda: a * np.abs(v) * own,
        "warmup_friction": lambda: a * np.exp(-t / p["tw"]) * (sign + p["ratio"] * v),
        "torque_drift": lambda: a * p["tc"] * -np.expm1(-t / p["tc"]),
        **dict.fromkeys(PHASED[:2], lambda: a * np.cos(p["k"] * q - p["phase"]) * sign),
        "torque_ripple": lambda: a * np.cos(p["k"] * q - p["phase"]),
        "spring": lambda: a * (q - p["rest"]) ** (3 if p["cubic"] else 1),
        "end_stop": lambda: a * np.maximum(0, p["side"] * (q - p["q1"])),
        "joint_coupling": lambda: a * (over + p["ratio"] * np.tanh(over / arm.width[other])),
        "torque_crosstalk": lambda: a * rigid[:, other],
        "presliding_hysteresis": lambda: (
            a * bristles(v, hidden, sign) - min(a, arm.coulomb[j]) * sign
        ),
        "ringing": lambda: ring(s.a[:, j], abs(a), p),
        "dead_band": lambda: -np.clip(own, -abs(a), abs(a)),
        "snag": lambda: a * np.exp(-(((q - p["q0"]) / p["w"]) ** 2)) * (p["side"] * v > 0),
        "saturation": lambda: clipped(own, np.abs(own).max() * (1 - min(abs(a), 0.9))),
        "wander": lambda: a * wander(t, p) * (0.3 + np.abs(sign)),
        "odd_product": lambda: (
            a * [v * np.cos(2 * there), over * v, np.abs(v) * np.sin(3 * q)][p["kind"]]
        ),
    }
    whole = {
        "backlash": lambda: rigid_torque(arm, *behind(arm, s, rigid, hidden)) - rigid,
        "base_tilt": lambda: rigid_torque(arm, s.q, s.v, s.a, tilted(arm, hidden)) - rigid,
        "payload": lambda: rigid_torque(arm, s.q, s.v, s.a, loaded(arm, hidden)) - rigid,
        "tool_force": lambda: tip_force(arm, s.q, abs(a) * np.array(p["direction"])),
        "gravity_part": lambda: -a * rigid_torque(arm, s.q, 0 * s.v, 0 * s.a),
        "push": lambda: pushed(arm, s, hidden) if p.get("now", True) else 0.0,
    }
    tau, seen = tau.copy(), q_seen.copy()
    if name in laws:
        tau[:, j] += laws[name]()
    elif name in whole:
        tau += whole[name]()
    elif name == "torque_delay":
        late = np.arange(len(t)) * STEP - abs(a)
        tau = CubicSpline(np.arange(len(t)) * STEP, tau, axis=0)(np.maximum(late, 0))
    elif name == "encoder_offset":
        seen[:, j] += a
    elif name == "joint_elasticity":
        bend = abs(a) * rigid[:, j]  # the encoder sits on the motor, which leads the link
        seen[:, j] += bend
        lead = np.gradient(bend, STEP)
        rub = arm.viscous[j] * lead + arm.coulomb[j] * (np.tanh((v + lead) / arm.width[j]) - sign)
        tau[:, j] += arm.rotors[j] * np.gradient(lead, STEP) + rub
    return tau, seen if name in ("encoder_offset", "joint_elasticity") else q_seen


def clipped(torque, most):
    """Return what a limit takes off a torque, (N,)."""
    return np.clip(torque, -most, most) - torque


def ring(accel, size, shape):
    """Return the inertia torque of a mass on a spring that the joint carries, (N,)."""
    omega = 2 * np.pi * shape["hertz"]
    num, den = signal.bilinear([-1, 0, 0], [1, 2 * shape["damping"] * omega, omega**2], 1 / STEP)
    return size * slopes(signal.lfilter(num, den, accel))[1] / omega**2


def wander(t, shape):
    """Return slow noise of rms 1 that each recording draws anew, (N,)."""
    noise = np.random.default_rng([shape["seed"], int(1000 * t[0])]).normal(size=len(t))
    slow = signal.lfilter([1], [1, -np.exp(-STEP / shape["seconds"])], noise)
    return slow / slow.std()


def behind(arm, s, rigid, hidden):
    """Return the motion of the links where one lies behind its motor, whose motion is given, by backlash."""
    j, data = hidden.joint, arm.model.createData()
    masses = [pin.crba(arm.model, data, row + arm.rows[:, 3])[j, j] for row in s.q[::50]]
    inertia = np.interp(np.arange(len(s.t)), np.arange(0, len(s.t), 50), masses)
    links = [s.q.copy(), s.v.copy(), s.a.copy()]
    for link, lag in zip(links, play(rigid[:, j], inertia, hidden).T, strict=True):
        link[:, j] -= lag
    return links


def tilted(arm, hidden):
    """Return the arm on a base that leans."""
    angle, model = hidden.shape["angle"], arm.model.copy()
    axis = np.cross(arm.gravity / 9.81, [np.cos(angle), np.sin(angle), 0.3])
    model.gravity.linear = pin.exp3(hidden.size * axis / np.linalg.norm(axis)) @ arm.gravity
    return model


def loaded(arm, hidden):
    """Return the arm with a ball at its tip."""
    mass, model = abs(hidden.size), arm.model.copy()
    ball = pin.Inertia(mass, np.array(hidden.shape["centre"]), 0.4 * mass * 0.04**2 * np.eye(3))
    model.appendBodyToJoint(arm.n, ball, model.frames[arm.tip].placement)
    return model


def pushed(arm, s, hidden):
    """Return the torques of one push against the tip, (N, n)."""
    t, p = s.t, hidden.shape
    x = ((t - t[0]) / np.ptp(t) - 0.1 - 0.8 * p["place"]) * np.ptp(t) / p["seconds"]
    pulse = np.where((x > 0) & (x < 1), np.sin(np.pi * x) ** 2, 0.0)
    return pulse[:, None] * tip_force(arm, s.q, hidden.size * np.array(p["direction"]))


def torques(arm, s, hidden):
    """Return the torques and the positions that perfect sensors would see, both (N, n), and the torques without hidden things."""
    rigid = rigid_torque(arm, s.q, s.v, s.a)
    plain = rigid + arm.rotors * s.a + friction(arm, s.v)
    tau, seen = plain, s.q
    for one in sorted(
        hidden,
        key=lambda one: one.name in ("torque_gain", "torque_delay", "dead_band", "saturation"),
    ):
        tau, seen = add_hidden(arm, s, tau, rigid, seen, one)
    return tau, seen, plain


# --- how visible it is ----------------------------------------------------------------------------


def low(x, band=BAND):
    """Return signals of the fine grid below a frequency."""
    return signal.sosfiltfilt(signal.butter(2, band, fs=1 / STEP, output="sos"), x, axis=0)


class Yardstick:
    """Least squares with all true columns on motions, to say what a model absorbs of a hidden thing."""

    def __init__(self, arm, motions, noise, left_out):
        n, data, rows = arm.n, arm.model.createData(), []
        for s in motions:
            sharp = low(np.tanh(s.v / 0.01))[::THIN]
            for i, (q, v, a) in enumerate(
                zip(s.q[::THIN] + arm.rows[:, 3], s.v[::THIN], s.a[::THIN], strict=True)
            ):
                wide = [np.diag(a), np.diag(v), np.diag(sharp[i]), np.eye(n)]
                for kind, j in left_out:
                    wide[
                        {"motor_inertia": 0, "viscous": 1, "coulomb": 2, "torque_offset": 3}[kind]
                    ][j, j] = 0
                rows.append(
                    np.hstack([pin.computeJointTorqueRegressor(arm.model, data, q, v, a), *wide])
                    / noise[:, None]
                )
        u, size, _ = np.linalg.svd(np.vstack(rows), full_matrices=False)
        self.known, self.noise, self.n = u[:, size > 1e-7 * size[0]], noise, n

    def visible(self, parts, absorb=True):
        """Return the size of what is left of torques on the motions, over the noise, for each joint."""
        y = (np.vstack([part[::THIN] for part in parts]) / self.noise).ravel()
        if absorb:
            y = y - self.known @ (self.known.T @ y)
        return np.sqrt(np.mean(y.reshape(-1, self.n) ** 2, axis=0))


def unexplained(arm, s, hidden):
    """Return what hidden things add to what a perfect model of the plain arm says of the positions that are seen, (N, n)."""
    tau, seen, plain = torques(arm, s, hidden)
    if seen is not s.q:
        q = s.q + low(seen - s.q)
        v, a = (old + new for old, new in zip((s.v, s.a), slopes(q - s.q), strict=True))
        plain = rigid_torque(arm, q, v, a) + arm.rotors * a + friction(arm, v)
    return low(tau - plain)


def scaled(arm, motions, yard, hidden, wanted, absorb):
    """Return a hidden thing as large as wanted where that is plausible, with its visible size; None where it cannot be seen."""
    one = hidden
    for _ in range(4):
        one = replace(
            one,
            visible=float(
                yard.visible([unexplained(arm, s, [one]) for s in motions], absorb).max()
            ),
        )
        if one.name == "coarse" or not np.isfinite(one.visible) or one.visible < 1e-6:
            break
        if abs(one.visible / wanted - 1) < 0.05:
            break
        most = LARGEST.get(one.name, np.inf)
        if one.name == "joint_elasticity":
            most /= arm.torque[one.joint]
        one = replace(
            one,
            size=float(
                np.sign(one.size)
                * min(abs(one.size) * np.clip(wanted / one.visible, 0.02, 50), most)
            ),
        )
    return one


# --- the recorder ---------------------------------------------------------------------------------


def draw_recorder(rng, n):
    """Return what a recorder does to signals."""
    rate = float(rng.choice([100, 125, 200, 250, 500, 1000]))
    return {
        "rate": rate,
        "torque_noise": rng.uniform(0.006, 0.025, n),
        "memory": np.exp(-1 / rate / spread(rng, 0.0005, 0.02, n)),
        "torque_step": rng.uniform(0.2, 1.0, n),
        "bits": int(rng.integers(16, 21)),
        "position_noise": rng.uniform(0, 0.6),
        "skew": str(rng.choice(["none", "bus", "late"])),
        "skew_samples": rng.uniform(0, 0.3),
        "velocity": str(rng.choice(["none", "filtered", "filtered"])),
        "velocity_band": rng.uniform(8, 40),
        "jitter": float(rng.choice([0, 0, 0, 0.02])),
        "same_start": bool(rng.random() < 0.5),
        "clock": str(rng.choice(["each", "session"])),
        "format": "csv" if rate <= 250 and rng.random() < 0.6 else "npz",
    }


def record(rng, recorder, scale, s, tau, seen, begin):
    """Return time, positions, velocities and torques as the recorder writes them."""
    rate, n = recorder["rate"], tau.shape[1]
    fine = s.t - s.t[0]
    t = np.arange(0, fine[-1] - begin - 0.01, 1 / rate)
    at = begin + t + recorder["jitter"] / rate * rng.normal(size=len(t)).clip(-3, 3)
    q, torque = np.empty((len(t), n)), np.empty((len(t), n))
    skew = recorder["skew_samples"] / rate
    for j in range(n):
        late = skew * j / max(1, n - 1) if recorder["skew"] == "bus" else 0.0
        older = skew if recorder["skew"] == "late" else 0.0
        q[:, j] = CubicSpline(fine, seen[:, j])(np.clip(at + late, 0, fine[-1]))
        torque[:, j] = CubicSpline(fine, tau[:, j])(np.clip(at + late - older, 0, fine[-1]))
    white = rng.normal(size=torque.shape)
    coloured = np.empty_like(white)
    for j, phi in enumerate(recorder["memory"]):
        coloured[:, j] = signal.lfilter([np.sqrt(1 - phi**2)], [1, -phi], white[:, j])
    sd = recorder["torque_noise"] * scale
    noisy = torque + sd * (0.8 * coloured + 0.6 * rng.normal(size=torque.shape))
    coarse = recorder.get("coarse")
    step = recorder["torque_step"] * sd if coarse is None else coarse
    noisy = np.round(noisy / step) * step
    line = 2 * np.pi / 2 ** recorder["bits"]
    q = np.round((q + recorder["position_noise"] * line * rng.normal(size=q.shape)) / line) * line
    v = None
    if recorder["velocity"] == "filtered":
        keep = np.exp(-2 * np.pi * recorder["velocity_band"] / rate)
        slopes = np.diff(q, axis=0, prepend=q[:1]) * rate
        v = signal.lfilter([1 - keep], [1, -keep], slopes, axis=0)
    stamp = t + begin + (s.t[0] if recorder["clock"] == "session" else 0.0)
    return stamp, q, v, noisy


def noise_floor(arm, recorder, scale, s, tau, rng):
    """Return the noise of each joint below 10 Hz: that of the torques and what noisy positions do to the model, (n,) [N m]."""
    _, q, _, noisy = record(rng, recorder, scale, s, tau, s.q, 0.0)
    plain = {
        **recorder,
        "torque_noise": 1e-9 + 0 * scale,
        "bits": 40,
        "position_noise": 0.0,
        "coarse": None,
    }
    _, exact, _, clean = record(
        np.random.default_rng(0), {**plain, "jitter": 0.0}, scale, s, tau, s.q, 0.0
    )
    rate = recorder["rate"]
    band = signal.butter(2, BAND, fs=rate, output="sos")
    models = []
    for positions in (q, exact):
        kept = signal.sosfiltfilt(band, positions, axis=0)
        speed, accel = slopes(kept, 1 / rate)
        slow = max(1, int(rate // 50))
        models.append(
            rigid_torque(arm, kept[::slow], speed[::slow], accel[::slow])
            + arm.rotors * accel[::slow]
        )
    error = signal.sosfiltfilt(band, noisy - clean, axis=0)[::slow] - (models[0] - models[1])
    return np.sqrt(np.mean(error[10:-10] ** 2, axis=0))


def write_log(path, recorder, stamp, q, v, tau):
    """Write a log as a user has it: a table, or arrays."""
    columns = {"t": stamp, "q": q} | ({} if v is None else {"qd": v}) | {"tau": tau}
    path = path.with_suffix(f".{recorder['format']}")
    if recorder["format"] == "npz":
        np.savez(path, **columns)
        return path.name
    joints = range(1, q.shape[1] + 1)
    head = ["t", *(f"{kind}_axis_{j}" for kind in list(columns)[1:] for j in joints)]
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, "%.9g", ",", header=",".join(head), comments="")
    return path.name


def write_robot(path, arm, left_out):
    """Write the robot file that a user would have: geometry, limits and which friction there is."""
    lines = [
        f"name: stranger\nconvention: {arm.convention}\ngravity: {arm.gravity.tolist()}",
        f"mount: {arm.mount}\njoints:",
    ]
    for j, (a, twist, d, turn) in enumerate(arm.rows):
        friction_ = [w for k, w in LEFT_OUT.items() if (k, j) not in left_out]
        lines.append(
            f"""\
  - name: axis_{j + 1}
    a: {a}
    twist: {twist:.15g}
    d: {d}
    theta_offset: {turn:.15g}
    limits: {{velocity: {arm.speed[j] * 1.2:.3f}, torque: {arm.torque[j]:.3f}}}
    friction: [{", ".join(friction_)}]"""
        )
        if ("motor_inertia", j) in left_out:
            lines.append("    motor_inertia: false")
    path.write_text("\n".join([*lines, "driver: {kind: generic}"]) + "\n")


# --- a case ---------------------------------------------------------------------------------------


def wanted_size(rng):
    """Return a visible size: most above the noise, some below."""
    low_, high = [(1, 4), (0.5, 1), (0.3, 0.5)][int(rng.choice(3, p=[0.6, 0.25, 0.15]))]
    return float(spread(rng, low_, high))


def pick(kind, rng, k):
    """Return names to hide for a set, in a fixed rotation so that a seed meets most of them."""
    turn = int(rng.integers(100))
    if kind == "single":
        return [list(CATALOGUED)[(7 * k + turn) % len(CATALOGUED)]]
    if kind == "double":
        return list(rng.choice(["stribeck", *CATALOGUED], 2, replace=False))
    if kind == "outside":
        return [OUTSIDE[(k + turn) % len(OUTSIDE)]]
    if kind == "changed":
        return [CHANGES[(k + turn) % len(CHANGES)]]
    return ["stribeck"] if kind == "stribeck" else []


def make_case(folder, seed, k):
    """Make one case: robot file, logs and truth.json."""
    for attempt in range(10):
        try:
            _make_case(folder, seed, k, attempt)
            return
        except RuntimeError:
            continue
    raise RuntimeError(f"seed {seed} case {k}: no arm could be driven")


def _make_case(folder, seed, k, attempt):
    rng = np.random.default_rng([28, seed, k, attempt])
    kind = CYCLE[k % len(CYCLE)]
    arm = draw_arm(rng)
    arm.stiff = rng.uniform(2.5, 6.0)
    seconds = rng.uniform(15, 28)
    kinds = [
        "harmonics",
        *rng.choice(["harmonics", "harmonics", "harmonics", "moves", "chirp", "sweeps"], 2),
    ]
    references = [draw_reference(rng, arm, str(one), seconds) for one in kinds]
    nominal = [smooth_states(ref, STEP, 40.0 * i) for i, ref in enumerate(references)]
    recorder = draw_recorder(rng, arm.n)
    tau0 = torques(arm, nominal[0], [])[0]
    scale = np.sqrt(np.mean(tau0**2, axis=0)) + 0.02 * np.sqrt(np.mean(tau0**2))
    noise = noise_floor(arm, recorder, scale, nominal[0], tau0, rng)
    names = pick(kind, rng, k)
    if "coarse" in names:
        recorder["coarse"] = np.minimum(0.5, 0.6 * scale)  # weak joints would be silent
    hidden, left_out = [], set()
    for name in names if names != ["nothing"] else []:
        wanted, best = wanted_size(rng) if kind != "outside" else rng.uniform(1, 4), None
        if name == "coarse":
            hidden.append(Hidden("coarse", 0, 0.5, {}))
            continue
        for joint in rng.permutation(arm.n)[:4]:
            missing = (
                {(name, int(joint))}
                if kind in ("single", "double") and name in (*LEFT_OUT, "motor_inertia")
                else set()
            )
            if name == "motor_inertia" and joint < 2:
                continue
            yard = Yardstick(arm, nominal[:2], noise, missing)
            one = draw_hidden(name, int(joint), rng, arm, nominal[0])
            one = scaled(arm, nominal[:2], yard, one, wanted, kind != "changed")
            if np.isfinite(one.visible) and (
                best is None
                or abs(np.log(one.visible / wanted)) < abs(np.log(best[0].visible / wanted))
            ):
                best = one, missing
            if best and 0.7 < best[0].visible / wanted < 1.4:
                break
        if best is None or best[0].visible < 0.15:
            raise RuntimeError("cannot be seen")
        hidden.append(best[0])
        left_out |= best[1]
    own = {
        "torque_offset": arm.offset,
        "viscous": arm.viscous,
        "coulomb": arm.coulomb,
        "motor_inertia": arm.rotors,
    }
    for name, j in left_out:  # what is left out of the model is the whole of that friction
        own[name][j] = 0.0
    always = []
    if kind == "changed" and rng.random() < 0.25:  # a model that lacked something before, too
        one = draw_hidden("stribeck", int(rng.integers(arm.n)), rng, arm, nominal[0])
        always = [
            scaled(arm, nominal[:2], Yardstick(arm, nominal[:2], noise, set()), one, 1.0, True)
        ]
    if {one.name for one in hidden} & set(ONE_CLOCK):
        recorder["clock"] = "session"
    twice = 2 if rng.random() < 0.75 else 1
    third = rng.random() < 0.8
    if kind == "changed":
        same = rng.random() < 0.5
        again = twice if rng.random() < 0.7 else 1
        plan = [0, 1] * twice, [0 if same else 2] * again
    else:
        plan = [], [0, 1] * twice + [2] * (int(rng.integers(1, twice + 1)) if third else 0)
    plan = [(which, there) for there, some in enumerate(plan) for which in sorted(some)]
    folder.mkdir(parents=True, exist_ok=True)
    write_robot(folder / "arm.yaml", arm, left_out)
    logs, clock, counts, driven = [], 0.0, {}, []
    for number, (which, there) in enumerate(plan):
        now = [*always, *(hidden if there else [])]
        for one in now:
            if one.name == "push":
                one.shape["now"] = number == len(plan) // 2
        s = replace(nominal[which], t=nominal[which].t - nominal[which].t[0] + clock)
        pull = torques(arm, s, now)[0] - torques(arm, s, [])[0] if now else None
        s = smooth_states(drive(arm, references[which], rng, pull), 2 * STEP, clock)
        tau, seen, _ = torques(arm, s, now)
        begin = 0.0 if recorder["same_start"] else float(rng.uniform(0, 0.4))
        counts[which] = counts.get(which, 0) + 1
        name = write_log(
            folder
            / f"{'abc'[which]}{counts[which]}{'' if kind != 'changed' else '_new' if there else '_old'}",
            recorder,
            *record(rng, recorder, scale, s, tau, seen, begin),
        )
        logs.append({"file": name, "motion": which, "there": bool(there)})
        if there:
            driven.append(s)
        clock += seconds + rng.uniform(3, 30)
    first = driven[:: max(1, len(driven) // 2)][:2]
    yard = Yardstick(arm, first, noise, left_out)
    for one in hidden:
        if one.name not in ("coarse", "push"):
            parts = [unexplained(arm, s, [one]) for s in first]
            one.visible = float(yard.visible(parts, kind != "changed").max())
    truth = {
        "seed": seed,
        "case": k,
        "set": kind if kind != "stribeck" else "single",
        "effects": [vars(one) | {"joint": one.joint + 1} for one in hidden],
        "always": [vars(one) | {"joint": one.joint + 1} for one in always],
        "noise": noise,
        "logs": logs,
        "recorder": recorder,
    }
    text = json.dumps(truth, indent=1, default=lambda value: np.asarray(value).tolist())
    (folder / "truth.json").write_text(text)


# --- what dynid says ------------------------------------------------------------------------------


def true_numbers(effect):
    """Return the amplitudes of a hidden thing under the names of the reference, where its law is the catalogue's."""
    size, shape, name = effect["size"], effect["shape"], effect["name"]
    letter = (CATALOGUED | OTHERS).get(name)
    if shape.get("elements", 1) != 1 or shape.get("cubic"):
        return {}
    special = {
        **{law: {"a&b": (abs(size),)} for law in PHASED},
        "base_tilt": {"x&y": (abs(size),)},
        "tool_force": {"x&y&z": (abs(size),)},
        "spring": {"k1": (size,)},
        "torque_gain": {"g": (size, size / (1 + size))},
        "warmup_friction": {"a1": (size,), "a2": (size * shape.get("ratio", 0),)},
        "joint_coupling": {"a": (size,), "b": (size * shape.get("ratio", 0),)},
    }
    return special.get(name, {letter: (size,)} if letter else {})


def sizes_inside(effect, parameters):
    """Return for each comparable amplitude: true, found, standard error, inside 95 %."""
    out = []
    for letters, truths in true_numbers(effect).items():
        found = [parameters.get(letter, {}) for letter in letters.split("&")]
        if any(one.get("std_error") is None for one in found):
            continue
        values, errors = (np.array([one[key] for one in found]) for key in ("value", "std_error"))
        value, error = float(values[0]), float(errors[0])
        if len(found) > 1:
            value = float(np.linalg.norm(values))
            error = float(np.sqrt(np.sum((values * errors) ** 2)) / max(value, 1e-300))
        inside = any(abs(value - truth) <= 1.96 * error for truth in truths)
        out.append([float(truths[0]), value, error, bool(inside)])
    return out


def judge(truth, facts, identified_delay):
    """Return the answer of a search beside the truth: its kind, wrong names, sizes."""
    hidden = [one for one in truth["effects"] if one["name"] not in OUTSIDE]
    # What the model always lacked is told too, where nothing that changed is named.
    always = {(one["name"], f"axis_{one['joint']}") for one in truth.get("always", ())}
    told = [one for one in facts["named"] if (one["effect"], *one["joints"][:1]) not in always]
    recorder = truth["recorder"]
    extra = recorder["skew_samples"] / recorder["rate"] if recorder["skew"] == "late" else 0.0
    wrong, sizes, found = [], [], set()
    for one in told:
        joints = one["joints"] if isinstance(one["joints"], list) else [one["joints"]]
        first = joints[0] if joints else None
        for i, effect in enumerate(hidden):
            other = effect["shape"].get("other")
            whole = effect["name"] in WHOLE or (
                first == f"axis_{effect['joint']}"
                and (other is None or len(joints) < 2 or joints[1] == f"axis_{other + 1}")
            )
            # The zero of joint 1 turns the whole arm against gravity: it is a tilt of the base.
            tilt = (
                one["effect"] == "base_tilt"
                and effect["name"] == "encoder_offset"
                and effect["joint"] == 1
            )
            if tilt:
                found.add(i)
                break
            if effect["name"] == one["effect"] and whole:
                found.add(i)
                sizes += [
                    [effect["name"], *each] for each in sizes_inside(effect, one["parameters"])
                ]
                break
        else:
            late = (
                one["effect"] == "torque_delay"
                and extra
                and abs(one["parameters"]["delay"]["value"] - extra) < 0.4 * extra + 2e-4
            )
            if not late:  # a recorder whose torques are late is told rightly
                wrong.append(one)
    for i, effect in enumerate(hidden):
        if effect["name"] != "torque_delay" or i in found or identified_delay is None:
            continue
        size = abs(effect["size"])
        if abs(identified_delay - extra - size) < 0.3 * size + 2e-4:
            found.add(i)  # corrected, and told, before the search
    groups = {name for group in facts["alternatives"] for name in group}
    groups |= {one["effect"] for one in told} if facts["verdict"] == "ambiguous" else set()
    among = bool(hidden) and all(
        any(effect["name"] in name for name in groups)
        for i, effect in enumerate(hidden)
        if i not in found
    )
    quiet = facts["verdict"] in ("nothing_missing", "nothing_changed")
    quiet |= (
        truth["set"] == "changed"
        and facts["question"] == "numbers"
        and len(told) < len(facts["named"])
    )
    if facts["verdict"] == "ambiguous" and among and hidden:
        kind = "ambiguous"
    elif wrong:
        kind = "right and wrong" if found else "wrong"
    elif hidden and len(found) == len(hidden):
        kind = "exact"
    elif found:
        kind = "part"
    else:
        kind = "nothing" if quiet else "something"
    return {
        "kind": kind,
        "wrong": [f"{one['effect']}@{one['joints']}" for one in wrong],
        "sizes": sizes,
        "found": sorted(found),
    }


def run_case(folder, truth):
    """Identify and search one case by the public API, and return one line of results."""
    import dynid
    from dynid.errors import DynidError

    paths = [folder / log["file"] for log in truth["logs"]]
    there = [path for path, log in zip(paths, truth["logs"], strict=True) if log["there"]]
    row = {key: truth[key] for key in ("seed", "case", "set")}
    row |= {
        "effects": [
            [one["name"], one["joint"], round(one["visible"], 3)] for one in truth["effects"]
        ],
        "always": [[one["name"], one["joint"]] for one in truth["always"]],
    }
    changed, before = truth["set"] == "changed", time.process_time()
    fitted = [
        path
        for path, log in zip(paths, truth["logs"], strict=True)
        if (not log["there"] if changed else log["motion"] < 2)
    ]
    try:
        known = dynid.identify(folder / "arm.yaml", fitted)
        before = time.process_time()
        earlier = dynid.earlier_logs(known, there) if changed else ()
        facts = dynid.find_gap(known, there, earlier=earlier).facts()
    except DynidError as error:
        return row | {
            "kind": "refused",
            "why": str(error)[:300],
            "wrong": [],
            "sizes": [],
            "seconds": time.process_time() - before,
        }
    told = [
        [one["effect"], one["joints"], one.get("probability"), one["p_value"]]
        for one in facts["named"]
    ]
    return (
        row
        | judge(truth, facts, known.delay)
        | {
            "verdict": facts["verdict"],
            "told": told,
            "question": facts["question"],
            "closest": [
                [one["effect"], one["joints"], one.get("why_not"), one.get("probability")]
                for one in facts["closest"]
            ],
            "not_repeatable": list(facts["not_repeatable"]),
            "seconds": time.process_time() - before,
        }
    )


# --- tables ---------------------------------------------------------------------------------------


def wilson(hits, of):
    """Return a share with its 95 % interval of Wilson, as text."""
    if not of:
        return "-"
    z, p = 1.96, hits / of
    middle, half = (p + z * z / 2 / of), z * np.sqrt(p * (1 - p) / of + z * z / 4 / of**2)
    low_, high = (middle - half) / (1 + z * z / of), (middle + half) / (1 + z * z / of)
    return f"{hits} of {of} ({100 * p:.0f} %; {100 * low_:.0f} to {100 * high:.0f})"


def smallest(row):
    """Return the smaller visible size of what is hidden."""
    return min((visible for _, _, visible in row["effects"]), default=0.0)


def table(rows):
    """Return the rates as Markdown."""

    def named(row, *names):
        return any(name in names for name, _, _ in row["effects"])

    by_set = {
        name: [row for row in rows if row["set"] == name]
        for name in ("clean", "single", "double", "outside", "changed")
    }
    stribeck = [row for row in by_set["single"] if named(row, "stribeck")]
    unchanged = [row for row in by_set["changed"] if not row["effects"]]
    changed = [row for row in by_set["changed"] if row["effects"]]

    def rate(chosen, good):
        return wilson(sum(map(good, chosen)), len(chosen))

    def big(chosen, low_=1, high=99):
        return [row for row in chosen if low_ <= smallest(row) < high]

    def right(row):
        return row["kind"] == "exact"

    def both(row):
        return len(row.get("found", ())) == len(row["effects"]) and row["kind"] == "exact"

    odd = [row for row in by_set["outside"] if not named(row, "coarse")]
    sizes = [each[-1] for row in rows for each in row["sizes"]]
    seconds = [row["seconds"] for row in rows if row["kind"] != "refused"]
    wrong = sum(len(row["wrong"]) for row in rows if row["kind"] != "ambiguous")
    lines = ["| rate | measured |", "|---|---|"]
    for name, text in (
        ("single >= 1 exact", rate(big(by_set["single"]), right)),
        ("single 0.5 to 1 exact", rate(big(by_set["single"], 0.5, 1), right)),
        ("Stribeck >= 1 exact", rate(big(stribeck), right)),
        ("Stribeck 0.5 to 1 exact", rate(big(stribeck, 0.5, 1), right)),
        ("double, both >= 1: both named", rate(big(by_set["double"]), both)),
        ("double, both >= 0.5: both named", rate(big(by_set["double"], 0.5), both)),
        ("clean: nothing is missing", rate(by_set["clean"], lambda row: row["kind"] == "nothing")),
        ("clean: no name", rate(by_set["clean"], lambda row: not row["wrong"])),
        (
            "outside: something is missing, without a name",
            rate(
                odd,
                lambda row: (
                    row["kind"] == "something"
                    or (bool(row.get("not_repeatable")) and not row["wrong"])
                ),
            ),
        ),
        ("outside: no name", rate(by_set["outside"], lambda row: not row["wrong"])),
        ("changed >= 1 exact", rate(big(changed), right)),
        ("changed >= 0.5 exact", rate(big(changed, 0.5), right)),
        ("unchanged: nothing said", rate(unchanged, lambda row: row["kind"] == "nothing")),
        ("wrong names in all cases", f"{wrong} in {len(rows)}"),
        ("true sizes inside 95 %", wilson(sum(sizes), len(sizes))),
        (
            "processor time of the search, median and largest",
            f"{np.median(seconds):.1f} s, {max(seconds):.1f} s" if seconds else "-",
        ),
    ):
        lines.append(f"| {name} | {text} |")
    bins = reliability(rows)
    if bins:
        lines += ["", "| probability given | names | right |", "|---|---|---|", *bins]
    return "\n".join(lines)


def reliability(rows):
    """Return how often names of a given probability are right, of names and of likely names below the limit.

    What the arm always lacked is right where it is told of a changed one.
    """
    pairs = []
    for row in rows:
        hidden = {(name, joint) for name, joint, *_ in (*row["effects"], *row.get("always", ()))}
        every = [(n, j, p) for n, j, p, _ in row.get("told", ())] + [
            (n, j, p) for n, j, _, p in row.get("closest", ())
        ]
        for name, joints, p in every:
            if p is None:
                continue
            first = int(joints[0].removeprefix("axis_")) if joints else 0
            pairs.append(
                (p, (name, first) in hidden or (name in WHOLE and name in {n for n, _ in hidden}))
            )
    out = []
    for low_, high in (
        (0, 0.2),
        (0.2, 0.5),
        (0.5, 0.8),
        (0.8, 0.9),
        (0.9, 0.95),
        (0.95, 0.99),
        (0.99, 0.999),
        (0.999, 1.01),
    ):
        chosen = [good for p, good in pairs if low_ <= p < high]
        if chosen:
            out.append(
                f"| {100 * low_:g} to {min(100, 100 * high):g} % | {len(chosen)} | {wilson(sum(chosen), len(chosen))} |"
            )
    return out


def numbers(text):
    """Return the numbers of a list such as 1-3,7."""
    spans = [part.split("-") for part in text.split(",")]
    return [k for span in spans for k in range(int(span[0]), int(span[-1]) + 1)]


def commit():
    """Return which code runs: its commit, with a plus where it was changed since."""
    asked = [
        "git",
        "-C",
        str(Path(__file__).parent),
        "describe",
        "--always",
        "--dirty=+",
        "--exclude=*",
    ]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()


def work(job):
    """Make a case if it is not there, run it, return its line."""
    folder, seed, k = job
    place = folder / f"{seed}" / f"{k:03d}"
    if not (place / "truth.json").exists():
        make_case(place, seed, k)
    return run_case(place, json.loads((place / "truth.json").read_text()))


def main():
    """Run the cases that are asked for and not there yet, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", default="1", help="such as 1-3,7")
    parser.add_argument("--cases", default="0-59", help="numbers of cases, such as 0-59 or 12")
    parser.add_argument("--only", help="one set")
    parser.add_argument("--jobs", type=int, default=1)
    kept = Path(tempfile.gettempdir()) / "gap_stranger"
    parser.add_argument("--folder", type=Path, default=kept, help="where cases are kept")
    parser.add_argument("--out", type=Path, default=Path("gap_stranger.jsonl"))
    parser.add_argument("--code", default=None, help="name of the code instead of its commit")
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    code = args.code or commit()
    wanted = {(seed, k) for seed in numbers(args.seeds) for k in numbers(args.cases)}
    rows = map(json.loads, args.out.read_text().splitlines() if args.out.exists() else [])
    rows = [
        each for each in rows if each["code"] == code and (each["seed"], each["case"]) in wanted
    ]
    todo = sorted(wanted - {(row["seed"], row["case"]) for row in rows})
    jobs = []
    for seed, k in todo:
        kind = CYCLE[k % len(CYCLE)]
        if args.only in (None, kind, "single" if kind == "stribeck" else kind):
            jobs.append((args.folder, seed, k))
    print(f"seeds {args.seeds}, cases {args.cases}, code {code}: {len(jobs)} to do", flush=True)
    with ProcessPoolExecutor(args.jobs) as pool:
        for row in pool.map(work, jobs):
            rows.append(row | {"code": code})
            with args.out.open("a") as file:
                file.write(json.dumps(rows[-1], default=float) + "\n")
            hidden = ", ".join(f"{n}@{j} {v:.2f}" for n, j, v in row["effects"]) or "-"
            told = ", ".join(f"{n}@{'+'.join(j)}" for n, j, *_ in row.get("told", ())) or "-"
            print(
                f"{row['seed']}/{row['case']:02d} {row['set']:8} {row['kind']:15} {row['seconds']:5.1f} s  {hidden}  ->  {told}",
                flush=True,
            )
    if rows:
        print(table(rows))
        if args.table:
            args.table.write_text(table(rows) + "\n")


if __name__ == "__main__":
    main()
